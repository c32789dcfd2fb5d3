"""The parameters that a map depends on besides its points, and what contradicts what."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import nullcontext, suppress
from dataclasses import dataclass, field, replace
from typing import Any, Literal, NamedTuple

from mlscli.errors import ConfigError, expect
from mlscli.parameters.fields import UNKNOWN, fields_of, json_value, parameter, write_value
from mlscli.parameters.lengths import Cells, Length
from mlscli.pipeline.stages.registry import STAGES
from mlscli.pipeline.stages.stage import Fault, PointStage, Stage

# Cell indices are int32.
MAX_INDEX = 2**31 - 1


@dataclass(frozen=True)
class Vehicle:
    """The craft that is to fly through the map."""

    width: Length = parameter(Cells(1), "width of the craft: it cannot pass narrower gaps", above=0)
    height: Length = parameter(Cells(3), "height of the craft: it cannot pass lower ones", above=0)


@dataclass(frozen=True)
class MapParameters:
    """The grid, and what makes one patch of the heights in a cell."""

    cell_size: float | Literal["auto"] = parameter(
        "auto", "side of a cell; auto: from the distances of the recording's points", above=0
    )
    gap_size: Length = parameter(
        Cells(3), "heights farther apart are two patches", low=0, default_from="vehicle.height"
    )
    thickness: Length = parameter(Cells(1), "a patch that spreads wider is vertical", low=0)


@dataclass(frozen=True)
class BatchParameters:
    """How often the map is brought up to date."""

    min_points: int = parameter(80, "points to gather before a batch is processed", low=1)


SECTIONS = {"vehicle": Vehicle, "map": MapParameters, "batch": BatchParameters}
DEFAULT_PIPELINE: dict[str, dict[str, Any]] = {
    "median": {"recentre": Cells(0.75)},
    "orphans": {},
    "walls": {"join": Cells(2)},
    "plaster": {"slope_reach": Cells(2)},
    "pyramids": {"pits": True},
}
"""The stages where none are named, with the rules that better the thesis's (benchmarks/README.md).

A stage that is named follows the thesis's rules as far as nothing else is said.
"""


def _default_pipeline() -> tuple[Stage, ...]:
    return tuple(STAGES[name](**chosen) for name, chosen in DEFAULT_PIPELINE.items())


@dataclass(frozen=True)
class Parameters:
    """All that a map depends on besides its points.

    A stage's field that is None takes the value of the parameter named by its `default_from`.

    Attributes
    ----------
    mode : {"consistent", "sequential"}
        How the map grows from batch to batch.
    vehicle : Vehicle
    map : MapParameters
    batch : BatchParameters
    pipeline : tuple of Stage
        The stages, in order; what works on points comes first.
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
        for stage in self.pipeline:
            expect(stage, Stage, "pipeline", "stages, such as (Median(), Plaster())")
        stages = []
        for stage in self.pipeline:
            missing = {
                item.name: self._in_force(item.default_from)
                for item in fields_of(type(stage)).values()
                if item.default_from is not None and getattr(stage, item.name) is None
            }
            stages.append(replace(stage, **missing))
        object.__setattr__(self, "pipeline", tuple(stages))

    def _in_force(self, path: str) -> Any:
        section, name = path.split(".")
        return getattr(getattr(self, section), name)

    def with_cell_size(self, cell_size: float) -> Parameters:
        """Return the same parameters with a cell size in numbers, checked with it.

        Raises
        ------
        ConfigError
            Where a value is out of range or two contradict each other, now that lengths in
            units and in cells can be compared.
        """
        settled = replace(self, map=replace(self.map, cell_size=cell_size))
        settled.check()
        return settled

    def check(self) -> None:
        """Check every value and what they say together.

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


class Contradiction(NamedTuple):
    """A fault that only shows when several parameters are seen together.

    Attributes
    ----------
    part : str
        The section or stage that it is found in.
    stage : int or None
        The place in the pipeline; None in a section.
    field : str
        The parameter to change; empty: all of the part.
    message : str
    """

    part: str
    stage: int | None
    field: str
    message: str


def contradictions(parameters: Parameters) -> Iterator[Contradiction]:
    """Yield what the parameters say against each other, all of them in range by themselves."""
    cell_size = parameters.map.cell_size
    size = cell_size if isinstance(cell_size, int | float) else None
    for name in SECTIONS:
        for fault in _too_long(getattr(parameters, name), size):
            yield Contradiction(name, None, *fault)
    map_stage = ""
    for index, stage in enumerate(parameters.pipeline):
        if not isinstance(stage, PointStage):
            map_stage = map_stage or stage.name
        elif map_stage:
            message = f"works on points but stands after {map_stage}, which works on the map"
            yield Contradiction(stage.name, index, "", f"{message}; put it before")
        faults = list(_too_long(stage, size))
        for fault in faults or _stage_faults(stage, size, parameters.map.gap_size):
            yield Contradiction(stage.name, index, *fault)


def _too_long(part: object, cell_size: float | None) -> Iterator[Fault]:
    """Yield the lengths that span more cells than can be numbered."""
    for item in fields_of(type(part)).values():
        length = getattr(part, item.name)
        if item.name == "cell_size" or length is UNKNOWN or length is None:
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


def _stage_faults(stage: Stage, cell_size: float | None, gap_size: Length) -> list[Fault]:
    """Return a stage's own faults, as far as they follow from what is known."""
    values = [getattr(stage, name) for name in fields_of(type(stage))]
    gap = gap_size if isinstance(gap_size, int | float) else None
    if isinstance(gap_size, Cells):
        gap = None if cell_size is None else gap_size.count * cell_size
        lengths = [
            value
            for item, value in zip(fields_of(type(stage)).values(), values, strict=True)
            if Cells in item.kinds and value is not None
        ]
        if cell_size is None and all(isinstance(value, Cells) for value in lengths):
            # Where all lengths are in cells, they compare alike whatever the size of a cell.
            cell_size, gap = 1.0, gap_size.count
    faults: list[Fault] = []
    # A comparison with a value at fault fails, and what it would have told is not known.
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
