"""Parts of scenes, given by their extents: floors, walls, ramps, blocks.

They add surfaces as `mlscli.scenes.surfaces` does, but by ranges instead of centre and size.
Openings and places without texture are ranges, too: of x and y, or along a wall and of z. Lengths
are in the unit of the scene.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import atan2, degrees, hypot

from mlscli.scenes.surfaces import Leg, Rectangle, Scene, Vector, add_horizontal, add_vertical

Range = tuple[float, float]
Place = tuple[float, float]

CELL = 0.15
"""Side of the thesis's cells: floors end on edges of such cells, walls stand in their middle."""


def cell(number: float) -> float:
    """Return the length of a number of cells."""
    return number * CELL


def cells(low: float, high: float) -> Range:
    """Return the range between two lengths in cells."""
    return cell(low), cell(high)


def inset(extent: Range, by: float = 1.0) -> Range:
    """Return a range that is shorter by `by` cells at both ends."""
    return extent[0] + cell(by), extent[1] - cell(by)


def floor(
    scene: Scene,
    x: Range,
    y: Range,
    z: float,
    *,
    openings: Iterable[tuple[Range, Range]] = (),
    texture: float = 1.0,
    textureless: Iterable[tuple[Range, Range]] = (),
) -> Scene:
    """Return the scene with one more level surface.

    Parameters
    ----------
    scene : Scene
    x, y : tuple of float
        Least and greatest x and y.
    z : float
        Height.
    openings : iterable of (range of x, range of y)
        Where nothing is.
    texture : float
        Probability, 0 to 1, that a camera finds a feature at a point.
    textureless : iterable of (range of x, range of y)
        Where no camera finds a feature.
    """

    def own(parts: Iterable[tuple[Range, Range]]) -> list[Rectangle]:
        return [
            Rectangle(px[0] - x[0], px[1] - x[0], py[0] - y[0], py[1] - y[0]) for px, py in parts
        ]

    return add_horizontal(
        scene,
        (_middle(x), _middle(y), z),
        (x[1] - x[0], y[1] - y[0]),
        openings=own(openings),
        texture=texture,
        textureless=own(textureless),
    )


def ramp(scene: Scene, x: Range, y: Range, z: Range, *, texture: float = 1.0) -> Scene:
    """Return the scene with a slope from height ``z[0]`` at ``x[0]`` to ``z[1]`` at ``x[1]``."""
    grade = (z[1] - z[0]) / (x[1] - x[0])
    size = (x[1] - x[0], y[1] - y[0])
    centre = (_middle(x), _middle(y), _middle(z))
    return add_horizontal(scene, centre, size, grade=grade, texture=texture)


def wall(
    scene: Scene,
    begin: Place,
    end: Place,
    z: Range,
    *,
    grade: float = 0.0,
    openings: Iterable[tuple[Range, Range]] = (),
    texture: float = 1.0,
) -> Scene:
    """Return the scene with a wall from one place to another.

    Parameters
    ----------
    scene : Scene
    begin, end : tuple of float
        x and y of its ends.
    z : tuple of float
        Heights of its lower and its upper edge at `begin`.
    grade : float
        How far both edges rise for each unit of its length.
    openings : iterable of (range along the wall, range of z)
        Where nothing is: distances from `begin`, and heights as at `begin`.
    texture : float
        Probability, 0 to 1, that a camera finds a feature at a point.
    """
    across, up = end[0] - begin[0], end[1] - begin[1]
    length = hypot(across, up)
    centre = (_middle((begin[0], end[0])), _middle((begin[1], end[1])))
    return add_vertical(
        scene,
        (*centre, _middle(z) + grade * length / 2),
        (length, z[1] - z[0]),
        degrees(atan2(up, across)),
        grade,
        openings=[Rectangle(*a, b[0] - z[0], b[1] - z[0]) for a, b in openings],
        texture=texture,
    )


def walls(scene: Scene, x: Range, y: Range, z: Range, *, texture: float = 1.0) -> Scene:
    """Return the scene with four walls around a rectangle of x and y, from ``z[0]`` to ``z[1]``."""
    (x0, x1), (y0, y1) = x, y
    corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    for begin, end in zip(corners, corners[1:] + corners[:1], strict=True):
        scene = wall(scene, begin, end, z, texture=texture)
    return scene


def block(scene: Scene, x: Range, y: Range, z: Range, *, roof_texture: float = 1.0) -> Scene:
    """Return the scene with a house: a flat roof at ``z[1]``, walls half a cell inside its edge."""
    scene = walls(scene, inset(x, 0.5), inset(y, 0.5), z)
    return floor(scene, x, y, z[1], texture=roof_texture)


def look_around(centre: Vector, reach_x: float, reach_y: float, tilt: float = 75.0) -> list[Leg]:
    """Return legs that cross a room both ways, along x and along y, the camera looking ahead.

    Parameters
    ----------
    centre : tuple of float
        x, y, z of the middle of all legs.
    reach_x, reach_y : float
        How far the legs along x and those along y go to either side of it.
    tilt : float
        As in `Leg`, in degrees.
    """
    x, y, z = centre
    west, east, south, north = x - reach_x, x + reach_x, y - reach_y, y + reach_y
    return [
        Leg((west, y, z), (east, y, z), tilt),
        Leg((east, y, z), (west, y, z), tilt),
        Leg((x, south, z), (x, north, z), tilt),
        Leg((x, north, z), (x, south, z), tilt),
    ]


def _middle(extent: Range) -> float:
    return (extent[0] + extent[1]) / 2
