"""The median filter on points (thesis, section 3.1).

A point's neighbours are the other points with ``(dx*dx + dy*dy) + dz*dz <= nb_radius**2``; of
more than `max_nb` the nearest `max_nb` count (equal distances: the lower first). A point with
fewer than `min_nb` is dropped as an outlier. Otherwise its z becomes the element at index
``n // 2`` of the n sorted heights of the point and its neighbours: always a height that was
measured, never the mean of two, which could invent a level between a bridge and its ground.

An outlier has its neighbours on one side, on the near half of a noisy surface, and ends up above
or below it. With `recentre`, a point whose height moves by more than that takes the median once
more, of its new height and of the neighbours that it has there.

Points that lie close together look for neighbours together: all that may count is collected once.
Where only the nearest count, the search begins a little farther than the nearest of the points
before reached, and goes farther until it has found enough: in a dense cloud, too, each point is
compared with few others.
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

# So many points of a fine column, one above the other, look for neighbours together.
_TOGETHER = 16
# How much farther than the neighbours of the last points those of the next are sought at first,
# and how much farther then, where these are too few.
FIRST_MARGIN, RETRY_GROWTH = 1.4, 1.5
# The least part of the radius in which they are sought.
_NEAREST = 64
# Of points at the same distance no trial finds just so many.
_TRIALS = 12
# So few heights are sorted faster without a branch.
_FEW_HEIGHTS = 32
# A buffer has rows for x, y and z of the points around, and for two more; at first so long.
_SQUARED, _HEIGHT, _ROWS, _ROOM = 3, 4, 5, 256
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
        """Return the median heights of points."""
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
    """Filter those points of columns `begin` to `end` that are asked for; note how far it looked.

    Where `asked` is empty, all are asked for, and only their heights are noted.
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

    Told is how far the neighbours of the last points reached; how far those of these reach is
    returned, and the buffer, which may have grown.
    """
    xyz, order = grid.xyz, grid.order
    low, high = xyz[first, 2], xyz[last - 1, 2]
    # Where points coincide, the last ones told nothing.
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
    """Tell whether any of some successive points is asked for."""
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
    """Find the neighbours that count of point i, if it were at height z: their heights.

    Given are all points within a distance, and others. Where more lie within the radius than
    count, the nearest are certain as soon as so many are within the distance; until then it grows.
    Returned are the buffer with the heights, how many they are, and the square of how far off a
    point can be to be one of them.
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
    """Note squared distances from (x, y, z)."""
    xs, ys, zs, squared = near[0], near[1], near[2], near[_SQUARED]
    for j in range(size):
        dx, dy, dz = xs[j] - x, ys[j] - y, zs[j] - z
        squared[j] = (dx * dx + dy * dy) + dz * dz


@inner
def _nearest(near: Float64, size: int, limit: float, max_nb: int) -> tuple[int, float]:
    """Note the heights of the points whose squared distance is at most a limit.

    Of more than `max_nb` those of the nearest come first. Returned are how many count, and the
    squared distance within which they are.
    """
    zs, squared, heights = near[2], near[_SQUARED], near[_HEIGHT]
    below, above = 0, _within(squared, size, limit)
    if 0 < max_nb < above:
        # The limit within which there are just so many is sought between two others.
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
        # Noted first and counted then.
        heights[n] = zs[j]
        n += squared[j] <= limit
    if 0 < max_nb < n:
        # Some are as far as each other.
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
    """Return the element at index ``n // 2`` of the first n heights, if they were sorted."""
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
    """Return the element at index `nth` of the first n values, if they were sorted.

    The lesser ones are moved before it, each with its other; of equal values that with the lesser
    other comes first.
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
