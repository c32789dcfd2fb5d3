"""The median filter on points (thesis, section 3.1).

A point's neighbours are the other points with ``(dx*dx + dy*dy) + dz*dz <= nb_radius**2``; of
more than `max_nb` the nearest `max_nb` count (equal distances: the lower first). A point with
fewer than `min_nb` is dropped as an outlier. Otherwise its z becomes the element at index
``n // 2`` of the n sorted heights of the point and its neighbours: always a height that was
measured, never the mean of two, which could invent a level between a bridge and its ground.

An outlier has its neighbours on one side, on the near half of a noisy surface, and ends up above
or below it. With `recentre`, a point whose height moves by more than that takes the median once
more, of its new height and of the neighbours that it has there.

Where only the nearest count, the search begins a little farther than the nearest of the point
before reached, and goes farther until it has found enough: in a dense cloud, too, each point is
compared with few others, in the order of memory.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from mlscli.kernels import kernel
from mlscli.keyframes import Points
from mlscli.parameters import Cells, Length, in_units, parameter, whole_cells
from mlscli.pipeline.point_grid import PointGrid, columns_around, gather
from mlscli.pipeline.stage import Evaluated, Fault, PointStage
from mlscli.threads import in_ranges
from mlscli.typing import Bool, Float64, Int64

# How much farther than the last point's neighbours the next one's are sought at first.
_FARTHER = 1.2
# The least part of the radius in which they are sought.
_NEAREST = 64
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
        told: Callable[[int], None] | None = None,
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

        in_ranges(points.size, filter_points, told)
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
    squared, heights = np.empty(64), np.empty(64)
    nine = np.empty(9, dtype=np.int64)
    for column in range(begin, end):
        around = nine[: columns_around(grid, column, nine)]
        reached = grid.side / grid.divisions[column]
        # Ascending, for the next point mostly lies on the same surface as the last.
        for i in grid.rising[grid.start[column] : grid.start[column + 1]]:
            point, z = grid.order[i], grid.xyz[i, 2]
            if len(asked) and not asked[point]:
                continue
            median, farthest = np.nan, 0.0
            for again in (False, True):
                squared, heights, n, reached, far = _neighbours(
                    grid, around, i, z, radius, max_nb, reached, squared, heights
                )
                farthest = max(farthest, far)
                if n < min_nb and not again:
                    break
                heights[n], squared[n] = z, 0.0
                median = _nth(heights, squared, n + 1, (n + 1) // 2)
                # Far from its surface a point sees the near side of it only: look from there.
                if not 0 < recentre < abs(median - z):
                    break
                z = median
            height[point] = median
            if len(asked):
                looked[point] = farthest


@kernel
def _neighbours(
    grid: PointGrid,
    around: Int64,
    i: int,
    z: float,
    radius: float,
    max_nb: int,
    reached: float,
    squared: Float64,
    heights: Float64,
) -> tuple[Float64, Float64, int, float, float]:
    """Collect the neighbours that count of point i, if it were at height z, and where they end.

    The square of where they end is that of the radius where others would count, too.

    Where more lie within the radius than count, the search stops as soon as the nearest are
    certain; how far it had to go is told, to be where the next one begins.
    """
    # Where points coincide, the last ones told nothing.
    distance = max(_FARTHER * reached, radius / _NEAREST) if max_nb > 0 else np.inf
    while True:
        whole = distance >= radius
        limit = radius * radius if whole else min(distance * distance, radius * radius)
        squared, heights, n = gather(
            grid, around, i, z, min(distance, radius), limit, squared, heights
        )
        if 0 < max_nb <= n:
            farthest = _nth(squared, heights, n, max_nb - 1)
            return squared, heights, max_nb, np.sqrt(farthest), farthest
        if whole:
            return squared, heights, n, reached, radius * radius
        distance *= 1.5


@kernel
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
