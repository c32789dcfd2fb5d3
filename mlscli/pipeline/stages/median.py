"""The median filter on points (thesis, section 3.1).

A point's neighbours are the other points with ``(dx*dx + dy*dy) + dz*dz <= nb_radius**2``; of
more than `max_nb` the nearest `max_nb` count (equal distances: the lower first). A point with
fewer than `min_nb` is dropped as an outlier. Otherwise its z becomes the element at index
``n // 2`` of the n sorted heights of the point and its neighbours: always a height that was
measured, never the mean of two, which could invent a level between a bridge and its ground.

An outlier's neighbours all lie on the near side of a noisy surface, so that it ends up above or
below it. With `recentre`, a point whose height moves by more than that takes the median once more,
of its new height and of the neighbours that it has there.

Points that lie close together share one search: all candidates are collected once. Where only the
nearest count, the search begins somewhat beyond the mean reach of the last points' neighbours and
grows until it has found enough: even in a dense cloud, each point is compared with few others.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from mlscli.keyframes.batches import Points
from mlscli.parameters.fields import parameter
from mlscli.parameters.lengths import Cells, Length, in_units, whole_cells
from mlscli.pipeline.stages.point_grid import PointGrid, columns_around, gather
from mlscli.pipeline.stages.stage import Evaluated, Fault, PointStage
from mlscli.runtime.arrays import Array, Bool, Float64, Int64
from mlscli.runtime.kernels import inner, kernel
from mlscli.runtime.threads import in_ranges

# At most so many points of a fine column, one above the other, share a search.
_TOGETHER = 16
# How much farther than the last points' neighbours the next ones are sought at first, and by how
# much the search grows where it finds too few.
FIRST_MARGIN, RETRY_GROWTH = 1.4, 1.5
# The search begins with no less than the radius divided by this.
_NEAREST = 64
# Trials to find a limit within which exactly `max_nb` points lie; with equal distances none may.
_TRIALS = 12
# At most so many heights are sorted faster without a branch.
_FEW_HEIGHTS = 32
# Rows of a buffer after x, y, z of the points around: squared distances, and heights of those that
# count. Then the number of rows, and the length at first.
_SQUARED, _HEIGHT, _ROWS, _ROOM = 3, 4, 5, 256
# The mask that stands for all points.
_ALL = np.empty(0, dtype=np.bool_)


@dataclass(frozen=True)
class Median(PointStage):
    """Give each point the median height of its neighbourhood, or drop it as an outlier."""

    name: ClassVar[str] = "median"

    nb_radius: Length = parameter(Cells(3), "radius in which neighbours are sought, in 3D", above=0)
    max_nb: int = parameter(16, "most neighbours that count, the nearest first; 0: all", low=0)
    min_nb: int = parameter(8, "a point with fewer neighbours is dropped as an outlier", low=0)

    recentre: Length = parameter(
        0,
        "a point whose height moves farther looks for neighbours again from its new height; "
        "0: never",
        low=0,
    )

    def faults(self, cell_size: float | None, gap_size: Length | None) -> Iterator[Fault]:  # noqa: ARG002
        """Yield a fault where no point could ever have enough neighbours."""
        if 0 < self.max_nb < self.min_nb:
            yield Fault(
                "min_nb",
                f"{self.min_nb} is above max_nb ({self.max_nb}), so that every point would be "
                f"dropped; at most {self.max_nb}, or max_nb: 0",
            )

    def reach(self, cell_size: float) -> int:
        """Return the radius in whole cells, and one more: points can lie at their cells' edges."""
        return whole_cells(self.nb_radius, cell_size) + 1

    def evaluate(
        self,
        points: Points,
        cell_size: float,
        asked: Bool | None = None,
        progress: Callable[[int], None] | None = None,
    ) -> Evaluated:
        """Return the median heights of points; see `PointStage.evaluate`."""
        radius = in_units(self.nb_radius, cell_size)
        recentre = in_units(self.recentre, cell_size)
        grid = PointGrid.of(points.xyz, radius)
        height = np.empty(points.size)
        which = _ALL if asked is None else asked
        looked = np.empty(len(which))

        def filter_points(begin: int, end: int) -> None:
            _filter(
                grid, *grid.columns(begin, end), radius, self.max_nb, self.min_nb, recentre,
                which, height, looked,
            )  # fmt: skip

        in_ranges(points.size, filter_points, progress)
        return Evaluated(height, looked)


@kernel
def _filter(
    grid: PointGrid,
    begin: int,
    end: int,
    radius: float,
    max_nb: int,
    min_nb: int,
    recentre: float,
    asked: Bool,
    height: Float64,
    looked: Float64,
) -> None:
    """Filter those points of columns `begin` to `end` that are asked for.

    Parameters
    ----------
    grid : PointGrid
        All points, by columns.
    begin, end : int
        Range of columns.
    radius : float
        Radius in which neighbours are sought, in the unit of the points.
    max_nb, min_nb : int
        The most neighbours that count (0: all), and the fewest with which a point is kept.
    recentre : float
        A point whose height moves farther takes the median again from there; 0: never.
    asked : bool (N,)
        The points to filter; empty: all.
    height : float64 (N,)
        Receives the new heights; NaN: dropped.
    looked : float64 (N,)
        Receives the squares of how far the search went; not used where `asked` is empty.
    """
    fine = grid.fine
    near = np.empty((_ROWS, _ROOM))
    nine = np.empty(9, dtype=np.int64)
    for column in range(begin, end):
        around = nine[: columns_around(grid, column, nine)]
        reached = grid.side / grid.divisions[column]
        for number in range(grid.first[column], grid.first[column + 1]):
            for first in range(fine[number], fine[number + 1], _TOGETHER):
                last = min(first + _TOGETHER, fine[number + 1])
                if _any_asked(asked, grid.order, first, last):
                    near, reached = _filter_together(
                        grid, around, first, last, radius, max_nb, min_nb, recentre,
                        reached, near, asked, height, looked,
                    )  # fmt: skip


@inner
def _filter_together(
    grid: PointGrid,
    around: Int64,
    first: int,
    last: int,
    radius: float,
    max_nb: int,
    min_nb: int,
    recentre: float,
    reached: float,
    near: Float64,
    asked: Bool,
    height: Float64,
    looked: Float64,
) -> tuple[Float64, float]:
    """Filter those of points `first` to `last`, of one fine column, that are asked for.

    Parameters
    ----------
    grid : PointGrid
        All points, by columns.
    around : int64
        The column of these points, and those that touch it.
    first, last : int
        Range of places in the grid.
    radius, max_nb, min_nb, recentre
        As in `_filter`.
    reached : float
        How far the neighbours of the last points reached, on average.
    near : float64 (_ROWS, M)
        A buffer.
    asked, height, looked
        As in `_filter`.

    Returns
    -------
    near : float64 (_ROWS, M)
        The buffer, which may have grown.
    reached : float
        How far the neighbours of these points reach, on average, counting points with `max_nb`
        neighbours only; unchanged where there are none.
    """
    xyz, order = grid.xyz, grid.order
    low, high = xyz[first, 2], xyz[last - 1, 2]
    # Where points coincide, `reached` may be 0.
    distance = min(max(FIRST_MARGIN * reached, radius / _NEAREST), radius)
    if max_nb == 0:
        distance = radius
    near, size, own, cut = gather(grid, around, (first, last), (low, high), distance, near)
    reaches, several = 0.0, 0
    for i in range(first, last):
        point, z = order[i], xyz[i, 2]
        if len(asked) and not asked[point]:
            continue
        median, farthest = np.nan, 0.0
        for again in (False, True):
            there, there_size, itself = near, size, own + i - first
            if cut and not low <= z <= high:
                there, there_size, itself, _ = gather(
                    grid, around, (i, i + 1), (z, z), distance, np.empty((_ROWS, _ROOM))
                )
            there, n, limit = _neighbours(
                grid, around, i, z, radius, max_nb, distance, there, there_size, itself
            )
            farthest = max(farthest, limit)
            if 0 < max_nb == n:
                reaches += np.sqrt(limit)
                several += 1
            if n < min_nb and not again:
                break
            there[_HEIGHT, n] = z
            median = _middle(there[_HEIGHT], there[_SQUARED], n + 1)
            # Far from its surface a point sees the near side of it only: look from there.
            if not 0 < recentre < abs(median - z):
                break
            z = median
        height[point] = median
        if len(asked):
            looked[point] = farthest
    return near, reaches / several if several else reached


@inner
def _any_asked(asked: Bool, order: Array, first: int, last: int) -> bool:
    """Return whether any of points `first` to `last` is asked for."""
    if not len(asked):
        return True
    some = False
    for i in range(first, last):
        some |= asked[order[i]]
    return some


@inner
def _neighbours(
    grid: PointGrid,
    around: Int64,
    i: int,
    z: float,
    radius: float,
    max_nb: int,
    distance: float,
    near: Float64,
    size: int,
    own: int,
) -> tuple[Float64, int, float]:
    """Find the neighbours that count of point i, as if it were at height z.

    With `max_nb`, the search is complete as soon as so many points lie within the distance; until
    then the distance grows, up to the radius.

    Parameters
    ----------
    grid : PointGrid
        All points, by columns.
    around : int64
        The point's column, and those that touch it.
    i : int
        Place of the point in the grid.
    z : float
        Height from which neighbours are sought.
    radius, max_nb
        As in `_filter`.
    distance : float
        All points within this distance are in the buffer, and maybe others.
    near : float64 (_ROWS, M)
        The buffer, with x, y, z of points.
    size : int
        How many points are in the buffer.
    own : int
        Index of the point itself in the buffer; -1: it is not there.

    Returns
    -------
    near : float64 (_ROWS, M)
        The buffer, or another one, with the heights of the neighbours in its row `_HEIGHT`.
    n : int
        How many neighbours count.
    limit : float
        The square of the greatest distance at which a point can be one of them.
    """
    while True:
        _measure(near, size, grid.xyz[i, 0], grid.xyz[i, 1], z)
        near[_SQUARED, own] = np.inf
        whole = distance >= radius
        limit = radius * radius if whole else min(distance * distance, radius * radius)
        n, limit = _nearest(near, size, limit, max_nb)
        if whole or 0 < max_nb <= n:
            return near, n, limit
        distance *= RETRY_GROWTH
        near = np.empty((_ROWS, _ROOM))
        near, size, own, _ = gather(grid, around, (i, i + 1), (z, z), min(distance, radius), near)


@inner
def _measure(near: Float64, size: int, x: float, y: float, z: float) -> None:
    """Write the squared distances of the buffer's points from (x, y, z) into the buffer."""
    xs, ys, zs, squared = near[0], near[1], near[2], near[_SQUARED]
    for j in range(size):
        dx, dy, dz = xs[j] - x, ys[j] - y, zs[j] - z
        squared[j] = (dx * dx + dy * dy) + dz * dz


@inner
def _nearest(near: Float64, size: int, limit: float, max_nb: int) -> tuple[int, float]:
    """Write the heights of points at squared distances of at most `limit` into the buffer.

    Of more than `max_nb`, those of the nearest come first.

    Returns
    -------
    n : int
        How many of these points count.
    limit : float
        The squared distance within which they lie.
    """
    zs, squared, heights = near[2], near[_SQUARED], near[_HEIGHT]
    below, above = 0, _within(squared, size, limit)
    if 0 < max_nb < above:
        # A limit within which exactly `max_nb` points lie is sought by linear interpolation.
        less = 0.0
        for _ in range(_TRIALS):
            between = less + (limit - less) * ((max_nb - below) / (above - below))
            n = _within(squared, size, between)
            if n >= max_nb:
                limit, above = between, n
            else:
                less, below = between, n
            if n == max_nb:
                break
    n = 0
    for j in range(size):
        # Written first and counted then, which avoids a branch.
        heights[n] = zs[j]
        n += squared[j] <= limit
    if 0 < max_nb < n:
        # No such limit was found, mostly for equal distances.
        n = 0
        for j in range(size):
            squared[n] = squared[j]
            n += squared[n] <= limit
        limit = _nth(squared, heights, n, max_nb - 1)
        n = max_nb
    return n, limit


@inner
def _within(squared: Float64, size: int, limit: float) -> int:
    """Count the points whose squared distance is at most a limit."""
    n = 0
    for j in range(size):
        n += squared[j] <= limit
    return n


@inner
def _middle(heights: Float64, others: Float64, n: int) -> float:
    """Return the element at index ``n // 2`` of the first n heights as sorted; reorders both."""
    if n > _FEW_HEIGHTS:
        return _nth(heights, others, n, n // 2)
    for place in range(n // 2 + 1):
        least = heights[place]
        for j in range(place + 1, n):
            height = heights[j]
            heights[j], least = max(height, least), min(height, least)
        heights[place] = least
    return float(heights[n // 2])


@inner
def _nth(values: Float64, others: Float64, n: int, nth: int) -> float:
    """Return the element at index `nth` of the first n values as sorted (quickselect).

    Lesser values are moved before it, each along with its element of `others`; equal values are
    ordered by these.
    """
    begin, end = 0, n
    while True:
        value, other = values[(begin + end) // 2], others[(begin + end) // 2]
        less = begin
        for j in range(begin, end):
            v, o = values[j], others[j]
            values[j], others[j] = values[less], others[less]
            values[less], others[less] = v, o
            less += (v < value) | ((v == value) & (o < other))
        if nth < less:
            end = less
            continue
        equal = less
        for j in range(less, end):
            v, o = values[j], others[j]
            values[j], others[j] = values[equal], others[equal]
            values[equal], others[equal] = v, o
            equal += (v == value) & (o == other)
        if nth < equal:
            return float(value)
        begin = equal
