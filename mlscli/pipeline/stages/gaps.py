"""Gaps between patches along x and y, and the patches that close them.

Plaster closes gaps between heights, walls gaps between vertical intervals; a height is an
interval without extent, so that one search serves both. It runs along lines of cells: the columns
of the grid first, then, with x and y swapped, its rows. Both directions read the same input. What a
stage asks of a gap beyond that stands in `evidence.py`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mlscli.maps.neighbours import links
from mlscli.maps.order import OccupiedCells
from mlscli.maps.patches import distance
from mlscli.maps.surface_map import ARTIFICIAL, PLASTERED
from mlscli.parameters.fields import fields_of, parameter
from mlscli.parameters.lengths import Cells, Length, exceeds, in_units, whole_cells
from mlscli.pipeline.stages.inserted import Inserted
from mlscli.pipeline.stages.stage import Fault, MapStage
from mlscli.runtime.arrays import Bool, Float64, Int32, Int64, UInt8
from mlscli.runtime.kernels import inner, kernel
from mlscli.runtime.threads import LIGHT, in_ranges

# The width of the craft where nothing is said of it.
_CRAFT = Cells(1)


@dataclass(frozen=True)
class GapStage(MapStage):
    """A stage that closes gaps in two passes: up to `max_gap`, then up to `max_gap_enhanced`."""

    max_gap: Length | None = parameter(
        None,
        "widest gap that is surely closed; its patches are plastered",
        low=0,
        default_from="vehicle.width",
    )
    max_gap_enhanced: Length | None = parameter(
        None,
        "widest gap that is closed at all; patches in gaps wider than max_gap are artificial; "
        "0: no second pass",
        low=0,
        default_from="max_gap",
        at_least=Cells(5),
    )

    def faults(self, cell_size: float | None, gap_size: Length | None) -> Iterator[Fault]:
        """Yield a fault where the second pass would close less than the first."""
        yield from super().faults(cell_size, gap_size)
        if self.max_gap is None or self.max_gap_enhanced is None:
            return
        has_second = in_units(self.max_gap_enhanced, 1.0) > 0
        if has_second and exceeds(self.max_gap, self.max_gap_enhanced, cell_size):
            yield Fault(
                "max_gap_enhanced",
                f"{self.max_gap_enhanced} is less than max_gap ({self.max_gap}); at least that, "
                "or 0 for none",
            )

    def reach(self, cell_size: float) -> int:
        """Return the widths of both passes in whole cells."""
        return sum(whole_cells(width, cell_size) for width in self._widths(cell_size))

    def passes(self, cell_size: float) -> Iterator[Widths]:
        """Yield the widths of pass one, and of pass two where there is one."""
        widths = self._widths(cell_size)
        yield Widths(widths.certain, widths.certain)
        if in_units(widths.allowed, 1.0) > 0:
            yield widths

    def _widths(self, cell_size: float) -> Widths:
        """Return both widths; those not given as they are for a craft as wide as a cell."""
        certain = _CRAFT if self.max_gap is None else self.max_gap
        allowed = self.max_gap_enhanced
        if allowed is None:
            followed = fields_of(type(self))["max_gap_enhanced"]
            allowed = followed.following(certain, cell_size)
        return Widths(certain, allowed)


class Intervals(NamedTuple):
    """Vertical intervals in cells, in the file's order: the ends of possible gaps.

    Attributes
    ----------
    cells : OccupiedCells
        The cells that hold intervals, and where their intervals begin.
    low, high : float64 (P,)
        Lower and upper end of each interval, in the unit of the recording; read-only.
    """

    cells: OccupiedCells
    low: Float64
    high: Float64


class Widths(NamedTuple):
    """The gaps that a pass closes.

    Attributes
    ----------
    certain : Length
        The widest gap whose patches are plastered; in wider ones they are artificial.
    allowed : Length
        The widest gap that is closed.
    """

    certain: Length
    allowed: Length


class Tolerance(NamedTuple):
    """How far apart in height the two ends of a gap may be.

    For ends that are d cells apart, ``slope * min(d, trusted) * cell_size + clearance``.

    Attributes
    ----------
    cell_size : float
        Side of a cell, in the unit of the recording.
    slope : float
        Rise over run.
    clearance : float
        Allowed at any distance, in the unit of the recording.
    trusted : float
        The number of cells beyond which the slope allows no more height.
    """

    cell_size: float
    slope: float
    clearance: float = 0.0
    trusted: float = np.inf


class Lines(NamedTuple):
    """The C occupied cells, along lines of the grid.

    Attributes
    ----------
    line : int32 (C,)
        The index that the cells of a line share: `ix` for columns, `iy` for rows.
    position : int32 (C,)
        The other index.
    after, before : int32 (C,)
        Number of the next and of the previous cell of the line; -1: none.
    """

    line: Int32
    position: Int32
    after: Int32
    before: Int32


class Gaps(NamedTuple):
    """Gaps whose ends have found each other along lines of one direction.

    Attributes
    ----------
    pairs : int64 (G, 4)
        Cell and interval of the near end, and cell and interval of the far end.
    lines, across : Lines
        The cells along these lines, and along those of the other direction.
    certain : int
        The widest gap that is surely closed, in cells.
    """

    pairs: Int64
    lines: Lines
    across: Lines
    certain: int


# Tells which gaps are closed, bool (G,).
Judge = Callable[[Gaps], Bool]

# Tells which patches close gaps indeed, bool (N,); given are the gap of each, int64 (N,), and
# the patches (N,).
Witness = Callable[[Int64, Inserted], Bool]


def close_gaps(
    intervals: Intervals,
    widths: Widths,
    tolerance: Tolerance,
    judge: Judge | None = None,
    witness: Witness | None = None,
) -> Inserted:
    """Return the patches that close the gaps along x and along y, in no particular order.

    From each interval the search goes along a line at distances d = 1, 2, ... cells. The intervals
    there that are near enough in height are candidates. The first d with a candidate decides; of
    several candidates, the one at the least distance, then with the least difference of upper ends,
    then the higher. A gap is closed where its two ends find each other, and the judge and the
    witness, if there are any, agree.

    Parameters
    ----------
    intervals : Intervals
        The ends of possible gaps.
    widths : Widths
    tolerance : Tolerance
    judge : callable, optional
        Tells which gaps, as `Gaps`, are closed, bool (G,); by default all are. Several threads ask
        it, each of some gaps.
    witness : callable, optional
        Tells which of the patches that would close gaps do so. It is asked once, of all gaps to
        which the judge agrees.
    """
    (ix, iy, _), ends = intervals.cells, intervals[1:]
    after, before, after_in_row, before_in_row = links(ix, iy)
    columns, rows = Lines(ix, iy, after, before), Lines(iy, ix, after_in_row, before_in_row)
    asked = intervals, widths, tolerance, judge
    along_y, along_x = _pairs_along(columns, rows, *asked), _pairs_along(rows, columns, *asked)
    pairs = np.concatenate((along_y, along_x))
    filled = _fill(pairs, ix, iy, *ends, whole_cells(widths.certain, tolerance.cell_size))
    gap, inserted = filled[0], Inserted(*filled[1:])
    return inserted if witness is None or not len(gap) else inserted.take(witness(gap, inserted))


def _pairs_along(
    lines: Lines,
    across: Lines,
    intervals: Intervals,
    widths: Widths,
    tolerance: Tolerance,
    judge: Judge | None,
) -> Int64:
    """Return the gaps along lines whose ends have found each other, and to which the judge agrees.

    Parameters
    ----------
    lines, across : Lines
        The cells along these lines, and along those of the other direction.
    intervals, widths, tolerance, judge
        As in `close_gaps`.

    Returns
    -------
    int64 (G, 4)
        As in `Gaps`.
    """
    (_, _, start), low, high = intervals
    certain, allowed = (whole_cells(width, tolerance.cell_size) for width in widths)

    def seek(begin: int, end: int) -> Int64:
        pairs: Int64 = _pairs(begin, end, lines, start, low, high, allowed + 1, tolerance)
        if judge is None or not len(pairs):
            return pairs
        return pairs[judge(Gaps(pairs, lines, across, certain))]

    return np.concatenate(in_ranges(len(lines.line), seek, weight=LIGHT))


@kernel
def _pairs(
    begin: int,
    end: int,
    lines: Lines,
    start: Int64,
    low: Float64,
    high: Float64,
    farthest: int,
    tolerance: Tolerance,
) -> Int64:
    """Return the gaps that begin in cells `begin` to `end`.

    Parameters
    ----------
    begin, end : int
        Range of cells.
    lines : Lines
        The cells along lines of one direction.
    start : int64 (C + 1,)
        Where the intervals of each cell begin.
    low, high : float64 (P,)
        Lower and upper ends of the intervals.
    farthest : int
        Greatest distance of the two ends of a gap, in cells.
    tolerance : Tolerance

    Returns
    -------
    int64 (G, 4)
        Cell and interval of the near end, and cell and interval of the far end.
    """
    position, after, before = lines.position, lines.after, lines.before
    pairs = np.empty((start[end] - start[begin], 4), dtype=np.int64)
    n = 0
    step = _limit(tolerance, 1)
    for cell in range(begin, end):
        there = after[cell]
        if there < 0 or position[there] - position[cell] > farthest:
            continue
        beside = range(start[there], start[there + 1])
        if position[there] - position[cell] > 1:
            beside = range(0)
        for near in range(start[cell], start[cell + 1]):
            # Mostly the next cell has a candidate: then there is no gap, and no need to search.
            gap = True
            for j in beside:
                gap &= distance(low[near], high[near], low[j], high[j]) > step
            if not gap:
                continue
            there, far = _opposite(
                cell, near, after, position, start, low, high, farthest, tolerance
            )
            if far < 0:
                continue
            _, back = _opposite(there, far, before, position, start, low, high, farthest, tolerance)
            if back == near:
                pairs[n, 0], pairs[n, 1], pairs[n, 2], pairs[n, 3] = cell, near, there, far
                n += 1
    return pairs[:n].copy()


@inner
def _limit(tolerance: Tolerance, d: int) -> float:
    """Return how far apart two intervals may be, d cells from each other."""
    reach = min(d, tolerance.trusted)
    return tolerance.slope * reach * tolerance.cell_size + tolerance.clearance


@inner
def _opposite(
    cell: int,
    i: int,
    following: Int32,
    position: Int32,
    start: Int64,
    low: Float64,
    high: Float64,
    farthest: int,
    tolerance: Tolerance,
) -> tuple[int, int]:
    """Return the cell and the interval that an interval finds along its line; -1, -1: none.

    Parameters
    ----------
    cell, i : int
        A cell, and the interval in it that searches.
    following : int32 (C,)
        The cell that follows each cell in the direction of the search; -1: none.
    position : int32 (C,)
        Position of each cell along its line.
    start : int64 (C + 1,)
        Where the intervals of each cell begin.
    low, high : float64 (P,)
        Lower and upper ends of the intervals.
    farthest : int
        Greatest distance, in cells.
    tolerance : Tolerance
    """
    there = following[cell]
    while there >= 0:
        d = abs(position[there] - position[cell])
        if d > farthest:
            break
        limit = _limit(tolerance, d)
        found, least, least_tops = -1, np.inf, np.inf
        for j in range(start[there], start[there + 1]):
            apart = distance(low[i], high[i], low[j], high[j])
            if apart > limit or apart > least:
                continue
            tops = abs(high[j] - high[i])
            # Upper ends ascend in a cell; of equal ones the first is the shortest.
            higher = tops == least_tops and high[j] > high[found]
            if apart < least or tops < least_tops or higher:
                found, least, least_tops = j, apart, tops
        if found >= 0:
            return there, found
        there = following[there]
    return -1, -1


@kernel
def _fill(
    pairs: Int64, ix: Int32, iy: Int32, low: Float64, high: Float64, certain: int
) -> tuple[Int64, Int32, Int32, Float64, Float64, UInt8]:
    """Return the patches that fill gaps.

    Parameters
    ----------
    pairs : int64 (G, 4)
        As in `Gaps`.
    ix, iy : int32 (C,)
        The cells.
    low, high : float64 (P,)
        Lower and upper ends of the intervals.
    certain : int
        As in `Gaps`.

    Returns
    -------
    gap : int64 (N,)
        The gap that each patch fills.
    x, y, height, depth, origin : (N,)
        As in `Inserted`.
    """
    size = 0
    for cell, _, there, _ in pairs:
        size += (ix[there] - ix[cell]) + (iy[there] - iy[cell]) - 1
    gap, origin = np.empty(size, dtype=np.int64), np.empty(size, dtype=np.uint8)
    x, y = np.empty(size, dtype=np.int32), np.empty(size, dtype=np.int32)
    height, depth = np.empty(size), np.empty(size)
    n = 0
    for g in range(len(pairs)):
        cell, near, there, far = pairs[g]
        # One of them is 0.
        dx, dy = np.int64(ix[there]) - ix[cell], np.int64(iy[there]) - iy[cell]
        d = dx + dy
        for k in range(1, d):
            gap[n], origin[n] = g, PLASTERED if d - 1 <= certain else ARTIFICIAL
            x[n], y[n] = ix[cell] + (k if dx else 0), iy[cell] + (k if dy else 0)
            height[n] = between(high[near], high[far], k, d)
            depth[n] = height[n] - between(low[near], low[far], k, d)
            n += 1
    return gap, x, y, height, depth, origin


@inner
def between(near: float, far: float, k: int, d: int) -> float:
    """Return the height k of d steps along the line from near to far; the same read from far."""
    height = (near * (d - k) + far * k) / d
    # Adding 0 keeps a sum that underflows from being -0.
    return min(max(height, min(near, far)), max(near, far)) + 0.0
