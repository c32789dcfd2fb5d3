"""Gaps between patches along x and y, and the patches that close them.

Plaster closes gaps between heights, walls gaps between vertical intervals; a height is an
interval without extent, so that one search serves both. It runs along lines of cells: the columns
of the grid first, then, with x and y swapped, its rows. Both directions read the same input.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from mlscli.cells import pack, unpack
from mlscli.parameters import Cells, Length, comparable, in_units, parameter, whole_cells
from mlscli.patches import distance, runs, within_gap
from mlscli.pipeline.stage import Fault, MapStage
from mlscli.surface_map import ARTIFICIAL, PLASTERED, SurfaceMap
from mlscli.typing import Array, Bool, Float64, Int32, Int64, UInt8


@dataclass(frozen=True)
class GapStage(MapStage):
    """A stage that closes gaps in two passes: up to `max_gap`, then up to `max_gap_enhanced`."""

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
        widths = self.max_gap, self.max_gap_enhanced
        if in_units(self.max_gap_enhanced, 1.0) == 0 or (
            cell_size is None and not comparable(*widths)
        ):
            return
        first, second = (in_units(width, cell_size or 1.0) for width in widths)
        if second < first:
            yield Fault(
                "max_gap_enhanced",
                f"{self.max_gap_enhanced} is less than max_gap ({self.max_gap}); at least that, "
                "or 0 for none",
            )

    def reach(self, cell_size: float) -> int:
        """Return the widths of both passes in whole cells."""
        return whole_cells(self.max_gap, cell_size) + whole_cells(self.max_gap_enhanced, cell_size)

    def passes(self) -> Iterator[Widths]:
        """Yield the widths of pass one, and of pass two where there is one."""
        yield Widths(self.max_gap, self.max_gap)
        if in_units(self.max_gap_enhanced, 1.0) > 0:
            yield Widths(self.max_gap, self.max_gap_enhanced)


class Intervals(NamedTuple):
    """What gaps are sought between: vertical intervals in cells."""

    ix: Int32
    iy: Int32
    low: Float64
    high: Float64


class Inserted(NamedTuple):
    """Patches to be put into a map."""

    ix: Int32
    iy: Int32
    height: Float64
    depth: Float64
    origin: UInt8

    @property
    def low_end(self) -> Float64:
        """Lower end of each patch."""
        return self.height - self.depth

    def take(self, which: Bool | Int64) -> Inserted:
        """Return the patches that a mask or indices choose."""
        columns: list[Any] = [column[which] for column in self]
        return Inserted(*columns)

    def union(self, other: Inserted) -> Inserted:
        """Return the patches of both."""
        pairs: list[Any] = list(zip(self, other, strict=True))
        return Inserted(*map(np.concatenate, pairs))


class Widths(NamedTuple):
    """The gaps that a pass closes.

    Attributes
    ----------
    certain : Length
        Patches in gaps at most so wide are plastered, in wider ones artificial.
    allowed : Length
        Wider gaps stay open.
    """

    certain: Length
    allowed: Length


class Tolerance(NamedTuple):
    """How far apart two ends of a gap of d - 1 cells may be in height.

    ``slope * min(d, trusted) * cell_size + clearance``, d cells from each other.

    Attributes
    ----------
    slope : float
    clearance : float
    trusted : float
        The number of cells beyond which the slope counts no more.
    """

    slope: float
    clearance: float = 0.0
    trusted: float = np.inf


def close_gaps(
    intervals: Intervals, widths: Widths, cell_size: float, tolerance: Tolerance
) -> Inserted:
    """Return what closes the gaps along x and along y.

    From each interval one looks along a line at distances d = 1, 2, ... cells. Those there that
    are near enough in height are candidates; the first d with one decides, and of several the
    one at the least distance, then with the least difference of upper ends, then the higher. A gap
    is closed where both of its ends find each other so.
    """
    certain, allowed = (whole_cells(width, cell_size) for width in widths)
    along_y = _close_along(*intervals, certain, allowed, cell_size, tolerance)
    swapped = intervals._replace(ix=intervals.iy, iy=intervals.ix)
    along_x = _close_along(*swapped, certain, allowed, cell_size, tolerance)
    return along_y.union(along_x._replace(ix=along_x.iy, iy=along_x.ix))


def _close_along(
    line: Int32,
    position: Int32,
    low: Float64,
    high: Float64,
    certain: int,
    allowed: int,
    cell_size: float,
    tolerance: Tolerance,
) -> Inserted:
    order = np.lexsort((low, high, position, line))
    keys = pack(line[order], position[order])
    start = runs(keys)
    lines, positions = (index.astype(np.int64) for index in unpack(keys[start[:-1]]))
    low, high = low[order], high[order]
    cells = (lines, positions, start, low, high)
    ahead = _opposite(*cells, allowed + 1, cell_size, *tolerance, 1)
    back = _opposite(*cells, allowed + 1, cell_size, *tolerance, -1)
    in_line, at, height, low_end, width = _fill(lines, positions, start, low, high, ahead, back)
    return Inserted(
        in_line,
        at,
        height,
        height - low_end,
        np.where(width <= certain, PLASTERED, ARTIFICIAL).astype(np.uint8),
    )


@njit(cache=True, nogil=True)
def _opposite(
    line: Int64,
    position: Int64,
    start: Int64,
    low: Float64,
    high: Float64,
    farthest: int,
    cell_size: float,
    slope: float,
    clearance: float,
    trusted: float,
    step: int,
) -> Int64:
    """Return for each interval the one that it finds along its line; -1: none."""
    found = np.full(len(low), -1, dtype=np.int64)
    for cell in range(len(line)):
        for i in range(start[cell], start[cell + 1]):
            there = cell + step
            while 0 <= there < len(line) and line[there] == line[cell] and found[i] < 0:
                d = abs(position[there] - position[cell])
                if d > farthest:
                    break
                limit = slope * min(d, trusted) * cell_size + clearance
                least, least_tops = np.inf, np.inf
                for j in range(start[there], start[there + 1]):
                    apart = distance(low[i], high[i], low[j], high[j])
                    tops = abs(high[j] - high[i])
                    # Upper ends ascend in a cell: of equal candidates the later is the higher.
                    nearer = apart < least or (apart == least and tops <= least_tops)
                    if apart <= limit and nearer:
                        found[i], least, least_tops = j, apart, tops
                there += step
    return found


@njit(cache=True, nogil=True)
def _fill(
    line: Int64,
    position: Int64,
    start: Int64,
    low: Float64,
    high: Float64,
    ahead: Int64,
    back: Int64,
) -> tuple[Int32, Int32, Float64, Float64, Int64]:
    """Return cells, both ends and gap widths of what fills the gaps found from both ends."""
    cell_of = np.empty(len(low), dtype=np.int64)
    for cell in range(len(line)):
        cell_of[start[cell] : start[cell + 1]] = cell
    size = 0
    for near in range(len(low)):
        far = ahead[near]
        if far >= 0 and back[far] == near:
            size += position[cell_of[far]] - position[cell_of[near]] - 1
    in_line = np.empty(size, dtype=np.int32)
    at = np.empty(size, dtype=np.int32)
    width = np.empty(size, dtype=np.int64)
    height, low_end = np.empty((2, size))
    n = 0
    for near in range(len(low)):
        far = ahead[near]
        if far < 0 or back[far] != near:
            continue
        begin = position[cell_of[near]]
        d = position[cell_of[far]] - begin
        for k in range(1, d):
            in_line[n], at[n], width[n] = line[cell_of[near]], begin + k, d - 1
            height[n] = between(high[near], high[far], k, d)
            low_end[n] = between(low[near], low[far], k, d)
            n += 1
    return in_line, at, height, low_end, width


@njit(cache=True, nogil=True)
def between(near: float, far: float, k: int, d: int) -> float:
    """Return the height k of d steps along the line from near to far; the same read backwards."""
    height = (near * (d - k) + far * k) / d
    # Adding 0 keeps a sum that underflows from being -0.
    return min(max(height, min(near, far)), max(near, far)) + 0.0


def settle(inserted: Inserted, surface: SurfaceMap, holes: Inserted | None = None) -> Inserted:
    """Return the inserted patches that find room.

    None may be within `gap_size` of a patch that its cell has, or of what is filled into a hole
    of that cell. Where several meet, the highest stays (equal: the lower origin, then the greater
    depth), then going down the next that is more than `gap_size` below the last that stayed: the
    highest is the nearest obstacle to a craft above.
    """
    order = np.lexsort(
        (-inserted.depth, inserted.origin, -inserted.height, inserted.iy, inserted.ix)
    )
    inserted = inserted.take(order)
    for there in (surface, holes):
        if there is not None:
            inserted = inserted.take(~_near(inserted, there, surface.gap_size))
    keys = pack(inserted.ix, inserted.iy)
    return inserted.take(_from_above(keys, inserted.low_end, inserted.height, surface.gap_size))


def _near(inserted: Inserted, there: Inserted | SurfaceMap, gap_size: float) -> Bool:
    keys = pack(there.ix, there.iy)
    start = runs(keys)
    near: Bool = within_gap(
        pack(inserted.ix, inserted.iy),
        inserted.low_end,
        inserted.height,
        keys[start[:-1]],
        start,
        there.low_end,
        there.height,
        gap_size,
    )
    return near


@njit(cache=True, nogil=True)
def _from_above(keys: Array, low: Float64, high: Float64, gap_size: float) -> Bool:
    stays = np.zeros(len(keys), dtype=np.bool_)
    last = 0
    for i in range(len(keys)):
        if i == 0 or keys[i] != keys[last] or low[last] - high[i] > gap_size:
            stays[i] = True
            last = i
    return stays
