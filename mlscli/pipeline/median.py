"""The median filter on points (thesis, section 3.1).

A point's neighbours are the other points with ``(dx*dx + dy*dy) + dz*dz <= nb_radius**2``; of
more than `max_nb` the nearest `max_nb` count (equal distances: the lower first). A point with
fewer than `min_nb` is dropped as an outlier. Otherwise its z becomes the element at index
``n // 2`` of the n sorted heights of the point and its neighbours: always a height that was
measured, never the mean of two, which could invent a level between a bridge and its ground.

An outlier has its neighbours on one side, on the near half of a noisy surface, and ends up above
or below it. With `recentre`, a point whose height moves by more than that takes the median once
more, of its new height and of the neighbours that it has there.

Points are sorted into square columns a little wider than the radius, and by height in each. For
the points of one column, ascending, the window of heights that can be near moves on in each of
the nine columns around: each point is compared with few others, in the order of memory.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numba import njit

from mlscli.cells import pack
from mlscli.keyframes import Points
from mlscli.parameters import Cells, Length, in_units, parameter, whole_cells
from mlscli.patches import runs
from mlscli.pipeline.grouping import order_by_cell
from mlscli.pipeline.stage import Fault, PointStage
from mlscli.threads import in_ranges
from mlscli.typing import Bool, Float64, Int64, UInt64


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

    def apply(
        self, points: Points, cell_size: float, told: Callable[[int], None] | None = None
    ) -> Points:
        """Return the points that stay, with their median heights."""
        radius = in_units(self.nb_radius, cell_size)
        keys = _column_keys(points.xyz, radius)
        order = order_by_cell(keys, points.xyz[:, 2])
        keys, sorted_xyz = keys[order], points.xyz[order]
        start = runs(keys)
        columns = keys[start[:-1]]
        median = np.empty(points.size)
        stays = np.empty(points.size, dtype=np.bool_)

        def filter_columns(begin: int, end: int) -> None:
            _filter(
                sorted_xyz, columns, start, begin, end, radius, self.max_nb, self.min_nb,
                in_units(self.recentre, cell_size), median, stays,
            )  # fmt: skip

        in_ranges(len(columns), filter_columns, told and (lambda done: told(int(start[done]))))
        xyz = points.xyz.copy()
        xyz[order, 2] = median
        kept = np.empty(points.size, dtype=np.bool_)
        kept[order] = stays
        return Points(xyz[kept], points.keyframe[kept])


def _column_keys(xyz: Float64, radius: float) -> UInt64:
    """Return each point's column: points within the radius lie in columns that touch."""
    farthest = float(np.abs(xyz[:, :2]).max(initial=0.0))
    # The margin outweighs the rounding of the quotient, whose size the second term bounds.
    side = max(1.001 * radius, farthest * 2.0**-30)
    index = np.floor(xyz[:, :2] / side).astype(np.int64)
    return pack(index[:, 0], index[:, 1])


@njit(cache=True, nogil=True)
def _filter(
    xyz: Float64,
    columns: UInt64,
    start: Int64,
    begin: int,
    end: int,
    radius: float,
    max_nb: int,
    min_nb: int,
    recentre: float,
    median: Float64,
    stays: Bool,
) -> None:
    """Filter the points of columns ``begin`` to ``end``, into `median` and `stays`."""
    limit = radius * radius
    squared = np.empty(64)
    heights = np.empty(64)
    first = np.empty(9, dtype=np.int64)
    last = np.empty(9, dtype=np.int64)
    low = np.empty(9, dtype=np.int64)
    high = np.empty(9, dtype=np.int64)
    for column in range(begin, end):
        around = 0
        for dx in (-1, 0, 1):
            # The three columns of one dx follow each other in memory.
            key = columns[column] + np.uint64(np.int64(dx) << 32)
            there = np.searchsorted(columns, key - np.uint64(1))
            while there < len(columns) and columns[there] <= key + np.uint64(1):
                first[around], last[around] = start[there], start[there + 1]
                around += 1
                there += 1
        low[:around] = high[:around] = first[:around]
        for i in range(start[column], start[column + 1]):
            z = xyz[i, 2]
            for c in range(around):
                low[c], high[c] = _window(xyz, low[c], high[c], last[c], z, limit)
            squared, heights, n = _gather(xyz, i, z, low, high, around, limit, squared, heights)
            stays[i] = n >= min_nb
            median[i] = _median(z, squared, heights, n, max_nb)
            if stays[i] and 0 < recentre < abs(median[i] - z):
                # Far from its surface a point sees the near side of it only: look from there.
                z = median[i]
                again = np.empty(9, dtype=np.int64)
                until = np.empty(9, dtype=np.int64)
                for c in range(around):
                    again[c], until[c] = _window(xyz, first[c], first[c], last[c], z, limit)
                squared, heights, n = _gather(
                    xyz, i, z, again, until, around, limit, squared, heights
                )
                median[i] = _median(z, squared, heights, n, max_nb)


@njit(cache=True, nogil=True)
def _window(
    xyz: Float64, low: int, high: int, last: int, z: float, limit: float
) -> tuple[int, int]:
    """Move a window of a column up to the heights that are near enough to z."""
    while low < last and xyz[low, 2] < z and _squared(xyz[low, 2] - z) > limit:
        low += 1
    high = max(high, low)
    while high < last and (xyz[high, 2] <= z or _squared(xyz[high, 2] - z) <= limit):
        high += 1
    return low, high


@njit(cache=True, nogil=True)
def _gather(
    xyz: Float64,
    i: int,
    z: float,
    low: Int64,
    high: Int64,
    around: int,
    limit: float,
    squared: Float64,
    heights: Float64,
) -> tuple[Float64, Float64, int]:
    """Collect the neighbours of point i, if it were at height z: squared distances and heights.

    The buffers are returned, for they may have grown; there is room for one more.
    """
    n = 0
    for c in range(around):
        for j in range(low[c], high[c]):
            dx = xyz[j, 0] - xyz[i, 0]
            dy = xyz[j, 1] - xyz[i, 1]
            dz = xyz[j, 2] - z
            apart = (dx * dx + dy * dy) + dz * dz
            if apart <= limit and j != i:
                squared[n], heights[n] = apart, xyz[j, 2]
                n += 1
                if n == len(squared):
                    squared, heights = _doubled(squared), _doubled(heights)
    return squared, heights, n


@njit(cache=True, nogil=True)
def _median(z: float, squared: Float64, heights: Float64, n: int, max_nb: int) -> float:
    """Return the median of z and of the nearest of n heights, at most `max_nb` of them."""
    if 0 < max_nb < n:
        _keep_nearest(squared, heights, n, max_nb)
        n = max_nb
    heights[n] = z
    return _nth(heights, n + 1, (n + 1) // 2)


@njit(cache=True, nogil=True)
def _squared(value: float) -> float:
    return value * value


@njit(cache=True, nogil=True)
def _doubled(buffer: Float64) -> Float64:
    larger = np.empty(2 * len(buffer))
    larger[: len(buffer)] = buffer
    return larger


@njit(cache=True, nogil=True)
def _keep_nearest(squared: Float64, heights: Float64, n: int, size: int) -> None:
    """Move the heights of the `size` nearest of n neighbours to the front."""
    farthest = _nth(squared[:n].copy(), n, size - 1)
    kept = 0
    equal = np.empty(n)
    equals = 0
    for j in range(n):
        if squared[j] < farthest:
            heights[kept] = heights[j]
            kept += 1
        elif squared[j] == farthest:
            equal[equals] = heights[j]
            equals += 1
    lowest_first = np.sort(equal[:equals])
    for j in range(size - kept):
        heights[kept + j] = lowest_first[j]


@njit(cache=True, nogil=True)
def _nth(values: Float64, n: int, nth: int) -> float:
    """Return the element at index `nth` of the first n values sorted, reordering them."""
    left, right = 0, n - 1
    while left < right:
        pivot = values[(left + right) // 2]
        i, j = left, right
        while i <= j:
            while values[i] < pivot:
                i += 1
            while values[j] > pivot:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i += 1
                j -= 1
        if nth <= j:
            right = j
        elif nth >= i:
            left = i
        else:
            break
    return float(values[nth])
