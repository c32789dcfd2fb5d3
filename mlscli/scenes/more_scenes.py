"""Scenes that the thesis lacks: storeys, streets, tunnels, stairs, decks, villages of any size."""

from __future__ import annotations

from itertools import product

from mlscli.scenes.parts import Place, block, cell, cells, floor, inset, look_around, ramp, wall
from mlscli.scenes.surfaces import Leg, Scene


def house_storeys() -> Scene:
    """Return a house of two storeys under a flat roof, with windows and a stairwell."""
    scene, storey = Scene("house-storeys"), 1.2
    side, edge = cells(-10, 10), cell(9.5)
    scene = floor(scene, cells(-25, 25), cells(-25, 25), 0.0, openings=[(side, side)])
    scene = floor(scene, side, side, 0.0)
    scene = floor(scene, side, side, storey, openings=[(cells(3, 7), cells(-3, 3))])
    scene = floor(scene, side, side, 2 * storey)
    windows = [
        (cells(left, left + 4), (level + 0.3, level + 0.9))
        for level in (0.0, storey)
        for left in (2.5, 12.5)
    ]
    corners = [(-edge, -edge), (edge, -edge), (edge, edge), (-edge, edge)]
    for begin, end in zip(corners, corners[1:] + corners[:1], strict=True):
        scene = wall(scene, begin, end, (0.0, 2 * storey), openings=windows)
    for level in (0.0, storey):
        scene = scene.with_legs(*look_around((0.0, 0.0, level + 0.75), 1.2, 1.2))
    return scene


def street() -> Scene:
    """Return a street between houses, with trees, and the arm of a crane above."""
    scene = Scene("street")
    houses = [
        (cells(-36, -14), cells(10, 22), 1.5),
        (cells(-8, 14), cells(10, 22), 2.1),
        (cells(-30, -4), cells(-22, -10), 1.8),
        (cells(4, 32), cells(-22, -10), 1.2),
    ]
    mast = cells(20, 24), cells(10, 14)
    inside = [(inset(x), inset(y)) for x, y in [*((x, y) for x, y, _ in houses), mast]]
    scene = floor(scene, cells(-40, 40), cells(-26, 26), 0.0, openings=inside)
    for x, y, height in houses:
        scene = block(scene, x, y, (0.0, height))
    scene = block(scene, *mast, (0.0, 3.6))
    scene = floor(scene, cells(20, 24), cells(-20, 10), 3.6)
    for place in ((-24, 5), (-2, -6), (30, 5)):
        scene = _tree(scene, place)
    low = 0.6
    return scene.with_legs(
        Leg((-6.6, 0.0, low), (6.6, 0.0, low), tilt=80, yaw=90),
        Leg((6.6, 0.0, low), (-6.6, 0.0, low), tilt=80, yaw=90),
        Leg((-6.6, 1.35, low), (6.6, 1.35, low), tilt=85),
        Leg((6.6, -1.35, low), (-6.6, -1.35, low), tilt=85),
    )


def _tree(scene: Scene, place: Place) -> Scene:
    """Add a trunk in the cell whose indices are given, and a crown of five by five cells on it."""
    x, y = place
    trunk = cell(y + 0.5)
    scene = wall(scene, (cell(x), trunk), (cell(x + 1), trunk), (0.0, 0.9))
    crown = cells(x - 2, x + 3), cells(y - 2, y + 3)
    scene = floor(scene, *crown, 0.9)
    return block(scene, *crown, (0.9, 1.5))


def tunnel() -> Scene:
    """Return a road through a hill."""
    scene, vault, top = Scene("tunnel"), 1.2, 1.8
    solid = [(cells(-15, 15), cells(-15, -6)), (cells(-15, 15), cells(6, 15))]
    scene = floor(scene, cells(-30, 30), cells(-15, 15), 0.0, openings=solid)
    scene = floor(scene, cells(-16, 16), cells(-15, 15), top)
    scene = floor(scene, cells(-15, 15), cells(-6, 6), vault)
    mouth = (cells(9.5, 20.5), (0.0, vault))
    for x in (cell(-15.5), cell(15.5)):
        scene = wall(scene, (x, cell(-15)), (x, cell(15)), (0.0, top), openings=[mouth])
    for y in (cell(-5.5), cell(5.5)):
        scene = wall(scene, (cell(-15.5), y), (cell(15.5), y), (0.0, vault))
    return scene.with_legs(
        Leg((-4.2, 0.0, 0.6), (4.2, 0.0, 0.6), tilt=80),
        Leg((4.2, 0.0, 0.6), (-4.2, 0.0, 0.6), tilt=80),
    )


def stair() -> Scene:
    """Return a stair up to a gallery that is open below."""
    scene, steps, rise = Scene("stair"), 6, 0.18
    top, head = steps * rise, 2 * steps - 0.5
    solid = (cells(1, 20), cells(-4, 4))
    scene = floor(scene, cells(-20, 20), cells(-15, 15), 0.0, openings=[solid])
    sides = (cell(-4.5), cell(4.5))
    for step in range(1, steps + 1):
        front, z = 2 * step - 1.5, step * rise
        back = front + 2 if step < steps else 20.0
        scene = wall(scene, (cell(front), sides[0]), (cell(front), sides[1]), (z - rise, z))
        for y in sides:
            scene = wall(scene, (cell(front), y), (cell(back), y), (0.0, z))
        if step < steps:
            scene = floor(scene, cells(front, back), cells(-5, 5), z)
    scene = floor(scene, cells(head - 1, 20), cells(-15, 15), top)
    return scene.with_legs(
        Leg((0.9, -3.0, 0.6), (3.6, -3.0, 0.6), tilt=75, yaw=90),
        Leg((3.6, 3.0, 0.6), (0.9, 3.0, 0.6), tilt=75, yaw=90),
        *(Leg((0.3, y, 0.6), (2.7, y, 0.6), tilt=85) for y in (-1.5, 1.5)),
    )


def parking() -> Scene:
    """Return a car park: two decks on columns above the ground, and ramps beside them."""
    scene, storey = Scene("parking"), 1.2
    # The foot of the lower ramp is solid.
    scene = floor(
        scene, cells(-25, 25), cells(-22, 16), 0.0, openings=[(cells(-12, 0), cells(8, 13))]
    )
    for level in (storey, 2 * storey):
        scene = floor(scene, cells(-20, 20), cells(-15, 8), level)
    scene = ramp(scene, cells(-12, 12), cells(8, 13), (0.0, storey))
    scene = floor(scene, cells(12, 20), cells(8, 13), storey)
    scene = ramp(scene, cells(-12, 12), cells(-20, -15), (2 * storey, storey))
    scene = floor(scene, cells(12, 20), cells(-20, -15), storey)
    scene = floor(scene, cells(-20, -12), cells(-20, -15), 2 * storey)
    for x, y in product((-11, 10), (-10.5, 3.5)):
        scene = wall(scene, (cell(x), cell(y)), (cell(x + 1), cell(y)), (0.0, 2 * storey))
    for level in (0.0, storey):
        z = level + 0.6
        scene = scene.with_legs(
            *look_around((0.0, -0.525, z), 3.9, 3.6),
            Leg((-3.9, -2.0, z), (3.9, -2.0, z), tilt=75, yaw=90),
            Leg((3.9, 0.9, z), (-3.9, 0.9, z), tilt=75, yaw=90),
            Leg((3.9, -3.6, z), (-3.9, -3.6, z), tilt=75, yaw=-90),
            Leg((-3.9, 3.0, z), (3.9, 3.0, z), tilt=75, yaw=-90),
        )
    return scene


def village(size: int) -> Scene:
    """Return `size` by `size` lots of 30 by 30 cells, each with a house of one of five kinds."""
    scene = Scene(f"village-{size}")
    lots = []
    for row, column in product(range(size), range(size)):
        kind = (7 * row + 3 * column) % 5
        x, y = 30 * (column - size / 2), 30 * (row - size / 2)
        width, depth, height = 12 + kind, 18 - kind, 0.9 + 0.15 * kind
        here = cells(x + 7, x + 7 + width), cells(y + 6, y + 6 + depth)
        lot = floor(
            Scene(""),
            cells(x, x + 30),
            cells(y, y + 30),
            0.0,
            openings=[(inset(here[0]), inset(here[1]))],
        )
        lots.append(block(lot, *here, (0.0, height), roof_texture=0.1 if kind == 0 else 1.0))
    return scene.with_surfaces(*(surface for lot in lots for surface in lot.surfaces))
