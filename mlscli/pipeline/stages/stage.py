"""The base classes of stages: frozen dataclasses of parameters that apply themselves.

A stage turns its whole input into its whole output and declares its *reach*: how many cells away
an input can still change a result. A caller may therefore evaluate it in some cells only: given all
input within its reach of them, it returns the same patches there as given the whole input.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, NamedTuple, Self

import numpy as np

from mlscli.keyframes.batches import Points
from mlscli.maps.cells import Limits
from mlscli.parameters.fields import parameter
from mlscli.parameters.lengths import Length
from mlscli.runtime.arrays import Bool, Float32, Float64
from mlscli.runtime.kernels import kernel

if TYPE_CHECKING:
    from mlscli.maps.surface_map import SurfaceMap
    from mlscli.pipeline.stages.sights import Sights


class Fault(NamedTuple):
    """Parameters of one stage that contradict each other.

    Attributes
    ----------
    field : str
        The name of the parameter to blame.
    message : str
        Its value, what is wrong with it, and what would be right.
    """

    field: str
    message: str


@dataclass(frozen=True)
class Stage:
    """A step of the pipeline with its parameters."""

    name: ClassVar[str]

    def faults(self, cell_size: float | None, gap_size: Length | None) -> Iterator[Fault]:  # noqa: ARG002
        """Yield contradictions among the parameters.

        Parameters
        ----------
        cell_size : float or None
            Side of a cell, in the unit of the recording; None: not yet known.
        gap_size : float, Cells or None
            The map's `gap_size`; None: not yet known.
        """
        yield from ()


class Evaluated(NamedTuple):
    """What becomes of points; undefined for those that were not asked for.

    Attributes
    ----------
    xyz : float64 (N, 3)
        Where each point is placed, in the unit of the recording; a height of NaN: it is dropped.
        An array of its own, but where all points stay as they are.
    looked : float64 (N,)
        The square of the distance up to which the stage looked for others: a point farther away in
        x and y cannot change the result. Empty where no mask of points was given.
    noise : float32 (N,)
        Variance of the error of each new height, as in `Points`.
    """

    xyz: Float64
    looked: Float64
    noise: Float32


@dataclass(frozen=True)
class PointStage(Stage):
    """A stage that reads and writes points."""

    @property
    def acts(self) -> bool:
        """Whether it does anything with its parameters; if not, it is left out."""
        return True

    @abstractmethod
    def reach(self, cell_size: float) -> int:
        """Return how many cells away from a cell a point can change what is placed there.

        A stage that moves points to other cells moves them by no more than half of that.
        """

    @abstractmethod
    def evaluate(
        self,
        points: Points,
        cell_size: float,
        asked: Bool | None = None,
        progress: Callable[[int], None] | None = None,
    ) -> Evaluated:
        """Return what becomes of each point.

        Parameters
        ----------
        points : Points
            The points asked for, and all others within the stage's reach of them.
        cell_size : float
            Side of a cell, in the unit of the recording.
        asked : bool (N,), optional
            The points to evaluate; by default all.
        progress : callable, optional
            Called with the number of points done, now and then.
        """

    def apply(
        self, points: Points, cell_size: float, progress: Callable[[int], None] | None = None
    ) -> Points:
        """Return the points that stay, in their order, where the stage places them."""
        xyz, _, noise = self.evaluate(points, cell_size, progress=progress)
        stays = ~np.isnan(xyz[:, 2])
        if stays.all():
            return points._replace(xyz=xyz, noise=noise)
        keyframe, sight, noise = points.keyframe[stays], points.sight[stays], noise[stays]
        return Points(xyz[: _close_up(xyz, stays)], keyframe, sight, noise)


@kernel
def _close_up(xyz: Float64, stays: Bool) -> int:
    """Move the points that stay to the front, which takes no memory; return how many they are."""
    size = 0
    for i in range(len(xyz)):
        if stays[i]:
            for axis in range(3):
                xyz[size, axis] = xyz[i, axis]
            size += 1
    return size


@dataclass(frozen=True)
class MapStage(Stage):
    """A stage that reads and writes a map.

    Inside the limits the map becomes what the stage makes of it without limits; cells outside
    stay as they were.
    """

    min_x: int | None = parameter(None, "least cell index in x that the stage changes")
    max_x: int | None = parameter(None, "greatest cell index in x that the stage changes")
    min_y: int | None = parameter(None, "least cell index in y that the stage changes")
    max_y: int | None = parameter(None, "greatest cell index in y that the stage changes")

    def faults(self, cell_size: float | None, gap_size: Length | None) -> Iterator[Fault]:  # noqa: ARG002
        """Yield a fault where the limits leave no cell between them."""
        for axis in "xy":
            least, greatest = getattr(self, f"min_{axis}"), getattr(self, f"max_{axis}")
            if least is not None and greatest is not None and least > greatest:
                yield Fault(f"min_{axis}", f"{least} is above max_{axis} ({greatest})")

    @abstractmethod
    def reach(self, cell_size: float) -> int | None:
        """Return how many cells away a patch can still change a result; None: any number."""

    def for_gaps(self, gap_size: float, cell_size: float) -> Self:  # noqa: ARG002
        """Return the stage as it is for maps with such gaps: without what does nothing there.

        Parameters
        ----------
        gap_size, cell_size : float
            In the unit of the recording.
        """
        return self

    def sight_reach(self, cell_size: float) -> int:  # noqa: ARG002
        """Return how many cells away a point's sight line can still change a result; 0: none can.

        A stage that follows sight lines overrides it, and `transform_seen`.
        """
        return 0

    @abstractmethod
    def transform(self, surface: SurfaceMap) -> SurfaceMap:
        """Return what the stage makes of the whole map, without limits."""

    def transform_seen(self, surface: SurfaceMap, sights: Sights) -> SurfaceMap:  # noqa: ARG002
        """Return what the stage makes of the whole map, given sight lines, without limits."""
        return self.transform(surface)

    def apply(self, surface: SurfaceMap, sights: Sights | None = None) -> SurfaceMap:
        """Return the map after the stage, within its limits; without sight lines none are known."""
        limits = self.limits
        if limits == Limits():
            return self._transformed(surface, sights)
        reach = self.reach(surface.cell_size)
        source = surface if reach is None else surface.crop(*limits.widened(reach))
        outside = surface.take(~limits.contain(surface.ix, surface.iy))
        return outside.union(self._transformed(source, sights).crop(*limits))

    def _transformed(self, surface: SurfaceMap, sights: Sights | None) -> SurfaceMap:
        return self.transform(surface) if sights is None else self.transform_seen(surface, sights)

    @property
    def limits(self) -> Limits:
        """The cells that the stage may change."""
        return Limits(self.min_x, self.max_x, self.min_y, self.max_y)
