"""Holes in walls, which the thesis left open (its sections 3.5 and 6.3).

Two passes like plaster's, over vertical patches only. Missing columns of a wall are found by
plaster's search along +x and +y; candidates are vertical patches whose intervals
[height - depth, height] are at most ``height_thresh * d * cell_size`` apart. The tops and bottoms
of the patches that close a gap lie on straight lines. Within one cell, the space between two
successive patches that are both vertical is filled where it is more than `gap_size` and at most the
allowed length. A horizontal patch is never joined to what stands above it: the space under a bridge
stays open. The stage belongs before plaster, which then finds no gap there.

The points of a wall seldom reach its ends, and a median draws them inwards. With `join`, walls are
drawn out after both passes: down to the lowest of the lower ends that the patches of the eight
cells around have at most `join` below a wall's foot, up to the highest of their heights at most
`join` above its top, so that a wall stands on the floor beside it. Two ends in one cell that would
thus come within `gap_size` of each other stay where they are. `join` counts up to `gap_size` only,
so that nothing that a craft could pass is closed.
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
        for widths in self.passes(cell_size):
            upright = np.flatnonzero(surface.depth > 0)
            cells = OccupiedCells.of(surface.ix[upright], surface.iy[upright])
            intervals = Intervals(cells, surface.low_end[upright], surface.height[upright])
            columns = close_gaps(intervals, widths, Tolerance(cell_size, self.height_thresh))
            holes = fill_holes(surface, upright, widths)
            surface = surface.with_inserted(*settle(columns, surface, holes).union(holes))
        farthest = min(in_units(self.join, cell_size), surface.gap_size)
        return drawn_out(surface, farthest) if farthest > 0 else surface


def fill_holes(surface: SurfaceMap, upright: Int64, widths: Widths) -> Inserted:
    """Return the patches that fill holes between successive vertical patches of one cell.

    Parameters
    ----------
    surface : SurfaceMap
    upright : int64 (V,)
        The vertical patches of the map, ascending.
    widths : Widths
        The holes that are filled, by their height.
    """
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
    """Return the map with the ends of its walls moved outwards to those of the patches around.

    An end moves by at most `farthest`, in the unit of the recording.
    """
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
    """Find new ends of the vertical patches in cells `begin` to `end`.

    Parameters
    ----------
    begin, end : int
        Range of cells.
    ix, iy : int32 (C,)
        The occupied cells, ascending.
    start : int64 (C + 1,)
        Where the patches of each cell begin.
    low, high, depth : float64 (P,)
        Lower end, upper end and extent of all patches as they are.
    farthest : float
        By how much an end moves at most, in the unit of the recording.
    gap_size : float
        In the unit of the recording.
    foot, top : float64 (P,)
        Receive the lower and upper ends of the patches of these cells.
    """
    first = np.full(3, -1, dtype=np.int64)
    for cell in range(begin, end):
        x, y = np.int64(ix[cell]), np.int64(iy[cell])
        reached = -np.inf
        for i in range(start[cell], start[cell + 1]):
            lowest, highest = low[i], high[i]
            for column in range(3 if depth[i] > 0 else 0):
                # Cells are in order, so that the first one of each column only moves on.
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
            # Two ends that would meet stay where they are.
            if i > start[cell] and lowest - reached <= gap_size:
                foot[i], top[i - 1] = low[i], high[i - 1]
            reached = highest
