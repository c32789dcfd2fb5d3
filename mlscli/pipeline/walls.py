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

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from mlscli.parameters import in_units, parameter
from mlscli.pipeline.gaps import (
    GapStage,
    Inserted,
    Intervals,
    Widths,
    close_gaps,
    settle,
)
from mlscli.surface_map import ARTIFICIAL, PLASTERED, SurfaceMap


@dataclass(frozen=True)
class Walls(GapStage):
    """Close gaps between vertical patches, along x and y and within a cell."""

    name: ClassVar[str] = "walls"

    height_thresh: float = parameter(
        0.5, "greatest vertical distance of two wall patches over their horizontal distance", low=0
    )

    def transform(self, surface: SurfaceMap) -> SurfaceMap:
        """Return the map with the gaps in its walls closed."""
        cell_size = surface.cell_size
        for widths in self.passes():
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
