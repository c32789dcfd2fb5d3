"""The parameters that a map depends on besides its points, and contradictions among them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
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
    """The grid, and how the heights in a cell become patches."""

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
    "median": {
        "max_nb": 24,
        "min_nb": 4,
        "recentre": Cells(0.75),
        "level": Cells(1),
        "min_share": 0.3,
        "max_slope": 2.0,
    },
    "orphans": {},
    "walls": {"join": Cells(2)},
    "plaster": {"slope_reach": Cells(2)},
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

    A stage's field that is None takes the value of the parameter named by its `default_from`.

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
        stages_expected = "stages, such as (Median(), Plaster())"
        expect(self.pipeline, Iterable, "pipeline", stages_expected)
        stages = []
        for stage in self.pipeline:
            expect(stage, Stage, "pipeline", stages_expected)
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
        """Return the same parameters with this `cell_size`, checked.

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
    """Yield a fault for each length that spans more than `MAX_INDEX` cells."""
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
    """Return the contradictions within a stage, as far as the values known show them."""
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
            # Lengths that are all in cells compare the same for any size of cell.
            cell_size, gap = 1.0, gap_size.count
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
