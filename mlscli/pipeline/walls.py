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
from numba import njit

from mlscli.parameters import Length, in_units, parameter
from mlscli.pipeline.gaps import (
    GapStage,
    Inserted,
    Intervals,
    Tolerance,
    Widths,
    close_gaps,
    settle,
)
from mlscli.pipeline.neighbours import shifted
from mlscli.surface_map import ARTIFICIAL, PLASTERED, SurfaceMap
from mlscli.typing import Float64, Int32, Int64


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
        for widths in self.passes():
            upright = surface.take(surface.depth > 0)
            intervals = Intervals(upright.ix, upright.iy, upright.low_end, upright.height)
            columns = close_gaps(intervals, widths, cell_size, Tolerance(self.height_thresh))
            holes = fill_holes(surface, widths)
            surface = surface.with_inserted(*settle(columns, surface, holes).union(holes))
        farthest = min(in_units(self.join, cell_size), surface.gap_size)
        return drawn_out(surface, farthest) if farthest > 0 else surface


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


def drawn_out(surface: SurfaceMap, farthest: float) -> SurfaceMap:
    """Return the map with the ends of its walls moved outwards to those of the patches around."""
    foot, top = _ends_around(*surface.cells, surface.low_end, surface.height, farthest)
    upright = surface.depth > 0
    foot = np.where(upright, foot, surface.low_end)
    top = np.where(upright, top, surface.height)
    same_cell = (surface.ix[1:] == surface.ix[:-1]) & (surface.iy[1:] == surface.iy[:-1])
    meeting = np.flatnonzero(same_cell & (foot[1:] - top[:-1] <= surface.gap_size))
    top[meeting], foot[meeting + 1] = surface.height[meeting], surface.low_end[meeting + 1]
    moved = (foot < surface.low_end) | (top > surface.height)
    return surface.with_columns(height=top, depth=np.where(moved, top - foot, surface.depth))


@njit(cache=True, nogil=True)
def _ends_around(
    ix: Int32, iy: Int32, start: Int64, low: Float64, high: Float64, farthest: float
) -> tuple[Float64, Float64]:
    """Return for each patch the lowest and the highest end around, no farther off than allowed."""
    foot, top = low.copy(), high.copy()
    for dx in (-1, 0, 1):
        for dy in (-1, 0, 1):
            around = shifted(ix, iy, dx, dy)
            for cell in range(len(ix)):
                there = around[cell]
                if there < 0 or there == cell:
                    continue
                for i in range(start[cell], start[cell + 1]):
                    for j in range(start[there], start[there + 1]):
                        if low[i] - low[j] <= farthest:
                            foot[i] = min(foot[i], low[j])
                        if high[j] - high[i] <= farthest:
                            top[i] = max(top[i], high[j])
    return foot, top
