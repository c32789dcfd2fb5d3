"""Parts of scenes, told by their extents: floors, walls, ramps, blocks.

They are the building blocks of `mlscli.scenes.surfaces` in the words in which a scene is thought
of. Lengths of openings and of places without texture are told like the part itself: in x and y,
or along a wall and in z.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import atan2, degrees, hypot

from mlscli.scenes.surfaces import Leg, Rectangle, Scene, Vector, add_horizontal, add_vertical

Range = tuple[float, float]
Place = tuple[float, float]

CELL = 0.15
"""The thesis's cell: floors of scenes end on the edges of such cells, walls stand in the middle."""


def cell(number: float) -> float:
    """Return a length told in cells."""
    return number * CELL


def cells(low: float, high: float) -> Range:
    """Return a range told in cells."""
    return cell(low), cell(high)


def inset(extent: Range, by: float = 1.0) -> Range:
    """Return a range smaller by so many cells at both ends."""
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
    """Add a level surface; openings and places without texture are ranges of x and y."""

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
    """Add a slope that rises (or falls) from ``z[0]`` at ``x[0]`` to ``z[1]`` at ``x[1]``."""
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
    """Add a wall from one place to another; openings are ranges from `begin` on and of z."""
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
    """Add four walls around a rectangle."""
    (x0, x1), (y0, y1) = x, y
    corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    for begin, end in zip(corners, corners[1:] + corners[:1], strict=True):
        scene = wall(scene, begin, end, z, texture=texture)
    return scene


def block(scene: Scene, x: Range, y: Range, z: Range, *, roof_texture: float = 1.0) -> Scene:
    """Add a house as a craft sees it from outside: walls half a cell inside, and a flat roof."""
    scene = walls(scene, inset(x, 0.5), inset(y, 0.5), z)
    return floor(scene, x, y, z[1], texture=roof_texture)


def look_around(centre: Vector, reach_x: float, reach_y: float, tilt: float = 75.0) -> list[Leg]:
    """Return legs that cross a room both ways, along x and along y, looking ahead."""
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
