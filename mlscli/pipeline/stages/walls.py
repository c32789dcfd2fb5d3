"""Holes in walls, which the thesis left open (its sections 3.5 and 6.3).

Two passes like plaster's, over vertical patches only. Where columns of a wall are missing, the
search along +x and +y is plaster's, with the distance of the intervals [height - depth, height],
at most ``height_thresh * d * cell_size``; tops and bottoms run on straight lines. Within one
cell, the space between two successive patches that are both vertical is filled where it is more
than `gap_size` and at most the allowed length. A horizontal patch is never joined to what stands
above it: the space under a bridge stays open. The stage belongs before plaster, which then finds
no gap there.

The points of a wall seldom reach its ends, and a median draws them inwards. With `join`, a wall is
drawn out in the end: down to the lowest of the lower ends that the patches of the eight cells
around have at most `join` below it, up to the highest of their heights at most `join` above it,
so that it stands on the floor beside it. Two ends in one cell that would so come within
`gap_size` of each other stay. It never closes what a craft could pass: `join` counts no farther
than `gap_size`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from mlscli.maps.neighbours import sought
from mlscli.maps.order import OccupiedCells
from mlscli.maps.surface_map import ARTIFICIAL, PLASTERED, SurfaceMap
from mlscli.parameters.fields import parameter
from mlscli.parameters.lengths import Length, in_units
from mlscli.pipeline.stages.gaps import GapStage, Intervals, Tolerance, Widths, close_gaps
from mlscli.pipeline.stages.inserted import Inserted, settle
from mlscli.runtime.arrays import Float64, Int32, Int64
from mlscli.runtime.kernels import kernel
from mlscli.runtime.threads import LIGHT, in_ranges


@dataclass(frozen=True)
class Walls(GapStage):
    """Close gaps between vertical patches, along x and y and within a cell."""

    name: ClassVar[str] = "walls"

    height_thresh: float = parameter(
        0.5, "greatest vertical distance of two wall patches over their horizontal distance", low=0
    )
    join: Length = parameter(
        0,
        "walls are drawn out to the ends of the patches around them, by at most so much and never "
        "more than gap_size; 0: not",
        low=0,
    )

    def reach(self, cell_size: float) -> int:
        """Return the widths of both passes in whole cells, and one more where walls are joined."""
        return super().reach(cell_size) + (in_units(self.join, cell_size) > 0)

    def transform(self, surface: SurfaceMap) -> SurfaceMap:
        """Return the map with the gaps in its walls closed."""
        cell_size = surface.cell_size
        if not (surface.depth > 0).any():
            return surface
        for widths in self.passes():
            upright = np.flatnonzero(surface.depth > 0)
            cells = OccupiedCells.of(surface.ix[upright], surface.iy[upright])
            intervals = Intervals(cells, surface.low_end[upright], surface.height[upright])
            columns = close_gaps(intervals, widths, Tolerance(cell_size, self.height_thresh))
            holes = fill_holes(surface, upright, widths)
            surface = surface.with_inserted(*settle(columns, surface, holes).union(holes))
        farthest = min(in_units(self.join, cell_size), surface.gap_size)
        return drawn_out(surface, farthest) if farthest > 0 else surface


def fill_holes(surface: SurfaceMap, upright: Int64, widths: Widths) -> Inserted:
    """Return what fills the holes between successive vertical patches of one cell."""
    certain, allowed = (in_units(width, surface.cell_size) for width in widths)
    lower, upper = upright[:-1], upright[1:]
    space = surface.low_end[upper] - surface.height[lower]
    hole = (upper == lower + 1) & (space > surface.gap_size) & (space <= allowed)
    hole &= (surface.ix[lower] == surface.ix[upper]) & (surface.iy[lower] == surface.iy[upper])
    upper, space = upper[hole], space[hole]
    return Inserted(
        surface.ix[upper],
        surface.iy[upper],
        surface.low_end[upper],
        space,
        np.where(space <= certain, PLASTERED, ARTIFICIAL).astype(np.uint8),
    )


def drawn_out(surface: SurfaceMap, farthest: float) -> SurfaceMap:
    """Return the map with the ends of its walls moved outwards to those of the patches around."""
    low, foot, top = surface.low_end, surface.low_end, surface.height.copy()

    def draw(begin: int, end: int) -> None:
        _draw_out(
            begin, end, *surface.cells, low, surface.height, surface.depth,
            farthest, surface.gap_size, foot, top,
        )  # fmt: skip

    in_ranges(len(surface.cells.ix), draw, weight=LIGHT)
    moved = (foot < low) | (top > surface.height)
    if not moved.any():
        return surface
    return surface.with_columns(height=top, depth=np.where(moved, top - foot, surface.depth))


@kernel
def _draw_out(
    begin: int,
    end: int,
    ix: Int32,
    iy: Int32,
    start: Int64,
    low: Float64,
    high: Float64,
    depth: Float64,
    farthest: float,
    gap_size: float,
    foot: Float64,
    top: Float64,
) -> None:
    """Move the ends of vertical patches in cells `begin` to `end`, in `foot` and `top`."""
    first = np.full(3, -1, dtype=np.int64)
    for cell in range(begin, end):
        x, y = np.int64(ix[cell]), np.int64(iy[cell])
        reached = -np.inf
        for i in range(start[cell], start[cell + 1]):
            lowest, highest = low[i], high[i]
            for column in range(3 if depth[i] > 0 else 0):
                # The cells of a column follow each other: what comes before them only moves on.
                there = sought(ix, iy, first[column], x + column - 1, y - 1)
                first[column] = there
                while there < len(ix) and ix[there] == x + column - 1 and iy[there] <= y + 1:
                    for j in range(start[there], start[there + 1]):
                        if there != cell and low[i] - low[j] <= farthest:
                            lowest = min(lowest, low[j])
                        if there != cell and high[j] - high[i] <= farthest:
                            highest = max(highest, high[j])
                    there += 1
            foot[i], top[i] = lowest, highest
            # Two ends that would meet stay.
            if i > start[cell] and lowest - reached <= gap_size:
                foot[i], top[i - 1] = low[i], high[i - 1]
            reached = highest
