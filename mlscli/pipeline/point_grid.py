"""Points in square columns, in which those near a place are found.

No two points within the radius of each other lie in columns that do not touch. Where points are
dense, a column is divided: into so many fine columns that each holds about `_IN_EACH`. In a fine
column points ascend by height.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mlscli.cells import pack
from mlscli.kernels import kernel
from mlscli.pipeline.ordering import cells_of, order_by_cell
from mlscli.threads import in_ranges
from mlscli.typing import Array, Float64, Int32, Int64, UInt64

_IN_EACH = 5
# A fine column with more points than these is entered where heights begin to be near.
_SHORT = 8


class PointGrid(NamedTuple):
    """Points by column and fine column.

    Attributes
    ----------
    side : float
        Of a column, in the unit of the points.
    keys : uint64 (C,)
        Packed indices of the columns that hold points, ascending.
    start : int64 (C + 1,)
        Where the points of each begin.
    divisions : int64 (C,)
        Into how many parts each is divided along x, and along y.
    first : int64 (C + 1,)
        The number of the first fine column of each; they follow each other by (x, y).
    fine : int64 (F + 1,)
        Where the points of each fine column begin.
    order : uint32 (N,)
        The number of the point that comes at each place.
    rising : uint32 (N,)
        The places of each column's points, ascending by height.
    xyz : float64 (N, 3)
        The points in this order.
    """

    side: float
    keys: UInt64
    start: Int64
    divisions: Int64
    first: Int64
    fine: Int64
    order: Array
    rising: Array
    xyz: Float64

    @classmethod
    def of(cls, xyz: Float64, radius: float) -> PointGrid:
        """Return the grid in which points within a radius of each other are sought."""
        farthest = _farthest(xyz)
        # The margin outweighs the rounding of quotients, whose size the second term bounds.
        side = max(1.001 * radius, farthest * 2.0**-30)
        ix, iy = cells_of(xyz, side)
        by_height, start = order_by_cell(ix, iy, xyz[:, 2])[:2]
        keys, divisions, first = _divided(ix, iy, by_height, start)
        fine = np.empty(first[-1] + 1, dtype=np.int64)
        fine[-1] = len(xyz)
        order, ordered = np.empty_like(by_height), np.empty_like(xyz)
        grid = cls(side, keys, start, divisions, first, fine, order, by_height, ordered)
        in_ranges(len(xyz), lambda begin, end: _divide(grid, *grid.columns(begin, end), xyz))
        return grid

    def columns(self, begin: int, end: int) -> tuple[int, int]:
        """Return from which to which column those are whose points begin in a range."""
        if (begin, end) == (0, len(self.order)):
            return 0, len(self.keys)
        first, last = np.searchsorted(self.start[:-1], (begin, end))
        return int(first), int(last)


@kernel
def _farthest(xyz: Float64) -> float:
    """Return the greatest absolute value of x and y."""
    farthest = 0.0
    for i in range(len(xyz)):
        farthest = max(farthest, max(abs(xyz[i, 0]), abs(xyz[i, 1])))
    return farthest


@kernel
def _divided(ix: Int32, iy: Int32, order: Array, start: Int64) -> tuple[UInt64, Int64, Int64]:
    """Return the keys of columns, into how many parts each is divided, and the first of these."""
    one_of_each = order[start[:-1]]
    keys = pack(ix[one_of_each], iy[one_of_each])
    divisions, first = np.empty(len(keys), dtype=np.int64), np.zeros_like(start)
    for column in range(len(divisions)):
        points = start[column + 1] - start[column]
        divisions[column] = max(1, int(np.sqrt(points / _IN_EACH)))
        first[column + 1] = first[column] + divisions[column] ** 2
    return keys, divisions, first


@kernel
def corner(key: int, side: float) -> tuple[float, float]:
    """Return the least x and y of a column."""
    ix = np.int64(key >> np.uint64(32)) - 2**31
    iy = np.int64(key & np.uint64(0xFFFFFFFF)) - 2**31
    return ix * side, iy * side


@kernel
def part(offset: float, side: float, divisions: int) -> int:
    """Return in which part of a column's side an offset from its corner lies."""
    return min(max(int(offset * divisions / side), 0), divisions - 1)


@kernel
def _divide(grid: PointGrid, begin: int, end: int, xyz: Float64) -> None:
    """Put the points of some columns, which ascend by height, into fine columns.

    In `rising`, the numbers of points give way to their places.
    """
    for column in range(begin, end):
        x, y = corner(grid.keys[column], grid.side)
        divisions, first = grid.divisions[column], grid.first[column]
        points = grid.rising[grid.start[column] : grid.start[column + 1]]
        place = np.zeros(divisions * divisions + 1, dtype=np.int64)
        inside = np.empty(len(points), dtype=np.int64)
        for i, point in enumerate(points):
            inside[i] = divisions * part(xyz[point, 0] - x, grid.side, divisions) + part(
                xyz[point, 1] - y, grid.side, divisions
            )
            place[inside[i] + 1] += 1
        place[0] = grid.start[column]
        for number in range(divisions * divisions):
            grid.fine[first + number] = place[number]
            place[number + 1] += place[number]
        for i, point in enumerate(points):
            there = place[inside[i]]
            place[inside[i]] = there + 1
            grid.order[there] = point
            grid.xyz[there] = xyz[point]
            points[i] = there


@kernel
def columns_around(grid: PointGrid, column: int, around: Int64) -> int:
    """Note the columns that touch a column, and itself; return how many these are."""
    size = 0
    for dx in (-1, 0, 1):
        # The three columns of one dx follow each other in memory.
        key = grid.keys[column] + np.uint64(np.int64(dx) << 32)
        there = np.searchsorted(grid.keys, key - np.uint64(1))
        while there < len(grid.keys) and grid.keys[there] <= key + np.uint64(1):
            around[size] = there
            size += 1
            there += 1
    return size


@kernel
def gather(
    grid: PointGrid,
    around: Int64,
    i: int,
    z: float,
    distance: float,
    limit: float,
    squared: Float64,
    heights: Float64,
) -> tuple[Float64, Float64, int]:
    """Collect the points near point i, if it were at height z: squared distances and heights.

    Near are those whose squared distance is at most `limit`, which is that of `distance`. The
    buffers are returned, for they may have grown; there is room for one more.
    """
    # Taken out once: a field of a tuple costs more than an element of an array.
    xyz, fine, keys, side = grid.xyz, grid.fine, grid.keys, grid.side
    firsts, all_divisions = grid.first, grid.divisions
    x, y = xyz[i, 0], xyz[i, 1]
    # The margin outweighs the rounding of corners and offsets.
    far = distance + 1e-6 * side
    n = 0
    for column in around:
        corner_x, corner_y = corner(keys[column], side)
        left, right = x - far - corner_x, x + far - corner_x
        lower, upper = y - far - corner_y, y + far - corner_y
        if left > side or right < 0 or lower > side or upper < 0:
            continue
        divisions = all_divisions[column]
        leftmost = rightmost = lowest = highest = 0
        if divisions > 1:
            leftmost, rightmost = part(left, side, divisions), part(right, side, divisions)
            lowest, highest = part(lower, side, divisions), part(upper, side, divisions)
        for ix in range(leftmost, rightmost + 1):
            row = firsts[column] + ix * divisions
            for number in range(row + lowest, row + highest + 1):
                begin, end = fine[number], fine[number + 1]
                if end - begin > _SHORT:
                    begin = _lowest_near(xyz, begin, end, z - far)
                while n + end - begin >= len(squared):
                    squared, heights = _doubled(squared), _doubled(heights)
                for j in range(begin, end):
                    dx, dy, dz = xyz[j, 0] - x, xyz[j, 1] - y, xyz[j, 2] - z
                    if dz > far:
                        break
                    apart = (dx * dx + dy * dy) + dz * dz
                    # Noted first and counted then, which spares a branch that nobody can foresee.
                    squared[n], heights[n] = apart, xyz[j, 2]
                    n += (apart <= limit) & (j != i)
    return squared, heights, n


@kernel
def _lowest_near(xyz: Float64, begin: int, end: int, z: float) -> int:
    """Return the first of some points, which ascend by height, that is not below z."""
    while begin < end:
        middle = (begin + end) // 2
        if xyz[middle, 2] < z:
            begin = middle + 1
        else:
            end = middle
    return begin


@kernel
def _doubled(buffer: Float64) -> Float64:
    larger = np.empty(2 * len(buffer))
    larger[: len(buffer)] = buffer
    return larger
