"""Scenes: plane rectangles with openings, put together from horizontal and vertical ones.

The building blocks are those of the thesis's section 5.2: a surface has a position, a size, an
orientation, a grade, and a Gaussian scatter of its points. Lengths are in the unit of the scene.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from mlscli.runtime.arrays import Float64

Vector = tuple[float, float, float]


class Rectangle(NamedTuple):
    """A part of a surface.

    Attributes
    ----------
    a_low, a_high : float
        Where it begins and ends along the edge `along`: distances from the surface's corner.
    b_low, b_high : float
        The same along the edge `across`.
    """

    a_low: float
    a_high: float
    b_low: float
    b_high: float


class Scatter(NamedTuple):
    """Standard deviations of a point's displacement.

    Attributes
    ----------
    horizontal : float
        In x and in y.
    vertical : float
        In z.
    """

    horizontal: float
    vertical: float


class Leg(NamedTuple):
    """A straight flight, and where the camera looks on it.

    Attributes
    ----------
    start, end : tuple of float
        x, y, z of its ends.
    tilt : float
        How far the camera looks up from straight down, in degrees; 90 is level.
    yaw : float
        Angle from the direction of flight to that of the camera, in degrees; 90 is to the left.
    """

    start: Vector
    end: Vector
    tilt: float = 0.0
    yaw: float = 0.0


@dataclass(frozen=True)
class Surface:
    """A plane rectangle: ``corner + a * along + b * across`` for a, b from 0 to 1.

    On an upright surface, `across` points straight up; `along` may rise, which makes the surface a
    parallelogram.

    Attributes
    ----------
    corner, along, across : tuple of float
        x, y, z of a corner, and of the edges that leave it.
    openings : tuple of Rectangle
        Where nothing is: windows, holes.
    texture : float
        Probability, 0 to 1, that a camera finds a feature at a point. A surface of texture 0, such
        as a white roof, has no points, but hides what is behind it.
    textureless : tuple of Rectangle
        Parts in which no camera finds a feature.
    scatter : Scatter or None
        The scatter of its points; None: that of the flight.

    Raises
    ------
    ValueError
        Where it has no area, is not finite, or is upright and `across` does not point straight up.
    """

    corner: Vector
    along: Vector
    across: Vector
    openings: tuple[Rectangle, ...] = ()
    texture: float = 1.0
    textureless: tuple[Rectangle, ...] = ()
    scatter: Scatter | None = None

    def __post_init__(self) -> None:
        if not all(map(math.isfinite, (*self.corner, *self.along, *self.across))):
            raise ValueError("a surface's corner and edges must be finite")
        if not np.linalg.norm(self.normal) > 0:
            raise ValueError("a surface must have an area")
        if self.upright and (self.across[:2] != (0.0, 0.0) or self.across[2] < 0):
            raise ValueError("an upright surface must have `across` pointing straight up")

    @property
    def normal(self) -> Vector:
        """The cross product of `along` and `across`; its length is the area."""
        (ux, uy, uz), (vx, vy, vz) = self.along, self.across
        return uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx

    @property
    def upright(self) -> bool:
        """Whether the surface is upright: its normal is level."""
        return abs(self.normal[2]) <= 1e-12 * math.hypot(*self.normal)

    @property
    def lengths(self) -> tuple[float, float]:
        """The lengths of `along` and `across`."""
        return math.hypot(*self.along), math.hypot(*self.across)


@dataclass(frozen=True)
class Scene:
    """What a craft flies over.

    Attributes
    ----------
    name : str
    surfaces : tuple of Surface
    legs : tuple of Leg
        What the craft flies after the survey from above: a look under a bridge, a way through a
        tunnel.
    """

    name: str
    surfaces: tuple[Surface, ...] = ()
    legs: tuple[Leg, ...] = ()

    def with_surfaces(self, *surfaces: Surface) -> Scene:
        """Return the scene with more surfaces."""
        return replace(self, surfaces=self.surfaces + surfaces)

    def with_legs(self, *legs: Leg) -> Scene:
        """Return the scene with more legs."""
        return replace(self, legs=self.legs + legs)

    @property
    def bounds(self) -> tuple[Float64, Float64]:
        """The least and the greatest x, y, z of all surfaces, float64 (3,) each."""
        corner, along, across = edges(self.surfaces)
        corners = np.concatenate([corner, corner + along, corner + across, corner + along + across])
        return corners.min(axis=0), corners.max(axis=0)

    @property
    def usual_height(self) -> float:
        """How high above its top a craft usually flies: ten of the thesis's cells."""
        return 1.5


def edges(surfaces: Iterable[Surface]) -> tuple[Float64, Float64, Float64]:
    """Return `corner`, `along` and `across` of S surfaces, float64 (S, 3) each."""
    rows = [(surface.corner, surface.along, surface.across) for surface in surfaces]
    corner, along, across = np.array(rows, dtype=np.float64).reshape(-1, 3, 3).transpose(1, 0, 2)
    return corner, along, across


# --- the building blocks ---


def add_horizontal(
    scene: Scene,
    position: Vector,
    size: tuple[float, float],
    orientation: float = 0.0,
    grade: float = 0.0,
    scatter: Scatter | None = None,
    *,
    openings: Iterable[Rectangle] = (),
    texture: float = 1.0,
    textureless: Iterable[Rectangle] = (),
) -> Scene:
    """Return the scene with one more horizontal or sloping surface.

    Parameters
    ----------
    scene : Scene
    position : tuple of float
        x, y, z of its centre.
    size : tuple of float
        Length and width, as seen from above.
    orientation : float
        The direction of its length, in degrees from the x axis towards the y axis.
    grade : float
        How far it rises for each unit of its length, as seen from above.
    scatter, openings, texture, textureless
        As in `Surface`; the edge `along` is the length, `across` the width.

    Raises
    ------
    ValueError
        As `Surface`.
    """
    length, width = size
    cos, sin = _direction(orientation)
    along = (length * cos, length * sin, length * grade)
    across = (-width * sin, width * cos, 0.0)
    return scene.with_surfaces(
        _centred(position, along, across, openings, texture, textureless, scatter)
    )


def add_vertical(
    scene: Scene,
    position: Vector,
    size: tuple[float, float],
    orientation: float = 0.0,
    grade: float = 0.0,
    scatter: Scatter | None = None,
    *,
    openings: Iterable[Rectangle] = (),
    texture: float = 1.0,
    textureless: Iterable[Rectangle] = (),
) -> Scene:
    """Return the scene with one more upright surface.

    Parameters
    ----------
    scene : Scene
    position : tuple of float
        x, y, z of its centre.
    size : tuple of float
        Length, as seen from above, and height.
    orientation : float
        The direction of its length, in degrees from the x axis towards the y axis.
    grade : float
        How far its lower and its upper edge rise for each unit of its length, as seen from above.
    scatter, openings, texture, textureless
        As in `Surface`; the edge `along` is the length, `across` the height.

    Raises
    ------
    ValueError
        As `Surface`.
    """
    length, height = size
    cos, sin = _direction(orientation)
    along = (length * cos, length * sin, length * grade)
    return scene.with_surfaces(
        _centred(position, along, (0.0, 0.0, height), openings, texture, textureless, scatter)
    )


def _direction(degrees: float) -> tuple[float, float]:
    """Return cosine and sine of an angle, exact for quarter turns.

    So rounding moves no wall along an axis into the next cell.
    """
    quarters = degrees / 90.0
    if quarters == round(quarters):
        return ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[round(quarters) % 4]
    angle = math.radians(degrees)
    return math.cos(angle), math.sin(angle)


def _centred(
    centre: Vector,
    along: Vector,
    across: Vector,
    openings: Iterable[Rectangle],
    texture: float,
    textureless: Iterable[Rectangle],
    scatter: Scatter | None,
) -> Surface:
    """Return a surface by its centre.

    Parameters
    ----------
    centre : tuple of float
        x, y, z of its centre.
    along, across : tuple of float
        x, y, z of its edges.
    openings, texture, textureless, scatter
        As in `Surface`.
    """
    x, y, z = (c - (u + v) / 2 for c, u, v in zip(centre, along, across, strict=True))
    return Surface((x, y, z), along, across, tuple(openings), texture, tuple(textureless), scatter)


# --- as JSON ---


def scene_to_json(scene: Scene) -> dict[str, Any]:
    """Return name and surfaces of a scene, ready for JSON: all that its truth depends on."""
    rows = []
    for surface in scene.surfaces:
        row: list[Any] = [*surface.corner, *surface.along, *surface.across]
        rows.append([*row, [list(opening) for opening in surface.openings]])
    return {"name": scene.name, "surfaces": rows}


def scene_from_json(value: Mapping[str, Any]) -> Scene:
    """Return the scene that `scene_to_json` wrote; its surfaces have full texture, no scatter.

    Raises
    ------
    ValueError
        Where `value` is not such a scene.
    """
    try:
        surfaces = []
        for row in value["surfaces"]:
            *numbers, openings = row
            cx, cy, cz, ux, uy, uz, vx, vy, vz = map(float, numbers)
            parts = tuple(Rectangle(*map(float, opening)) for opening in openings)
            surfaces.append(Surface((cx, cy, cz), (ux, uy, uz), (vx, vy, vz), parts))
        return Scene(str(value["name"]), tuple(surfaces))
    except (TypeError, KeyError) as error:
        raise ValueError(f"it holds no list of surfaces: {error}") from error
