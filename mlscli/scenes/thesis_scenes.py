"""The scenes of the thesis: its five artificial set-ups (5.2), and its recordings as described.

Lengths are at the thesis's scale, at which cells are 0.15 wide.
"""

from __future__ import annotations

from mlscli.scenes.parts import block, cell, cells, floor, inset, ramp, wall
from mlscli.scenes.surfaces import Leg, Scene


def bridge(height: float) -> Scene:
    """Return a deck at `height` over the floor of a valley with slopes (5.2, number 1)."""
    scene = Scene("bridge")
    scene = ramp(scene, cells(-20, -6), cells(-20, 20), (0.6, 0.0))
    scene = floor(scene, cells(-6, 6), cells(-20, 20), 0.0)
    scene = ramp(scene, cells(6, 20), cells(-20, 20), (0.0, 0.6))
    scene = floor(scene, cells(-20, 20), cells(-6, 6), height)
    z = (0.6 + height) / 2
    return scene.with_legs(
        Leg((-3.6, -2.4, z), (3.6, -2.4, z), tilt=75, yaw=90),
        Leg((3.6, 2.4, z), (-3.6, 2.4, z), tilt=75, yaw=90),
    )


def bridge_walls(height: float) -> Scene:
    """Return a road at `height`, on banks with walls, and a narrow underpass (5.2, number 2)."""
    scene = Scene("bridge-walls")
    inside = [(cells(-20, -6), cells(-5, 5)), (cells(6, 20), cells(-5, 5))]
    scene = floor(scene, cells(-20, 20), cells(-20, 20), 0.0, openings=inside)
    scene = floor(scene, cells(-20, 20), cells(-6, 6), height)
    for side in (-1, 1):
        near, far, edge = cell(5.5 * side), cell(20 * side), cell(5.5)
        scene = wall(scene, (near, -edge), (near, edge), (0.0, height))
        for y in (-edge, edge):
            scene = wall(scene, (near, y), (far, y), (0.0, height))
    z = height / 2
    return scene.with_legs(
        Leg((0.0, -3.6, z), (0.0, 3.6, z), tilt=85), Leg((0.0, 3.6, z), (0.0, -3.6, z), tilt=85)
    )


def house(diameter: float) -> Scene:
    """Return ground and part of a house, a square hole `diameter` wide in each (5.2, number 3)."""
    scene, half = Scene("house"), diameter / 2
    hole = ((-half, half), (-1.5 - half, -1.5 + half))
    scene = floor(scene, cells(-20, 20), cells(-20, 20), 0.0, openings=[hole])
    west, east, front = cell(-10.5), cell(10.5), cell(6.5)
    eaves, ridge = 1.5, 1.95
    window = ((east - half, east + half), (0.75 - half, 0.75 + half))
    scene = wall(scene, (west, front), (east, front), (0.0, eaves), openings=[window])
    for side in (west, east):
        scene = wall(scene, (side, front), (side, cell(20)), (0.0, eaves))
    scene = ramp(scene, cells(-11, 0), cells(6, 20), (eaves, ridge))
    scene = ramp(scene, cells(0, 11), cells(6, 20), (ridge, eaves))
    return scene.with_legs(
        Leg((-2.4, -1.2, 0.75), (2.4, -1.2, 0.75), tilt=75, yaw=90),
        Leg((1.2, 3.9, 0.75), (-1.2, 3.9, 0.75), tilt=75, yaw=90),
        Leg((0.0, 2.7, 0.6), (0.0, 1.2, 0.6), tilt=75),
        Leg((0.0, 1.2, 0.6), (0.0, 2.7, 0.6), tilt=75),
    )


def planes(offset: float) -> Scene:
    """Return three planes, the middle one at height `offset`, one tilted (5.2, number 4)."""
    scene = Scene("planes")
    scene = floor(scene, cells(-20, -7), cells(-20, 20), 0.0)
    scene = floor(scene, cells(-7, 7), cells(-20, 20), offset)
    return ramp(scene, cells(7, 20), cells(-20, 20), (0.0, 0.6))


def planes_walls(offset: float) -> Scene:
    """Return three planes as in `planes`, connected by walls (5.2, number 5)."""
    scene = Scene("planes-walls")
    scene = floor(scene, cells(-20, -6), cells(-20, 20), 0.0)
    scene = floor(scene, cells(-7, 7), cells(-20, 20), offset)
    scene = ramp(scene, cells(6, 20), cells(-20, 20), (0.0, 0.6))
    for x in (cell(-6.5), cell(6.5)):
        scene = wall(scene, (x, cell(-20)), (x, cell(20)), (0.0, offset))
    return scene


def table() -> Scene:
    """Return a table on a floor laid out with newspapers (5.1)."""
    scene, height = Scene("table"), 0.75
    scene = floor(scene, cells(-15, 15), cells(-15, 15), 0.0)
    scene = floor(scene, cells(-6, 6), cells(-4, 4), height)
    for x in (-6, 5):
        for y in (-3.5, 3.5):
            scene = wall(scene, (cell(x), cell(y)), (cell(x + 1), cell(y)), (0.0, height))
    return scene.with_legs(
        Leg((-2.4, -1.5, 0.4), (2.4, -1.5, 0.4), tilt=75, yaw=90),
        Leg((2.4, 1.5, 0.4), (-2.4, 1.5, 0.4), tilt=75, yaw=90),
    )


def gym() -> Scene:
    """Return a gym floor with two bands of features, and a window in the wall at its end (5.2)."""
    scene = Scene("gym")
    bands = (cells(-6, -2), cells(2, 6))
    for band in bands:
        scene = floor(scene, cells(-40, 40), band, 0.0)
    for bare in (cells(-15, -6), cells(-2, 2), cells(6, 15)):
        scene = floor(scene, cells(-40, 40), bare, 0.0, texture=0.02)
    window = (cells(11, 19), (0.9, 1.5))
    end = cell(39.5)
    scene = wall(
        scene, (end, cell(-15)), (end, cell(15)), (0.0, 2.1), openings=[window], texture=0.5
    )
    return scene.with_legs(Leg((-6.0, 0.0, 1.2), (6.6, 0.0, 1.2), tilt=60))


def bridge_gap() -> Scene:
    """Return a bridge over a creek; a part of its deck is without texture, a gap in maps (6.10).

    Along the creek, closing the gap joins the deck with a weir that lies lower; across the creek,
    it joins the two banks, at the height of the true deck.
    """
    scene = Scene("bridge-gap")
    bed, weir = -0.9, -0.3
    scene = floor(scene, cells(-20, -2), cells(-20, 20), 0.0)
    scene = floor(scene, cells(2, 20), cells(-20, 20), 0.0)
    unseen = (cells(-2, 2), cells(2, 6))
    scene = floor(scene, cells(-2, 2), cells(-6, 6), 0.0, textureless=[unseen])
    scene = floor(scene, cells(-3, 3), cells(-20, 7), bed)
    scene = floor(scene, cells(-3, 3), cells(6, 20), weir)
    brink = cell(6.5)
    scene = wall(scene, (cell(-2.5), brink), (cell(2.5), brink), (bed, weir))
    for x in (cell(-2.5), cell(2.5)):
        scene = wall(scene, (x, cell(-20)), (x, brink), (bed, 0.0))
        scene = wall(scene, (x, brink), (x, cell(20)), (weir, 0.0))
    return scene.with_legs(
        Leg((0.0, -3.6, -0.45), (0.0, 0.75, -0.45), tilt=85),
        Leg((0.0, 0.75, -0.45), (0.0, -3.6, -0.45), tilt=85),
        Leg((0.0, 0.75, -0.15), (0.0, 3.6, -0.15), tilt=85),
    )


def village() -> Scene:
    """Return a village with road, creek, bridge, ruins and white roofs (5.4)."""
    scene = Scene("village-thesis")
    houses = [
        # x, y, eaves, texture of the roof: most are white in the sun
        (cells(-50, -34), cells(10, 26), 1.2, 0.0),
        (cells(-28, -16), cells(12, 24), 0.9, 0.0),
        (cells(-46, -28), cells(-28, -14), 1.2, 0.0),
        (cells(18, 34), cells(-26, -12), 1.05, 0.0),
        (cells(40, 54), cells(10, 28), 1.5, 0.8),
    ]
    inside = [(inset(x), inset(y)) for x, y, _, _ in houses]
    shores = cells(-60, -8), cells(8, 60)
    for shore in shores:
        here = [(x, y) for x, y in inside if shore[0] <= x[0] < shore[1]]
        scene = floor(scene, shore, cells(-5, 5), 0.0)
        for meadow in (cells(-40, -5), cells(5, 40)):
            holes = [(x, y) for x, y in here if meadow[0] <= y[0] < meadow[1]]
            scene = floor(scene, shore, meadow, 0.0, openings=holes, texture=0.6)
    for x, y, eaves, texture in houses:
        scene = block(scene, x, y, (0.0, eaves), roof_texture=texture)
    scene = creek_and_bridge(scene)
    for ruin, top in ((cell(14.5), 0.6), (cell(22.5), 1.05)):
        scene = wall(scene, (cell(14), ruin), (cell(30), ruin), (0.0, top))
    scene = wall(scene, (cell(14.5), cell(14.5)), (cell(14.5), cell(22.5)), (0.0, 0.75))
    return scene.with_legs(
        Leg((0.0, -6.6, -0.45), (0.0, 6.6, -0.45), tilt=85),
        Leg((0.0, 6.6, -0.45), (0.0, -6.6, -0.45), tilt=85),
    )


def creek_and_bridge(scene: Scene, bed: float = -0.9) -> Scene:
    """Return the scene with a creek along y, between walls, and a bridge level with its banks."""
    scene = floor(scene, cells(-9, 9), cells(-40, 40), bed, texture=0.5)
    for x in (cell(-8.5), cell(8.5)):
        scene = wall(scene, (x, cell(-40)), (x, cell(40)), (bed, 0.0))
    return floor(scene, cells(-8, 8), cells(-5, 5), 0.0)
