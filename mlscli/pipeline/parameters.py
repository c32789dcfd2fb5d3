"""The parameters that a map depends on besides its points, and contradictions among them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from contextlib import nullcontext, suppress
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, Literal, NamedTuple

from mlscli.errors import ConfigError, UsageError, expect
from mlscli.maps.grid import Grid
from mlscli.parameters.fields import UNKNOWN, fields_of, json_value, parameter, write_value
from mlscli.parameters.lengths import (
    LARGEST_CELL,
    SMALLEST_CELL,
    Cells,
    Length,
    in_units,
)
from mlscli.pipeline.stages.rays import Rays
from mlscli.pipeline.stages.regions import Regions
from mlscli.pipeline.stages.registry import STAGES
from mlscli.pipeline.stages.stage import Fault, PointStage, Stage

# Cell indices are int32.
MAX_INDEX = 2**31 - 1

AUTO = "auto"
"""The value of a size that the points of the recording decide, see `mlscli.building.sizes`."""

# The attribute in which a completed section or stage remembers what was given.
_GIVEN = "_given"


@dataclass(frozen=True)
class Vehicle:
    """The craft that is to fly through the map."""

    width: Length = parameter(Cells(1), "width of the craft: it cannot pass narrower gaps", above=0)
    height: Length = parameter(Cells(3), "height of the craft: it cannot pass lower ones", above=0)

    def in_units(self, cell_size: float) -> dict[str, float]:
        """Return ``width`` and ``height`` in the unit of the recording."""
        return {name: in_units(getattr(self, name), cell_size) for name in ("width", "height")}


@dataclass(frozen=True)
class MapParameters:
    """The grid, and how the heights in a cell become patches."""

    cell_size: float | Literal["auto"] = parameter(
        "auto",
        "side of a cell; auto: from the distances of the recording's points",
        low=SMALLEST_CELL,
        high=LARGEST_CELL,
    )
    gap_size: Length | Literal["auto"] | None = parameter(
        "auto",
        "heights farther apart are two patches; null: the vehicle's height; auto: this, or less "
        "where the recording's points lie on hardly any walls",
        low=0,
        default_from="vehicle.height",
    )
    thickness: Length = parameter(Cells(1), "a patch that spreads wider is vertical", low=0)
    free_space: bool = parameter(False, "also keep what space sight lines passed through")


@dataclass(frozen=True)
class BatchParameters:
    """How often the map is brought up to date."""

    min_points: int = parameter(80, "points to gather before a batch is processed", low=1)


SECTIONS = {"vehicle": Vehicle, "map": MapParameters, "batch": BatchParameters}
DEFAULT_PIPELINE: dict[str, dict[str, Any]] = {
    "rays": {},
    "median": {
        "max_nb": 24,
        "min_nb": 4,
        "recentre": Cells(0.75),
        "level": Cells(0.75),
        "min_share": 0.4,
        "layer_share": 0.3,
        "max_slope": 2.0,
        "across": Cells(0.75),
    },
    "orphans": {"horizontal": Cells(4), "vertical": Cells(2), "min_share": 0.03},
    "walls": {"join": Cells(2), "along": Cells(3), "support": 1, "pieces": None},
    "plaster": {"slope_reach": Cells(2), "support": 2, "over_lower": False, "sight": Cells(6)},
    "pyramids": {"pits": True},
}
"""The stages by default, with rules that improve on the thesis's (see benchmarks/README.md).

A stage that a configuration names follows the thesis's rules unless its parameters say otherwise.
"""


def _default_pipeline() -> tuple[Stage, ...]:
    return tuple(STAGES[name](**chosen) for name, chosen in DEFAULT_PIPELINE.items())


@dataclass(frozen=True)
class Parameters:
    """All that a map depends on besides its points.

    A field that is None takes the value of the parameter that its `default_from` names, as soon as
    it is known. What is ``auto`` is chosen by the points of a recording, see `mlscli.fit_sizes`.

    Attributes
    ----------
    mode : {"consistent", "sequential"}
        How the map grows from batch to batch.
    vehicle : Vehicle
    map : MapParameters
    batch : BatchParameters
    pipeline : tuple of Stage
        The stages, in order; those that work on points come first.
    """

    mode: Literal["consistent", "sequential"] = parameter(
        "consistent", "grow the map as one pass over all points would, or batch by batch"
    )
    vehicle: Vehicle = field(default_factory=Vehicle)
    map: MapParameters = field(default_factory=MapParameters)
    batch: BatchParameters = field(default_factory=BatchParameters)
    pipeline: tuple[Stage, ...] = field(default_factory=_default_pipeline)

    def __post_init__(self) -> None:
        for name, section in SECTIONS.items():
            kind = section.__name__
            expect(getattr(self, name), section, name, f"{kind}, such as {kind}()")
            object.__setattr__(self, name, self._completed(getattr(self, name)))
        stages_expected = "stages, such as (Median(), Plaster())"
        expect(self.pipeline, Iterable, "pipeline", stages_expected)
        stages = []
        for stage in self.pipeline:
            expect(stage, Stage, "pipeline", stages_expected)
            stages.append(self._completed(stage))
        object.__setattr__(self, "pipeline", tuple(stages))

    def _completed(self, part: Any) -> Any:
        """Return a section or a stage with what is not given taken from where it follows.

        It remembers what was given: beside another vehicle, or with another cell size, it is
        completed anew.
        """
        given = part = _as_given(part)
        for item in fields_of(type(part)).values():
            if item.default_from is not None and getattr(part, item.name) is None:
                followed = self.value(item.default_from, part)
                part = replace(part, **{item.name: item.following(followed, self._cell_size)})
        if part is not given:
            object.__setattr__(part, _GIVEN, given)
        return part

    def value(self, path: str, part: object) -> Any:
        """Return the value of a parameter: of a section by its full name, or else of `part`."""
        section, _, name = path.rpartition(".")
        return getattr(getattr(self, section) if section else part, name)

    @property
    def _cell_size(self) -> float | None:
        """Side of a cell, in the unit of the recording; None where it is not known."""
        size = self.map.cell_size
        return size if isinstance(size, int | float) else None

    def grid(self, frame_id: str = "map") -> Grid:
        """Return the grid of the map, all of it in the unit of the recording.

        A `gap_size` of ``auto`` counts as the vehicle's height, the most that it becomes.

        Raises
        ------
        UsageError
            Where `cell_size` is ``auto``.
        """
        size, gap_size = self._cell_size, _greatest_gap_size(self)
        if size is None or gap_size is None:
            raise UsageError(
                "map.cell_size: a growing map needs a number, not auto; "
                "see Parameters.with_cell_size"
            )
        return Grid(size, in_units(gap_size, size), in_units(self.map.thickness, size), frame_id)

    @property
    def lacks_sizes(self) -> bool:
        """Whether the points of a recording choose the size of a cell, or of a gap."""
        return self._cell_size is None or self.map.gap_size == AUTO

    def with_cell_size(self, cell_size: float, gap_size: float | None = None) -> Parameters:
        """Return the same parameters with this `cell_size`, checked.

        Parameters
        ----------
        cell_size : float
            Side of a cell, in the unit of the recording.
        gap_size : float, optional
            What takes the place of ``auto``, in that unit; by default the vehicle's height.

        Raises
        ------
        ConfigError
            Where a value is out of range or two contradict each other, now that lengths in
            units and in cells can be compared.
        """
        grid = replace(_as_given(self.map), cell_size=cell_size)
        return replace(self, map=grid).with_gap_size(gap_size)

    def with_gap_size(self, gap_size: float | None = None) -> Parameters:
        """Return the same parameters with a number for a `gap_size` of ``auto``, checked.

        Parameters
        ----------
        gap_size : float, optional
            In the unit of the recording; by default the vehicle's height.

        Raises
        ------
        ConfigError
            As for `with_cell_size`.
        """
        settled = self
        if self.map.gap_size == AUTO:
            settled = replace(self, map=replace(_as_given(self.map), gap_size=gap_size))
        settled.check()
        return settled

    def with_free_space(self) -> Parameters:
        """Return the same parameters, with which a map keeps the free space, too."""
        return replace(self, map=replace(_as_given(self.map), free_space=True))

    @property
    def lacks_noise(self) -> bool:
        """Whether a stage needs to know how the depths of the recording err."""
        return any(isinstance(stage, Rays) and stage.noise == "auto" for stage in self.pipeline)

    @property
    def moves_along_rays(self) -> bool:
        """Whether it is known how depths err, so that a stage moves points along their rays."""
        return any(
            isinstance(stage, Rays) and isinstance(stage.noise, int | float) and stage.noise > 0
            for stage in self.pipeline
        )

    def with_noise(self, noise: float) -> Parameters:
        """Return the same parameters with this `noise` for each stage `rays` that has ``auto``."""
        return replace(
            self,
            pipeline=tuple(
                replace(stage, noise=noise)
                if isinstance(stage, Rays) and stage.noise == "auto"
                else stage
                for stage in self.pipeline
            ),
        )

    def check(self) -> None:
        """Check every value, and that none contradict each other.

        Raises
        ------
        ConfigError
            With every fault, each led by the parameter's name.
        """
        parts = [("", self), *((name, getattr(self, name)) for name in SECTIONS)]
        parts += [(stage.name, stage) for stage in self.pipeline]
        faults = []
        for part_name, part in parts:
            for item in fields_of(type(part)).values():
                try:
                    item.check(getattr(part, item.name))
                except ValueError as error:
                    faults.append(f"{dotted(part_name, item.name)}: {error}")
        if not faults:
            faults = [f"{dotted(c.part, c.field)}: {c.message}" for c in contradictions(self)]
        if faults:
            raise ConfigError(faults)


def _as_given(part: Any) -> Any:
    """Return a section or a stage as it was before it was completed."""
    return getattr(part, _GIVEN, part)


class Contradiction(NamedTuple):
    """A fault that shows only when several parameters are seen together.

    Attributes
    ----------
    part : str
        The name of the section or stage at fault.
    stage : int or None
        The index of the stage in the pipeline; None for a section.
    field : str
        The parameter to change; empty: the part as a whole.
    message : str
        What is wrong, and what would be right.
    """

    part: str
    stage: int | None
    field: str
    message: str


def contradictions(parameters: Parameters) -> Iterator[Contradiction]:
    """Yield the contradictions among parameters, each of which is in range by itself."""
    cell_size = parameters.map.cell_size
    size = cell_size if isinstance(cell_size, int | float) else None
    gap_size = _greatest_gap_size(parameters)
    for name in SECTIONS:
        for fault in _too_long(parameters, getattr(parameters, name), size):
            yield Contradiction(name, None, *fault)
    map_stage = ""
    for index, stage in enumerate(parameters.pipeline):
        if not isinstance(stage, PointStage):
            map_stage = map_stage or stage.name
        elif map_stage:
            message = f"works on points but stands after {map_stage}, which works on the map"
            yield Contradiction(stage.name, index, "", f"{message}; put it before")
        faults = list(_too_long(parameters, stage, size))
        for fault in faults or _stage_faults(stage, size, gap_size):
            yield Contradiction(stage.name, index, *fault)
    yield from _out_of_sight(parameters.pipeline)


def _out_of_sight(pipeline: Sequence[Stage]) -> Iterator[Contradiction]:
    """Yield a contradiction for stages that follow sight lines where only the map is left."""
    after = ""
    for index, stage in enumerate(pipeline):
        sight = getattr(stage, "sight", UNKNOWN)
        if after and sight is not UNKNOWN and in_units(sight, 1.0) > 0:
            message = f"sight lines cannot be followed after {after}, which needs the whole map"
            yield Contradiction(stage.name, index, "sight", f"{message}; 0, or put it before")
        if isinstance(stage, Regions):
            after = stage.name


def _greatest_gap_size(parameters: Parameters) -> Length | None:
    """Return the gap size; where the points decide, the vehicle's height, which is the most."""
    gap_size = parameters.map.gap_size
    return parameters.vehicle.height if isinstance(gap_size, str) else gap_size


def conditional_faults(parameters: Parameters) -> list[str]:
    """Return the contradictions that arise for some sizes of cells only, where these are ``auto``.

    Each is led by these sizes: ``cells smaller than 0.25: plaster.max_gap_enhanced: 2 cells ...``.
    """
    if parameters.map.cell_size != AUTO:
        return []
    # The sizes of cells at which a length in cells becomes longer than one in units.
    grid = replace(parameters.map, gap_size=_greatest_gap_size(parameters))
    turns = sorted({turn for each in parameters.pipeline for turn in _turns(grid, each)})
    sizes = [low + (high - low) / 2 for low, high in pairwise([0.0, *turns])]
    sizes += [2 * turn for turn in turns[-1:]]
    found: dict[str, list[int]] = {}
    for number, size in enumerate(sizes):
        settled = replace(parameters, map=replace(_as_given(parameters.map), cell_size=size))
        for each in contradictions(settled):
            found.setdefault(f"{dotted(each.part, each.field)}: {each.message}", []).append(number)
    return [
        f"cells larger than {turns[there[0] - 1]:g}: {fault}"
        if there[-1] == len(turns)
        else f"cells smaller than {turns[there[-1]]:g}: {fault}"
        for fault, there in found.items()
    ]


def _turns(*parts: object) -> Iterator[float]:
    """Yield the size of cells at which each length in cells equals each length in units."""
    lengths = [getattr(part, name) for part in parts for name in _lengths_of(type(part))]
    for units in lengths:
        for cells in lengths:
            if isinstance(cells, Cells) and isinstance(units, int | float) and units * cells.count:
                yield units / cells.count


def _lengths_of(owner: type) -> list[str]:
    return [name for name, item in fields_of(owner).items() if Cells in item.kinds]


def _too_long(parameters: Parameters, part: object, cell_size: float | None) -> Iterator[Fault]:
    """Yield a fault for each length of a part that spans more than `MAX_INDEX` cells.

    One that follows another parameter is not to blame: that one is.
    """
    for item in fields_of(type(part)).values():
        length = getattr(part, item.name)
        if item.name == "cell_size" or length is UNKNOWN or length is None or length == AUTO:
            continue
        if item.default_from is not None and parameters.value(item.default_from, part) == length:
            continue
        if isinstance(length, Cells):
            units = length.count * (cell_size or 1.0)
            cells = length.count
        elif Cells in item.kinds and cell_size is not None:
            units = length
            cells = length / cell_size
        else:
            continue
        if cells > MAX_INDEX or math.isinf(units):
            message = f"{write_value(length)} spans {cells:g} cells; at most {MAX_INDEX}"
            yield Fault(item.name, message)


def _stage_faults(stage: Stage, cell_size: float | None, gap_size: Length | None) -> list[Fault]:
    """Return the contradictions within a stage, as far as the values known show them."""
    values = [getattr(stage, name) for name in fields_of(type(stage))]
    gap = None if gap_size is UNKNOWN else gap_size
    faults: list[Fault] = []
    # A comparison with an invalid value raises TypeError; faults after it are not found.
    with suppress(TypeError) if UNKNOWN in values else nullcontext():
        for fault in stage.faults(cell_size, gap):
            faults.append(fault)
    return [fault for fault in faults if getattr(stage, fault.field) is not UNKNOWN]


def dotted(part: str, parameter_name: str) -> str:
    """Return the full name of a parameter."""
    return ".".join(filter(None, (part, parameter_name)))


def to_dict(parameters: Parameters) -> dict[str, Any]:
    """Return the parameters as JSON can hold them: lengths as numbers or ``N cells``."""
    top = {name: json_value(getattr(parameters, name)) for name in fields_of(Parameters)}
    sections = {name: _plain(getattr(parameters, name)) for name in SECTIONS}
    stages = [{stage.name: _plain(stage)} for stage in parameters.pipeline]
    return {**top, **sections, "pipeline": stages}


def _plain(part: object) -> dict[str, Any]:
    return {name: json_value(getattr(part, name)) for name in fields_of(type(part))}
