"""Holes in walls, which the thesis left open (its sections 3.5 and 6.3).

Two passes like plaster's, over vertical patches only. Where columns of a wall are missing, the
search along +x and +y is plaster's, with the distance of the intervals [height - depth, height],
at most ``height_thresh * d * cell_size``; tops and bottoms run on straight lines. Within one
cell, the space between two successive patches that are both vertical is filled where it is more
than `gap_size` and at most the allowed length. A horizontal patch is never joined to what stands
above it: the space under a bridge stays open. The stage belongs before plaster, which then finds
no gap there.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from mlscli.parameters import Cells, Length, in_units, parameter, whole_cells
from mlscli.pipeline.gaps import (
    Inserted,
    Intervals,
    Widths,
    close_gaps,
    gap_faults,
    passes,
    settle,
)
from mlscli.pipeline.stage import Fault, MapStage
from mlscli.surface_map import ARTIFICIAL, PLASTERED, SurfaceMap


@dataclass(frozen=True)
class Walls(MapStage):
    """Close gaps between vertical patches, along x and y and within a cell."""

    name: ClassVar[str] = "walls"

    height_thresh: float = parameter(
        0.5, "greatest vertical distance of two wall patches over their horizontal distance", low=0
    )
    max_gap: Length = parameter(
        Cells(1),
        "widest gap that is surely closed; its patches are plastered",
        low=0,
        default_from="vehicle.width",
    )
    max_gap_enhanced: Length = parameter(
        Cells(5),
        "widest gap that is closed at all; patches in gaps wider than max_gap are artificial; "
        "0: no second pass",
        low=0,
    )

    def faults(self, cell_size: float | None, gap_size: Length | None) -> Iterator[Fault]:
        """Yield a fault where the second pass would close less than the first."""
        yield from super().faults(cell_size, gap_size)
        yield from gap_faults(self.max_gap, self.max_gap_enhanced, cell_size)

    def reach(self, cell_size: float) -> int:
        """Return the widths of both passes in whole cells."""
        return whole_cells(self.max_gap, cell_size) + whole_cells(self.max_gap_enhanced, cell_size)

    def transform(self, surface: SurfaceMap) -> SurfaceMap:
        """Return the map with the gaps in its walls closed."""
        cell_size = surface.cell_size
        for widths in passes(self.max_gap, self.max_gap_enhanced):
            upright = surface.take(surface.depth > 0)
            intervals = Intervals(upright.ix, upright.iy, upright.low_end, upright.height)
            columns = close_gaps(intervals, widths, cell_size, self.height_thresh, 0.0)
            holes = fill_holes(surface, widths)
            surface = surface.with_inserted(*settle(columns, surface, holes).union(holes))
        return surface


def fill_holes(surface: SurfaceMap, widths: Widths) -> Inserted:
    """Return what fills the holes between successive vertical patches of one cell."""
    certain, allowed = (in_units(width, surface.cell_size) for width in widths)
    low, high, upright = surface.low_end, surface.height, surface.depth > 0
    same_cell = (surface.ix[1:] == surface.ix[:-1]) & (surface.iy[1:] == surface.iy[:-1])
    space = low[1:] - high[:-1]
    hole = same_cell & upright[1:] & upright[:-1]
    hole &= (space > surface.gap_size) & (space <= allowed)
    return Inserted(
        surface.ix[1:][hole],
        surface.iy[1:][hole],
        low[1:][hole],
        space[hole],
        np.where(space <= certain, PLASTERED, ARTIFICIAL).astype(np.uint8)[hole],
    )
