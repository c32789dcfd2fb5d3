"""What a robot is: how steep, how high a step and how low a passage it takes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from mlscli.errors import UsageError
from mlscli.maps.surface_map import SurfaceMap
from mlscli.parameters.fields import fields_of, parameter
from mlscli.parameters.lengths import Cells, Length, in_units


@dataclass(frozen=True)
class Robot:
    """A robot that drives, walks or flies through a map.

    Attributes
    ----------
    slope : float
        The steepest slope that it climbs, in degrees.
    step : float or Cells
        The highest step that it climbs.
    headroom : float or Cells or None
        The height that it needs; None: that of the vehicle that the map was built for.
    """

    slope: float = parameter(20.0, "steepest slope, in degrees", low=0.0, high=60.0)
    step: Length = parameter(Cells(0.5), "highest step", low=0.0)
    headroom: Length | None = parameter(
        None, "height that must be open above the floor", above=0.0, default_from="vehicle.height"
    )

    def __post_init__(self) -> None:
        """Refuse what no robot is."""
        for name, field in fields_of(type(self)).items():
            try:
                field.check(getattr(self, name))
            except ValueError as error:
                raise UsageError(f"`{name}`: {error}") from None

    @classmethod
    def of(cls, **given: Any) -> Robot:
        """Return a robot, texts such as ``2 cells`` or ``0.3`` taken for what they say.

        What is None takes its default.

        Raises
        ------
        UsageError
            Where a value is out of range, or none.
        """
        fields = fields_of(cls)
        values = {}
        for name, value in given.items():
            if value is None:
                continue
            try:
                values[name] = fields[name].convert(
                    _number(value) if isinstance(value, str) else value
                )
            except ValueError as error:
                raise UsageError(f"`{name}`: {error}") from None
        return cls(**values)

    def limits(self, surface: SurfaceMap) -> Limits:
        """Return what the robot takes on a map, in the map's unit."""
        headroom = self.headroom
        if headroom is None:
            headroom = _vehicle_height(surface)
        size = surface.cell_size
        return Limits(
            math.tan(math.radians(self.slope)), in_units(self.step, size), in_units(headroom, size)
        )


@dataclass(frozen=True)
class Limits:
    """What a robot takes, in the unit of a map.

    Attributes
    ----------
    slope : float
        Height by length.
    step, headroom : float
        In the unit of the map.
    """

    slope: float
    step: float
    headroom: float

    def rise(self, length: float) -> float:
        """Return by how much heights may differ a length apart: a step, or a slope over it."""
        return max(self.step, self.slope * length)


def _number(text: str) -> object:
    try:
        return float(text)
    except ValueError:
        return text


def _vehicle_height(surface: SurfaceMap) -> Length:
    """Return the height of the vehicle that a map was built for; without one, the gap size.

    Where nothing else is said, the gap is as wide as the vehicle is high.
    """
    parameters = surface.meta.get("parameters")
    vehicle = parameters.get("vehicle") if isinstance(parameters, Mapping) else None
    if isinstance(vehicle, Mapping) and "height" in vehicle:
        try:
            height: Length = Robot.of(headroom=vehicle["height"]).headroom or Cells(3)
        except UsageError:
            pass
        else:
            return height
    return surface.gap_size or Cells(3)
