"""What speaks against a vertical that the user named.

How these tests could be cheated: by never saying a word, or always, or by comparing with what
`find_up` says, which takes a facade for ground. So what is recorded with z up, of many kinds, must
raise no objection, and the same tipped over must, where anything tells.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mlscli.geometry.objection import objection
from mlscli.geometry.surroundings import PointSample
from mlscli.keyframes.keyframe import Axes
from mlscli.runtime.arrays import Float64

# z up becomes y down, looking down by 15 degrees, as in the frame of a camera; and y up.
Y_DOWN = Rotation.from_euler("x", 90 + 15, degrees=True)
Y_UP = Rotation.from_euler("x", -90, degrees=True)
CAMERA = Rotation.from_matrix([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
Z_TO_Z = Rotation.identity()


def said(
    points: Float64,
    up: str = "z",
    route: Float64 | None = None,
    attitudes: Rotation | None = None,
    axes: Axes = "unknown",
) -> str:
    sample = PointSample(10_000)
    sample.add(points)
    turns = None if attitudes is None else attitudes.as_quat()
    return objection(up, sample.points, route, turns, axes)


def level(rng: np.random.Generator, x: float, y: float, count: int, z: float = 0.0) -> Float64:
    xy = rng.uniform((-x / 2, -y / 2), (x / 2, y / 2), (count, 2))
    return np.column_stack((xy, np.full(count, z)))


def wall(rng: np.random.Generator, x: float, z: float, count: int, yaw: float = 0.0) -> Float64:
    flat = level(rng, x, z, count)[:, [0, 2, 1]] + (0, 0, z / 2)
    return np.asarray(Rotation.from_euler("z", yaw, degrees=True).apply(flat))


def noisy(rng: np.random.Generator, *parts: Float64) -> Float64:
    points = np.concatenate(parts)
    return points + rng.normal(0, 0.02, points.shape)


def town(rng: np.random.Generator) -> Float64:
    """Return houses that stand at any angle, on little ground."""
    places = rng.uniform(-20, 20, (12, 2))
    walls = [
        wall(rng, 6, 4, 300, yaw) + np.append(place, 0)
        for place, yaw in zip(places, rng.uniform(0, 180, 12), strict=True)
    ]
    return noisy(rng, level(rng, 40, 40, 1500), *walls)


def room(rng: np.random.Generator) -> Float64:
    sides = [np.add(wall(rng, 8, 3, 700), (0, y, 0)) for y in (-2.5, 2.5)]
    ends = [np.add(wall(rng, 5, 3, 400, 90), (x, 0, 0)) for x in (-4, 4)]
    return noisy(rng, level(rng, 8, 5, 300), level(rng, 8, 5, 2000, 3), *sides, *ends)


def facade(rng: np.random.Generator) -> Float64:
    balconies = [
        np.add(level(rng, 1.5, 0.6, 80), (x, -0.3, z))
        for x, z in rng.uniform((-5, 1), (5, 8), (12, 2)).tolist()
    ]
    return noisy(rng, wall(rng, 12, 9, 4000), *balconies)


def dam(rng: np.random.Generator) -> Float64:
    leaning = Rotation.from_euler("x", 20, degrees=True).apply(wall(rng, 20, 10, 4000))
    return noisy(rng, leaning, level(rng, 20, 4, 700) - (0, 2, 0))


def hill(rng: np.random.Generator) -> Float64:
    steep = Rotation.from_euler("x", 50, degrees=True)
    return noisy(rng, steep.apply(level(rng, 40, 40, 4000) + rng.normal(0, 0.1, (4000, 3))))


def pipe(rng: np.random.Generator) -> Float64:
    around = rng.uniform(0, 2 * np.pi, 4000)
    length = rng.uniform(-6, 6, 4000)
    return noisy(rng, np.column_stack((2 * np.cos(around), length, 2 * np.sin(around))))


def plane_of_a_laser(rng: np.random.Generator) -> Float64:
    around = rng.uniform(0, 2 * np.pi, 3000)
    ring = np.column_stack((4 * np.cos(around), 3 * np.sin(around), np.zeros(3000)))
    return noisy(rng, ring) * (1, 1, 0.1)


KINDS = [town, room, facade, dam, hill, pipe, plane_of_a_laser]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("yaw", [0, 90])
def test_what_was_recorded_with_z_up_raises_no_objection(
    kind: Callable[[np.random.Generator], Float64], yaw: int
) -> None:
    points = Rotation.from_euler("z", yaw, degrees=True).apply(kind(np.random.default_rng(yaw)))

    assert said(points) == ""


@pytest.mark.parametrize("turn", [Y_DOWN, Y_UP], ids=["y down", "y up"])
def test_floors_and_walls_at_any_angle_object_to_an_axis_across(turn: Rotation) -> None:
    points = turn.apply(town(np.random.default_rng(1)))
    words = said(points)

    assert "`up` z is doubtful, try `up` auto: it seems that up is " in words
    assert "\n" not in words
    assert ("from -y" in words) == (turn is Y_DOWN)
    # The right axis, though it is not quite plumb, is not in doubt.
    assert said(points, "-y" if turn is Y_DOWN else "y") == ""


def lot(rng: np.random.Generator) -> Float64:
    side, other = wall(rng, 60, 6, 1500), wall(rng, 60, 6, 1500, 90)
    return noisy(rng, level(rng, 60, 60, 5000), np.add(side, (0, 30, 0)), np.add(other, (30, 0, 0)))


def mast(rng: np.random.Generator) -> Float64:
    sides = [wall(rng, 2, 30, 700, yaw) for yaw in (0, 90)]
    return noisy(rng, *(side + shift for side in sides for shift in ((-1, -1, 0), (1, 1, 0))))


def at_its_foot(rng: np.random.Generator) -> Float64:
    """Return a facade and a strip of ground along it."""
    return noisy(rng, wall(rng, 60, 15, 4000), level(rng, 60, 6, 1600) - (0, 3, 0))


def test_ground_among_walls_at_right_angles_objects_if_it_is_wide() -> None:
    # All surfaces are level or plumb to each of the axes.
    points = lot(np.random.default_rng(9))

    assert said(points) == ""
    assert "it seems that up is y" in said(Y_UP.apply(points))
    for kind in (mast, at_its_foot):
        assert said(kind(np.random.default_rng(10))) == ""


@pytest.mark.parametrize(
    ("axes", "mount"), [("camera", CAMERA), ("unknown", CAMERA), ("body", Z_TO_Z)]
)
@pytest.mark.parametrize("kind", [room, facade])
def test_attitudes_object_where_points_leave_it_open(
    kind: Callable[[np.random.Generator], Float64], axes: Axes, mount: Rotation
) -> None:
    points = kind(np.random.default_rng(2))
    yaw = Rotation.from_euler("z", np.linspace(0, 300, 15)[:, None], degrees=True)
    route = np.column_stack((np.linspace(-3, 3, 15), np.full(15, -1.0), np.full(15, 1.5)))

    assert said(points, "z", route, yaw * mount, axes) == ""
    for turn, up in ((Y_DOWN, "-y"), (Y_UP, "y")):
        tipped = turn.apply(points), turn.apply(route), turn * yaw * mount, axes
        words = said(tipped[0], "z", *tipped[1:])
        assert "`up` z is doubtful" in words
        assert said(tipped[0], up, *tipped[1:]) == ""


def test_attitudes_object_to_a_map_that_is_upside_down() -> None:
    points = room(np.random.default_rng(3)) * (1, -1, -1)
    over = Rotation.from_euler("x", 180, degrees=True)
    yaw = Rotation.from_euler("z", np.linspace(0, 300, 15)[:, None], degrees=True)

    words = said(points, "z", None, over * yaw * CAMERA, "camera")
    assert "it seems that up is -z" in words
    # Nothing else tells.
    assert said(points) == ""


def test_a_flight_below_all_that_it_saw_objects() -> None:
    # As in the frame of a navigation system, north, east, down.
    rng = np.random.default_rng(8)
    points, over = town(rng), rng.uniform((-20, -20, 25), (20, 20, 35), (40, 3))
    # Some are wrong, at any height.
    wrong = rng.uniform((-20, -20, 0), (20, 20, 8), (200, 3))
    points = np.concatenate((points, wrong))

    assert said(points, "z", over) == ""
    words = said(points * (1, -1, -1), "z", over * (1, -1, -1))
    assert "it seems that up is -z" in words
    assert "the craft flew above all around it" in words
    # Where it flew within, nothing is certain.
    within = over * (1, -1, -0.1)
    assert said(points * (1, -1, -1), "z", within) == ""


def test_attitudes_that_agree_outweigh_floors_and_walls() -> None:
    points = Y_DOWN.apply(town(np.random.default_rng(4)))
    yaw = Rotation.from_euler("z", np.linspace(0, 300, 15)[:, None], degrees=True)

    assert said(points) != ""
    assert said(points, "z", None, yaw, "body") == ""


def test_attitudes_that_were_never_set_say_nothing() -> None:
    points = Y_DOWN.apply(town(np.random.default_rng(5)))
    unset = Rotation.from_quat(np.tile([0.0, 0.0, 0.0, 1.0], (9, 1)))
    route = np.column_stack((np.linspace(-9, 9, 9), np.zeros((9, 2))))

    assert "from -y" in said(points, "z", route, unset)


def test_the_coordinates_of_a_map_projection_object_to_all_but_z() -> None:
    wild = np.add(Y_DOWN.apply(town(np.random.default_rng(6))), (513_000, 5_403_000, 300))

    assert said(wild) == ""
    for up in ("y", "-z", "x"):
        assert said(wild, up) == (
            f"`up` {up} is doubtful, try `up` z: the coordinates are those of a map projection"
        )
    # Unless cameras know better.
    yaw = Rotation.from_euler("z", np.linspace(0, 300, 15)[:, None], degrees=True)
    words = said(wild, "z", None, Y_DOWN * yaw * CAMERA, "camera")
    assert "`up` z is doubtful, try `up` auto" in words


def test_too_few_points_say_nothing() -> None:
    for count in (0, 1, 5):
        assert said(np.random.default_rng(7).normal(size=(count, 3))) == ""
