"""Holes in walls, which the thesis left open (its sections 3.5 and 6.3).

Two passes like plaster's, over vertical patches only. Missing columns of a wall are found by
plaster's search along +x and +y; candidates are vertical patches whose intervals
[height - depth, height] are at most ``height_thresh * d * cell_size`` apart. The tops and bottoms
of the patches that close a gap lie on straight lines. Within one cell, the space between two
successive patches that are both vertical is filled where it is more than `gap_size` and at most the
allowed length. A horizontal patch is never joined to what stands above it: the space under a bridge
stays open. The stage belongs before plaster, which then finds no gap there.

So walls that face each other would be joined, as well as two trees. With `along`, gaps are closed
only where a wall runs along them, and with `support`, high holes are filled only where the cells
around show a wall; `evidence.py` has both rules.

The points of a wall seldom reach its ends, and a median draws them inwards. With `join`, walls are
drawn out after both passes: down to the lowest of the lower ends that the patches of the eight
cells around have at most `join` below a wall's foot, up to the highest of their heights at most
`join` above its top, so that a wall stands on the floor beside it. Two ends in one cell that would
thus come within `gap_size` of each other stay where they are. `join` counts up to `gap_size` only,
so that nothing that a craft could pass is closed.

With `pieces`, before all else, what `gap_size` has split of a wall becomes one patch again; the
rule stands in `pieces.py`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from mlscli.maps.neighbours import sought
from mlscli.maps.order import OccupiedCells
from mlscli.maps.surface_map import ARTIFICIAL, PLASTERED, SurfaceMap
from mlscli.parameters.fields import parameter
from mlscli.parameters.lengths import Cells, Length, in_units, whole_cells
from mlscli.pipeline.stages.evidence import lies_in_wall, run_along
from mlscli.pipeline.stages.gaps import (
    Gaps,
    GapStage,
    Intervals,
    Judge,
    Tolerance,
    Widths,
    close_gaps,
)
from mlscli.pipeline.stages.inserted import Inserted, settle
from mlscli.pipeline.stages.pieces import ROUNDS, joined
from mlscli.runtime.arrays import Bool, Float64, Int32, Int64, UInt8, frozen
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

    along: Length = parameter(
        0,
        "gaps are closed only where the wall runs along them at both ends, judged by the cells up "
        "to so far behind and beside each end; 0: however it runs",
        low=0,
    )
    support: int = parameter(
        0,
        "holes higher than max_gap are filled only where, of the eight cells around, so many hold "
        "a wall beside more than half of the hole",
        low=0,
        high=8,
    )

    pieces: Length | None = parameter(
        0,
        "pieces of a wall in a cell, up to so far apart, become one patch where a wall goes on "
        "beside them; null: vehicle.height, at most 1.5 cells; 0: none",
        low=0,
        default_from="vehicle.height",
        at_most=Cells(1.5),
    )

    def reach(self, cell_size: float) -> int:
        """Return the widths of both passes in whole cells, and what is looked at beyond them.

        These are the cells behind the ends of a gap or around a hole, in each pass, and the cells
        around what is drawn out or joined.
        """
        beyond = whole_cells(self.along, cell_size) * len(list(self.passes(cell_size)))
        drawn = in_units(self.join, cell_size) > 0
        rounds = ROUNDS if self._farthest(cell_size) > 0 else 0
        return super().reach(cell_size) + max(beyond, self.support > 0) + drawn + rounds

    def for_gaps(self, gap_size: float, cell_size: float) -> Self:
        """Return the stage without `pieces` where none lie so far apart: it reaches less far."""
        splits = self._farthest(cell_size) > gap_size
        return self if splits else replace(self, pieces=0)

    def _farthest(self, cell_size: float) -> float:
        """Return how far apart pieces of a wall are at most, in the unit of the recording."""
        return 0.0 if self.pieces is None else in_units(self.pieces, cell_size)

    def transform(self, surface: SurfaceMap) -> SurfaceMap:
        """Return the map with the gaps in its walls closed."""
        cell_size = surface.cell_size
        surface = joined(surface, self._farthest(cell_size))
        if not (surface.depth > 0).any():
            return surface
        tolerance = Tolerance(cell_size, self.height_thresh)
        for widths in self.passes(cell_size):
            walls = upright(surface)
            columns = close_gaps(walls, widths, tolerance, self._judge(walls, cell_size))
            holes = fill_holes(surface, widths, walls, self.support)
            surface = surface.with_inserted(*settle(columns, surface, holes).union(holes))
        farthest = min(in_units(self.join, cell_size), surface.gap_size)
        return drawn_out(surface, farthest) if farthest > 0 else surface

    def _judge(self, walls: Intervals, cell_size: float) -> Judge | None:
        """Return what tells where walls run along a gap; None: nobody asks."""
        farthest = whole_cells(self.along, cell_size)
        if not farthest:
            return None

        def judge(gaps: Gaps) -> Bool:
            holds: Bool = run_along(*gaps, walls.cells.start, walls.low, walls.high, farthest)
            return holds

        return judge


def upright(surface: SurfaceMap) -> Intervals:
    """Return the vertical patches of a map."""
    which = np.flatnonzero(surface.depth > 0)
    high = surface.height[which]
    cells = OccupiedCells.of(surface.ix[which], surface.iy[which])
    return Intervals(cells, frozen(high - surface.depth[which]), frozen(high))


def fill_holes(surface: SurfaceMap, widths: Widths, walls: Intervals, support: int) -> Inserted:
    """Return the patches that fill holes between successive vertical patches of one cell.

    Parameters
    ----------
    surface : SurfaceMap
    widths : Widths
        The holes that are filled, by their height.
    walls : Intervals
        The vertical patches.
    support : int
        Holes that are not surely filled need so many cells around them that show a wall.
    """
    certain, allowed = (in_units(width, surface.cell_size) for width in widths)
    sizes = surface.gap_size, certain, allowed
    return Inserted(*_holes(surface.cells, surface.height, surface.depth, walls, *sizes, support))


@kernel
def _holes(
    cells: OccupiedCells,
    height: Float64,
    depth: Float64,
    walls: Intervals,
    gap_size: float,
    certain: float,
    allowed: float,
    support: int,
) -> tuple[Int32, Int32, Float64, Float64, UInt8]:
    """Return what fills the holes between vertical patches, as the columns of `Inserted`.

    Parameters
    ----------
    cells : OccupiedCells
        The cells, and where their patches begin.
    height, depth : float64 (P,)
        Of all patches.
    walls : Intervals
        The vertical patches.
    gap_size, certain, allowed : float
        Holes are larger than the first and at most as large as the last; those no larger than
        `certain` are surely filled. In the unit of the recording.
    support : int
        As in `fill_holes`.
    """
    most = len(height) - len(cells.ix)
    ix, iy = np.empty(most, dtype=np.int32), np.empty(most, dtype=np.int32)
    top, space, origin = np.empty(most), np.empty(most), np.empty(most, dtype=np.uint8)
    n = 0
    for cell in range(len(cells.ix)):
        x, y = int(cells.ix[cell]), int(cells.iy[cell])
        for i in range(cells.start[cell] + 1, cells.start[cell + 1]):
            low, high = height[i - 1], height[i] - depth[i]
            if not (depth[i - 1] > 0 and depth[i] > 0 and gap_size < high - low <= allowed):
                continue
            sure = high - low <= certain
            if sure or lies_in_wall(x, y, low, high, walls, support):
                ix[n], iy[n], top[n], space[n] = x, y, high, high - low
                origin[n] = PLASTERED if sure else ARTIFICIAL
                n += 1
    return ix[:n], iy[:n], top[:n], space[:n], origin[:n]


def drawn_out(surface: SurfaceMap, farthest: float) -> SurfaceMap:
    """Return the map with the ends of its walls moved outwards to those of the patches around.

    An end moves by at most `farthest`, in the unit of the recording.
    """
    low = surface.low_end
    foot, top = low.copy(), surface.height.copy()

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
