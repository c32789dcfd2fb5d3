"""Points in square columns, for the search of neighbours.

Points within the radius of each other lie in the same column or in columns that touch. Where points
are dense, a column is divided into fine columns, so that each holds about `_IN_EACH` points. In a
fine column points ascend by height.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mlscli.maps.cells import cell_of, pack
from mlscli.pipeline.stages.ordering import cells_of, order_by_cell
from mlscli.runtime.arrays import Array, Float64, Int64, UInt64
from mlscli.runtime.kernels import inner, kernel
from mlscli.runtime.sorting import place_of
from mlscli.runtime.threads import in_ranges

_IN_EACH = 5
# Of a fine column with more points than this, only those of near heights are taken.
SHORT_POINTS = 16


class PointGrid(NamedTuple):
    """Points by column and fine column.

    Attributes
    ----------
    side : float
        Side of a column, in the unit of the points.
    keys : uint64 (C,)
        Packed indices of the columns that hold points, ascending.
    start : int64 (C + 1,)
        Where the points of each column begin.
    divisions : int64 (C,)
        Into how many parts each column is divided along x, and along y.
    first : int64 (C + 1,)
        The number of the first fine column of each column; fine columns ascend by (x, y).
    fine : int64 (F + 1,)
        Where the points of each fine column begin.
    order : uint32 (N,)
        The number of the point that comes at each place; int64 for 2^32 points or more.
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
    xyz: Float64

    @classmethod
    def of(cls, xyz: Float64, radius: float) -> PointGrid:
        """Return the grid of points (N, 3) for the search of neighbours within a radius."""
        farthest = _farthest(xyz)
        # The margin outweighs the rounding of quotients, whose size the second term bounds.
        side = max(1.001 * radius, farthest * 2.0**-30)
        ix, iy = cells_of(xyz, side)
        by_height, (ix, iy, start) = order_by_cell(ix, iy, xyz[:, 2])[:2]
        divisions, first = _divided(start, by_height, xyz, side)
        fine = np.empty(first[-1] + 1, dtype=np.int64)
        fine[-1] = len(xyz)
        order, ordered = np.empty_like(by_height), np.empty_like(xyz)
        grid = cls(side, pack(ix, iy), start, divisions, first, fine, order, ordered)

        def divide(begin: int, end: int) -> None:
            _divide(grid, *grid.columns(begin, end), by_height, xyz)

        in_ranges(len(xyz), divide)
        return grid

    def columns(self, begin: int, end: int) -> tuple[int, int]:
        """Return the range of columns whose points begin at the places `begin` to `end`."""
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
def _divided(start: Int64, by_height: Array, xyz: Float64, side: float) -> tuple[Int64, Int64]:
    """Return how each column is divided, and the number of its first fine column.

    Of a tall column, each search sees but a part of the height: where most points lie counts.

    Parameters
    ----------
    start : int64 (C + 1,)
        Where the points of each column begin.
    by_height : uint32 or int64 (N,)
        The points of each column, ascending by height.
    xyz : float64 (N, 3)
        The points.
    side : float
        Side of a column.
    """
    divisions, first = np.empty(len(start) - 1, dtype=np.int64), np.zeros_like(start)
    for column in range(len(divisions)):
        points = _most(by_height[start[column] : start[column + 1]], xyz, 2.0 * side)
        divisions[column] = max(1, int(np.sqrt(points / _IN_EACH)))
        first[column + 1] = first[column] + divisions[column] ** 2
    return divisions, first


@inner
def _most(points: Array, xyz: Float64, height: float) -> int:
    """Return how many points, which ascend by height, lie at most within so much height."""
    if not xyz[points[-1], 2] - xyz[points[0], 2] > height:
        return len(points)
    most, begin = 0, 0
    for end in range(len(points)):
        while xyz[points[end], 2] - xyz[points[begin], 2] > height:
            begin += 1
        most = max(most, end + 1 - begin)
    return most


@inner
def corner(key: np.uint64, side: float) -> tuple[float, float]:
    """Return the least x and y of a column."""
    ix, iy = cell_of(key)
    return ix * side, iy * side


@inner
def part(offset: float, side: float, divisions: int) -> int:
    """Return in which part of a column's side an offset from its corner lies."""
    return min(max(int(offset * divisions / side), 0), divisions - 1)


@kernel
def _divide(grid: PointGrid, begin: int, end: int, by_height: Array, xyz: Float64) -> None:
    """Put the points of columns `begin` to `end`, which ascend by height, into fine columns."""
    for column in range(begin, end):
        x, y = corner(grid.keys[column], grid.side)
        divisions, first = grid.divisions[column], grid.first[column]
        points = by_height[grid.start[column] : grid.start[column + 1]]
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
            for axis in range(3):
                grid.xyz[there, axis] = xyz[point, axis]


@inner
def columns_around(grid: PointGrid, column: int, around: Int64) -> int:
    """Write a column and those that touch it to `around`, int64 (9,); return how many they are."""
    size = 0
    for dx in (-1, 0, 1):
        # The three columns of one dx follow each other in memory.
        key = grid.keys[column] + np.uint64(np.int64(dx) << 32)
        there = place_of(grid.keys, key - np.uint64(1))
        while there < len(grid.keys) and grid.keys[there] <= key + np.uint64(1):
            around[size] = there
            size += 1
            there += 1
    return size


@inner
def gather(
    grid: PointGrid,
    around: Int64,
    points: tuple[int, int],
    heights: tuple[float, float],
    distance: float,
    near: Float64,
) -> tuple[Float64, int, int, bool]:
    """Collect all points within a distance of some points of one fine column, and maybe others.

    Parameters
    ----------
    grid : PointGrid
    around : int64
        The points' column, and those that touch it.
    points : (begin, end)
        Range of places of the points.
    heights : (low, high)
        Heights between which the points are taken to lie.
    distance : float
        At most the radius of the grid.
    near : float64 (R, M)
        A buffer with a row for each of x, y and z, and further rows.

    Returns
    -------
    near : float64 (R, M)
        The buffer, which may have grown, with x, y, z of the points found and room for one more.
    size : int
        How many were found.
    own : int
        Index of the first of the points themselves, which follow each other; -1: it was left out.
    cut : bool
        Whether some were left out because of their heights.
    """
    # Taken out once: access to a field of a tuple costs more than to an element of an array.
    xyz, fine, keys, side = grid.xyz, grid.fine, grid.keys, grid.side
    firsts, all_divisions = grid.first, grid.divisions
    west, south, east, north = np.inf, np.inf, -np.inf, -np.inf
    for i in range(points[0], points[1]):
        west, east = min(west, xyz[i, 0]), max(east, xyz[i, 0])
        south, north = min(south, xyz[i, 1]), max(north, xyz[i, 1])
    # The margin outweighs the rounding of corners and offsets.
    far = distance + 1e-6 * side
    west, south, east, north = west - far, south - far, east + far, north + far
    size, own, cut = 0, -1, False
    for column in around:
        left, lower = corner(keys[column], side)
        if west > left + side or east < left or south > lower + side or north < lower:
            continue
        divisions = all_divisions[column]
        lowest, highest = part(south - lower, side, divisions), part(north - lower, side, divisions)
        leftmost, rightmost = part(west - left, side, divisions), part(east - left, side, divisions)
        for ix in range(leftmost, rightmost + 1):
            row = firsts[column] + ix * divisions
            for number in range(row + lowest, row + highest + 1):
                low, high = heights[0] - far, heights[1] + far
                begin, end = between(xyz, fine[number], fine[number + 1], low, high)
                cut |= end - begin < fine[number + 1] - fine[number]
                if size + end - begin >= near.shape[1]:
                    near = wider(near, 2 * (size + end - begin))
                for j in range(begin, end):
                    # Written first and counted then, which avoids an unpredictable branch.
                    x, y = xyz[j, 0], xyz[j, 1]
                    near[0, size], near[1, size], near[2, size] = x, y, xyz[j, 2]
                    if j == points[0]:
                        own = size
                    size += (west <= x) & (x <= east) & (south <= y) & (y <= north)
    return near, size, own, cut


@inner
def wider(buffer: Float64, size: int) -> Float64:
    """Return a buffer with more columns, and what it holds."""
    wider = np.empty((buffer.shape[0], size))
    for row in range(buffer.shape[0]):
        for j in range(buffer.shape[1]):
            wider[row, j] = buffer[row, j]
    return wider


@inner
def between(xyz: Float64, begin: int, end: int, low: float, high: float) -> tuple[int, int]:
    """Return where those of points `begin` to `end`, which ascend, are from `low` to below `high`.

    Of few points all are returned, which takes no longer.
    """
    if end - begin <= SHORT_POINTS:
        return begin, end
    begin = first_from(xyz, begin, end, low)
    return begin, first_from(xyz, begin, end, high)


@inner
def first_from(xyz: Float64, begin: int, end: int, z: float) -> int:
    """Return the first of points `begin` to `end`, which ascend by height, that is not below z."""
    while begin < end:
        middle = (begin + end) // 2
        if xyz[middle, 2] < z:
            begin = middle + 1
        else:
            end = middle
    return begin


@inner
def coincide(xyz: Float64, i: int, j: int) -> bool:
    """Return whether two points lie at the same place."""
    return bool(xyz[i, 0] == xyz[j, 0] and xyz[i, 1] == xyz[j, 1] and xyz[i, 2] == xyz[j, 2])
