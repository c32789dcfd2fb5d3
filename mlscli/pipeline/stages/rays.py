"""Points moved along their rays: the noise of depths that were triangulated.

Where a point was seen from is known: its direction is exact, and its depth errs, in proportion to
the square of the depth, as triangulation errs (Gallup et al., Variable baseline/resolution stereo,
CVPR 2008, doi:10.1109/CVPR.2008.4587671). So its true place lies on its ray, where the surface of
the points around the ray crosses it.

The standard deviation of a depth d is ``noise * d * d``. Neighbours of a point are the points
within `radius` of its ray, up to `reach` before and behind it; of more than `max_nb` the nearest to
the ray count, and those at the distance of the last. Nearness across the ray says nothing of how
depths err: the noise does not choose the neighbours. Points that are twice as uncertain do not
count: far sights do not outvote near ones.

A plane is fitted to the neighbours within three standard deviations, and four times again to those
within one and a half of it. Where at least `min_nb` of the neighbours, and the share `min_share` of
them, lie so close to it, and the point itself, the point is moved along its ray by the median of
their depths, carried along the plane to the ray. Where they do not, the point is dropped: a wrong
correspondence, or a point in the air. Surfaces of any slope are treated alike: a wall stays a wall
while a floor becomes a floor.

Points stay where they are if their standard deviation is below a tenth of a cell, or not known.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import ClassVar, Literal, NamedTuple

import numpy as np

from mlscli.keyframes.batches import Points
from mlscli.maps.cells import on_grid
from mlscli.parameters.fields import parameter
from mlscli.parameters.lengths import Cells, Length, in_units, whole_cells
from mlscli.pipeline.stages.beam import ROOM, ROWS, SQUARED, Ray, Seen, around, crossing
from mlscli.pipeline.stages.nearest import nth_of
from mlscli.pipeline.stages.point_grid import PointGrid
from mlscli.pipeline.stages.stage import Evaluated, Fault, PointStage
from mlscli.runtime.arrays import Bool, Float32, Float64
from mlscli.runtime.kernels import kernel
from mlscli.runtime.threads import in_ranges

# Points that err by less, in cells, stay; and the noise of a neighbour may move it across the ray
# by so many cells.
_LEAST, _ACROSS = 0.1, 0.5
# Standard deviations within which neighbours are taken for the first plane.
_WINDOW = 3.0
# How much farther from the ray than the last point's neighbours the next ones are sought at first,
# and how much the search grows.
_MARGIN, _GROWTH = 1.4, 1.5
# The variance of the median of n values of a normal distribution cut off at one and a half standard
# deviations is so many times theirs, divided by n.
_OF_MEDIAN = 1.178
# The search begins with no less than the radius divided by this.
_NEAREST = 64


@dataclass(frozen=True)
class Rays(PointStage):
    """Move each point along the ray on which it was seen to the surface there, or drop it."""

    name: ClassVar[str] = "rays"

    noise: float | Literal["auto"] = parameter(
        "auto",
        "standard deviation of a depth of 1, which grows with the square of the depth; "
        "auto: from the recording; 0: points stay",
        low=0,
    )
    depth: Length = parameter(
        Cells(4), "how far before and behind a point, along its ray, neighbours are sought", above=0
    )
    radius: Length = parameter(Cells(2), "how far from its ray neighbours are sought", above=0)
    max_nb: int = parameter(24, "most neighbours that count, the nearest to the ray first", low=4)
    min_nb: int = parameter(
        8, "a point near whose ray fewer neighbours form a surface is dropped", low=4
    )
    min_share: float = parameter(
        0.4,
        "a point is dropped where a smaller share of its neighbours forms a surface",
        low=0,
        high=1,
    )

    def faults(self, cell_size: float | None, gap_size: Length | None) -> Iterator[Fault]:  # noqa: ARG002
        """Yield a fault where no point could have enough neighbours."""
        if self.max_nb < self.min_nb:
            yield Fault(
                "min_nb",
                f"{self.min_nb} is above max_nb ({self.max_nb}), so that every point would be "
                f"dropped; at most {self.max_nb}",
            )

    @property
    def acts(self) -> bool:
        """Whether depths are known to err."""
        return self.noise not in ("auto", 0)

    def reach(self, cell_size: float) -> int:
        """Return how far neighbours are sought, and how far a point may move, in whole cells."""
        if not self.acts:
            return 0
        depth, radius = in_units(self.depth, cell_size), in_units(self.radius, cell_size)
        # And one more each: points can lie at their cells' edges.
        sought = whole_cells(float(np.hypot(depth, radius)), cell_size) + 1
        return sought + whole_cells(depth / 2, cell_size) + 1

    def evaluate(
        self,
        points: Points,
        cell_size: float,
        asked: Bool | None = None,
        progress: Callable[[int], None] | None = None,
    ) -> Evaluated:
        """Return where points are moved to; see `PointStage.evaluate`."""
        looked = np.zeros(0 if asked is None else points.size)
        if not self.acts:
            return Evaluated(points.xyz, looked, points.noise)
        distance = np.sqrt((points.sight.astype(np.float64) ** 2).sum(axis=1))
        with np.errstate(over="ignore"):
            # Of how far a point may lie, all that counts is whether it exceeds the search.
            sigma = np.nan_to_num(float(self.noise) * distance * distance)
        known = distance > 0.0
        ahead = np.zeros_like(points.xyz)
        ahead[known] = points.sight[known] / distance[known, None]
        with np.errstate(over="ignore"):
            upwards = (sigma * ahead[:, 2]) ** 2
            noise = np.where(known, upwards, np.nan).astype(np.float32)
        uncertain = sigma > _LEAST * cell_size
        if asked is not None:
            uncertain &= asked
        if not uncertain.any():
            return Evaluated(points.xyz, looked, noise)
        xyz = points.xyz.copy()
        rule = Rule(
            in_units(self.depth, cell_size),
            in_units(self.radius, cell_size),
            _ACROSS * cell_size,
            self.max_nb,
            self.min_nb,
            float(self.min_share),
        )
        grid = PointGrid.of(points.xyz, rule.radius)
        seen = Seen(ahead[grid.order], sigma[grid.order])

        def move(begin: int, end: int) -> None:
            _move(grid, seen, *grid.columns(begin, end), rule, uncertain, xyz, looked, noise)

        in_ranges(points.size, move, progress)
        outside = np.flatnonzero(~on_grid(xyz, cell_size))
        xyz[outside] = points.xyz[outside]
        return Evaluated(xyz, looked, noise)


class Rule(NamedTuple):
    """The parameters of the stage, lengths in the unit of the points.

    Attributes
    ----------
    depth, radius : float
        How far along the ray, and how far from it, neighbours are sought.
    across : float
        How far across the ray the noise of a neighbour may move it.
    max_nb, min_nb : int
        The most neighbours that count, and the fewest that form a surface.
    min_share : float
        The least share of them that forms one.
    """

    depth: float
    radius: float
    across: float
    max_nb: int
    min_nb: int
    min_share: float


@kernel
def _move(
    grid: PointGrid,
    seen: Seen,
    begin: int,
    end: int,
    rule: Rule,
    uncertain: Bool,
    xyz: Float64,
    looked: Float64,
    noise: Float32,
) -> None:
    """Move those points of columns `begin` to `end` that are uncertain.

    Parameters
    ----------
    grid : PointGrid
        All points, by columns.
    seen : Seen
    begin, end : int
        Range of columns.
    rule : Rule
    uncertain : bool (N,)
        The points to move.
    xyz : float64 (N, 3)
        The points; receives where they are moved to, and a height of NaN where they are dropped.
    looked : float64 (N,) or (0,)
        Receives the squares of how far the search went; not used where it is empty.
    noise : float32 (N,)
        The variances of the heights' errors; receives those of points that are moved.
    """
    near = np.empty((ROWS, ROOM))
    found = rule.radius
    for number in range(grid.first[begin], grid.first[end]):
        for i in range(grid.fine[number], grid.fine[number + 1]):
            point = grid.order[i]
            if not uncertain[point]:
                continue
            ray = Ray(
                (grid.xyz[i, 0], grid.xyz[i, 1], grid.xyz[i, 2]),
                (seen.ahead[i, 0], seen.ahead[i, 1], seen.ahead[i, 2]),
                seen.sigma[i],
            )
            radius = min(max(_MARGIN * found, rule.radius / _NEAREST), rule.radius)
            near, size = around(grid, seen, ray, i, (rule.depth, radius, rule.across), near)
            while size < rule.max_nb and radius < rule.radius:
                radius = min(_GROWTH * radius, rule.radius)
                near, size = around(grid, seen, ray, i, (rule.depth, radius, rule.across), near)
            limit, count = radius * radius, size
            if size > rule.max_nb:
                squared = near[SQUARED, :size].copy()
                limit = nth_of(squared, squared, size, rule.max_nb - 1)
                found = np.sqrt(limit)
                count = 0
                for j in range(size):
                    count += near[SQUARED, j] <= limit
            if len(looked):
                far = rule.depth + radius
                looked[point] = far * far
            window = min(_WINDOW * seen.sigma[i], rule.depth)
            needed = max(float(rule.min_nb), rule.min_share * count)
            beyond, several = crossing(near, size, limit, rule.depth, window, needed)
            xyz[point, 2] += beyond * ray.ahead[2]
            if beyond == beyond:
                xyz[point, 0] += beyond * ray.ahead[0]
                xyz[point, 1] += beyond * ray.ahead[1]
                noise[point] *= np.float32(_OF_MEDIAN / several)
