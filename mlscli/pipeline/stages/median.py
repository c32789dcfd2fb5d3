"""The median filter on points (thesis, section 3.1).

A point's neighbours are the other points with ``(dx*dx + dy*dy) + dz*dz <= nb_radius**2``; of
more than `max_nb` the nearest `max_nb` count (equal distances: the lower first). A point with
fewer than `min_nb` is dropped as an outlier. Otherwise its z becomes the element at index
``n // 2`` of the n sorted heights of the point and its neighbours: always a height that was
measured, never the mean of two, which could invent a level between a bridge and its ground.

An outlier's neighbours all lie on the near side of a noisy surface, so that it ends up above or
below it. With `recentre`, a point whose height moves by more than that takes the median once more,
of its new height and of the neighbours that it has there.

Three rules are better than the thesis's on real clouds, where whole regions are thin, and where
walls end. With `level`, a point is held against its own surroundings: only neighbours that lie at
most so far above or below it speak for it, at least `min_nb` of them, and at least the share
`min_share` of all; the others lie on a surface that the point is not part of.

With `layer_share`, a point for which too few of them speak is kept all the same where its layer is
not much thinner than others: where little was seen, little is enough. All points at horizontal
distances of at most `nb_radius`, whatever their heights, are put into layers ``2 * level`` thick,
the point itself in the middle of its own: into layer ``rint(dz / (2 * level))``, those beyond 31
into the 31st, up and down. The point is kept if its layer holds, itself counted, at least that
share of what those that hold any hold in the mean. Outliers have all heights: each is alone in a
layer beside those of surfaces that were seen well. It is kept, too, if it is of a pole
(`mlscli.pipeline.stages.layers`).

With `max_slope`, heights are compared along the slope on which the neighbours lie (see
`mlscli.pipeline.stages.slope`); those at the distance of the last that counts count as well. Where
they lie on no slope up to that one, along walls, trunks and poles, the point keeps its height: a
median would move the ends of what is upright towards its middle. With `layer_share`, it does so,
too, if they leave open whether they are upright and it is of a pole.

With `across`, it is moved sideways instead, across the wall: by the median of where the nearest of
its neighbours lie, as `mlscli.pipeline.stages.upright` says, if that is no farther. Only points of
which it is known how they err are moved: depths that err displace points sideways, too.

Points that lie close together share one search, and have one result if they coincide. Where only
the nearest count, it begins somewhat beyond the mean reach of the last points' neighbours: even in
a dense cloud, each point is compared with few others.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from mlscli.keyframes.batches import Points
from mlscli.maps.cells import on_grid
from mlscli.parameters.fields import parameter
from mlscli.parameters.lengths import Cells, Length, in_units, whole_cells
from mlscli.pipeline.stages.layers import is_pole, stands_out
from mlscli.pipeline.stages.nearest import (
    HEIGHT,
    ROOM,
    ROWS,
    SQUARED,
    error_of,
    middle,
    neighbours,
)
from mlscli.pipeline.stages.point_grid import PointGrid, coincide, columns_around, gather
from mlscli.pipeline.stages.slope import carry
from mlscli.pipeline.stages.stage import Evaluated, Fault, PointStage
from mlscli.pipeline.stages.upright import aside
from mlscli.runtime.arrays import Array, Bool, Float32, Float64, Int64
from mlscli.runtime.kernels import inner, kernel
from mlscli.runtime.threads import in_ranges

# At most so many points of a fine column, one above the other, share a search.
_TOGETHER = 16
# How much farther than the last points' neighbours the next ones are sought at first.
_FIRST_MARGIN = 1.4
# The search begins with no less than the radius divided by this.
_NEAREST = 64
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

    level: Length = parameter(
        0,
        "how far above or below a point a neighbour may lie that speaks for it; 0: any does",
        low=0,
    )
    min_share: float = parameter(
        0.0,
        "a point is dropped for which a smaller share of its neighbours speaks, see level",
        low=0,
        high=1,
    )
    max_slope: float = parameter(
        0.0,
        "heights are compared along the slope of the neighbours, up to this one; where they lie "
        "on none, the point keeps its height; 0: heights are compared as they are",
        low=0,
    )
    layer_share: float = parameter(
        0.0,
        "a point for which too few neighbours speak is kept if those level with it are this share "
        "of what lies, in the mean, in a layer of all heights around; 0: never, see level",
        low=0,
        high=1,
    )
    across: Length = parameter(
        0,
        "a point that keeps its height, see max_slope, is moved across its wall by at most this, "
        "and by at most nb_radius, if it is known how its depth errs; 0: it stays",
        low=0,
    )

    def faults(self, cell_size: float | None, gap_size: Length | None) -> Iterator[Fault]:  # noqa: ARG002
        """Yield a fault where no point could have enough neighbours, or a share means nothing."""
        if 0 < self.max_nb < self.min_nb:
            yield Fault(
                "min_nb",
                f"{self.min_nb} is above max_nb ({self.max_nb}), so that every point would be "
                f"dropped; at most {self.max_nb}, or max_nb: 0",
            )
        if self.min_share > 0 and in_units(self.level, 1.0) == 0:
            yield Fault(
                "min_share",
                f"{self.min_share} does nothing where level is 0, as all neighbours speak for a "
                "point; set level, such as 1 cells, or min_share: 0",
            )
        if self.layer_share > 0 and in_units(self.level, 1.0) == 0:
            yield Fault(
                "layer_share",
                f"{self.layer_share} does nothing where level is 0; set level, such as 1 cells, "
                "or layer_share: 0",
            )

    def reach(self, cell_size: float) -> int:
        """Return the radius and how far points move, in whole cells; and one more, for edges."""
        radius = in_units(self.nb_radius, cell_size)
        across = min(in_units(self.across, cell_size), radius)
        return whole_cells(radius + across, cell_size) + 1

    def evaluate(
        self,
        points: Points,
        cell_size: float,
        asked: Bool | None = None,
        progress: Callable[[int], None] | None = None,
    ) -> Evaluated:
        """Return the median heights of points; see `PointStage.evaluate`."""
        height, looked, noise, moves = self._heights(points, cell_size, asked, progress)
        # Only now, as the search takes memory, too.
        xyz = points.xyz.copy()
        xyz[:, 2] = height
        if len(moves):
            xyz[:, :2] += moves
            outside = np.flatnonzero(~on_grid(xyz, cell_size))
            xyz[outside, :2] = points.xyz[outside, :2]
        return Evaluated(xyz, looked, noise)

    def _heights(
        self,
        points: Points,
        cell_size: float,
        asked: Bool | None,
        progress: Callable[[int], None] | None,
    ) -> tuple[Float64, Float64, Float32, Float64]:
        """Return the heights of points, NaN where dropped, how far was looked, their noise, moves.

        Moves in x and y are float64 (N, 2), or (0, 2) where none is known to move.
        """
        rule = Rule(
            in_units(self.nb_radius, cell_size),
            self.max_nb,
            self.min_nb,
            in_units(self.recentre, cell_size),
            in_units(self.level, cell_size) or np.inf,
            float(self.min_share),
            float(self.max_slope),
            float(self.layer_share),
            min(in_units(self.across, cell_size), in_units(self.nb_radius, cell_size)),
        )
        known = rule.across > 0.0 and not np.isnan(points.noise).all()
        moves = np.zeros((points.size if known else 0, 2))
        grid = PointGrid.of(points.xyz, rule.radius)
        height, noise = np.empty(points.size), np.empty(points.size, dtype=np.float32)
        which = _ALL if asked is None else asked
        looked = np.empty(len(which))

        def filter_points(begin: int, end: int) -> None:
            columns = grid.columns(begin, end)
            _filter(grid, *columns, rule, which, points.noise, height, looked, noise, moves)

        in_ranges(points.size, filter_points, progress)
        _add(points.noise, noise)
        return height, looked, noise, moves


class Rule(NamedTuple):
    """The parameters of a median, lengths in the unit of the points.

    Attributes
    ----------
    radius : float
        Radius in which neighbours are sought.
    max_nb, min_nb : int
        The most neighbours that count (0: all), and the fewest with which a point is kept.
    recentre : float
        A point whose height moves farther takes the median again from there; 0: never.
    level : float
        How far above or below a point a neighbour lies at most that speaks for it.
    min_share : float
        The least share of the neighbours that must speak for a point.
    max_slope : float
        The steepest slope along which heights are compared; 0: along none.
    layer_share : float
        The share of the mean layer around it that is enough in its own to keep it; 0: none is.
    across : float
        How far at most a point of what stands upright is moved across it.
    """

    radius: float
    max_nb: int
    min_nb: int
    recentre: float
    level: float
    min_share: float
    max_slope: float
    layer_share: float
    across: float


@kernel
def _filter(
    grid: PointGrid,
    begin: int,
    end: int,
    rule: Rule,
    asked: Bool,
    known: Float32,
    height: Float64,
    looked: Float64,
    errors: Float32,
    moves: Float64,
) -> None:
    """Filter those points of columns `begin` to `end` that are asked for.

    Parameters
    ----------
    grid : PointGrid
        All points, by columns.
    begin, end : int
        Range of columns.
    rule : Rule
    asked : bool (N,)
        The points to filter; empty: all.
    known : float32 (N,)
        The variances of their errors as known before; NaN: not known.
    height : float64 (N,)
        Receives the new heights; NaN: dropped.
    looked : float64 (N,)
        Receives the squares of how far the search went; not used where `asked` is empty.
    errors : float32 (N,)
        Receives the variances of the medians' errors, and what `_add` reads; NaN: not known.
    moves : float64 (N, 2)
        Receives how far points move in x and y; empty: none does.
    """
    fine = grid.fine
    near = np.empty((ROWS, ROOM))
    nine = np.empty(9, dtype=np.int64)
    for column in range(begin, end):
        around = nine[: columns_around(grid, column, nine)]
        reached = grid.side / grid.divisions[column]
        for number in range(grid.first[column], grid.first[column + 1]):
            last = fine[number]
            while last < fine[number + 1]:
                first = last
                last = min(first + _TOGETHER, fine[number + 1])
                # Those that coincide share a search, however many they are.
                while last < fine[number + 1] and coincide(grid.xyz, last - 1, last):
                    last += 1
                if _any_asked(asked, grid.order, first, last):
                    near, reached = _filter_together(
                        grid, around, first, last, rule, reached, near,
                        asked, known, height, looked, errors, moves,
                    )  # fmt: skip


@kernel
def _add(noise: Float32, errors: Float32) -> None:
    """Add the variances that were known before, `noise`; of two, one or both may be NaN.

    An error below 0 is, negated, that of a point that keeps its height: it counts only where
    nothing was known.
    """
    for i in range(len(noise)):
        known = noise[i] == noise[i]
        if errors[i] != errors[i] or (errors[i] < 0.0 and known):
            errors[i] = noise[i]
        elif errors[i] < 0.0:
            errors[i] = -errors[i]
        elif known:
            errors[i] += noise[i]


@inner
def _filter_together(
    grid: PointGrid,
    around: Int64,
    first: int,
    last: int,
    rule: Rule,
    reached: float,
    near: Float64,
    asked: Bool,
    known: Float32,
    height: Float64,
    looked: Float64,
    errors: Float32,
    moves: Float64,
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
    rule : Rule
    reached : float
        How far the neighbours of the last points reached, on average.
    near : float64 (ROWS, M)
        A buffer.
    asked, known, height, looked, errors, moves
        As in `_filter`.

    Returns
    -------
    near : float64 (ROWS, M)
        The buffer, which may have grown.
    reached : float
        How far the neighbours of these points reach, on average, counting points with `max_nb`
        neighbours only; unchanged where there are none.
    """
    xyz, order = grid.xyz, grid.order
    radius, max_nb = rule.radius, rule.max_nb
    low, high = xyz[first, 2], xyz[last - 1, 2]
    # Where points coincide, `reached` may be 0.
    distance = min(max(_FIRST_MARGIN * reached, radius / _NEAREST), radius)
    if max_nb == 0:
        distance = radius
    near, size, own, cut = gather(grid, around, (first, last), (low, high), distance, near)
    reaches, several, done = 0.0, 0, -1
    for i in range(first, last):
        point, z = order[i], xyz[i, 2]
        if len(asked) and not asked[point]:
            continue
        moves_on = len(moves) > 0 and known[point] == known[point]
        if done >= 0 and coincide(xyz, done, i):
            # A point without its twin has the neighbours that its twin has without it.
            twin = order[done]
            if not moves_on or known[twin] == known[twin]:
                height[point], errors[point] = height[twin], errors[twin]
                if len(asked):
                    looked[point] = looked[twin]
                if moves_on:
                    moves[point, 0], moves[point, 1] = moves[twin, 0], moves[twin, 1]
                continue
        new, farthest, error, done, x, y = np.nan, 0.0, np.nan, i, xyz[i, 0], xyz[i, 1]
        for again in (False, True):
            there, there_size, itself = near, size, own + i - first
            if cut and not low <= z <= high:
                there, there_size, itself, _ = gather(
                    grid, around, (i, i + 1), (z, z), distance, np.empty((ROWS, ROOM))
                )
            there, there_size, n, limit = neighbours(
                grid, around, i, z, radius, max_nb, distance, there, there_size, itself
            )
            farthest = max(farthest, limit)
            if 0 < max_nb == n:
                reaches += np.sqrt(limit)
                several += 1
            if not again and not _belongs(there[HEIGHT], n, z, rule):
                if rule.layer_share == 0.0:
                    break
                farthest = radius * radius
                if not stands_out(grid, around, i, rule.radius, rule.level, rule.layer_share):
                    break
            if rule.max_slope > 0.0:
                place = x, y, z
                n, across, unsure = carry(there, there_size, place, limit, radius, rule.max_slope)
                if unsure and rule.layer_share > 0.0:
                    farthest = radius * radius
                    n = -1 if is_pole(grid, around, i, z, radius, rule.level) else n
                error = -across
                if moves_on:
                    dx, dy = 0.0, 0.0
                    if across == across:
                        dx, dy = aside(there, there_size, x, y, limit, radius, rule.across)
                    moves[point, 0], moves[point, 1] = dx, dy
            new = z
            if n >= 0:
                there[HEIGHT, n] = z
                new = middle(there[HEIGHT], there[SQUARED], n + 1)
                error = error_of(new, there[HEIGHT], there[SQUARED], n + 1)
            # Far from its surface a point sees the near side of it only: look from there.
            if not 0 < rule.recentre < abs(new - z):
                break
            z = new
        height[point], errors[point] = new, error
        if len(asked):
            looked[point] = farthest
    return near, reaches / several if several else reached


@inner
def _belongs(heights: Float64, n: int, z: float, rule: Rule) -> bool:
    """Return whether enough of a point's n neighbours, given by their heights, speak for it."""
    speak = 0
    for j in range(n):
        speak += abs(heights[j] - z) <= rule.level
    return bool(speak >= rule.min_nb and speak >= rule.min_share * n)


@inner
def _any_asked(asked: Bool, order: Array, first: int, last: int) -> bool:
    """Return whether any of points `first` to `last` is asked for."""
    if not len(asked):
        return True
    some = False
    for i in range(first, last):
        some |= asked[order[i]]
    return some
