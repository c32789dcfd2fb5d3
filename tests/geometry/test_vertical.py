"""The vertical of a cloud.

How these tests could be cheated: by a preference for z, by clouds in the order of their heights, by
scenes without walls; by attitudes that say what the points say, too. So scenes are turned at
random, and there are some of which points alone tell nothing, or the contrary.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mlscli.errors import InputError
from mlscli.geometry.surroundings import PointSample
from mlscli.geometry.up import Up
from mlscli.geometry.vertical import find_up
from mlscli.keyframes.keyframe import Axes
from mlscli.runtime.arrays import Float64
from mlscli.scenes.flight import Flight, fly
from mlscli.scenes.presets import make

Z = np.array([0.0, 0.0, 1.0])


def found(
    points: Float64,
    route: Float64 | None = None,
    attitudes: Float64 | None = None,
    axes: Axes = "unknown",
) -> Up:
    sample = PointSample()
    sample.add(points)
    return find_up(sample.points, route, attitudes, axes)


def degrees_between(a: Float64, b: Float64) -> float:
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)))


def points_of(flight: Flight) -> Float64:
    return np.concatenate([keyframe.points for keyframe in flight.keyframes])


def route_of(flight: Flight) -> Float64:
    return np.array([keyframe.position for keyframe in flight.keyframes])


def level(rng: np.random.Generator, size: float, height: float, count: int) -> Float64:
    """Return a level square about the z axis."""
    xy = rng.uniform(-size / 2, size / 2, (count, 2))
    return np.column_stack((xy, np.full(count, height)))


# Synthetic flights

FLIGHTS = ("house", "street", "stair", "gym", "parking")


@cache
def flight_over(name: str) -> Flight:
    return fly(make(name), seed=1)


@given(name=st.sampled_from(FLIGHTS), seed=st.integers(0, 2**32 - 1))
@settings(deadline=None, max_examples=6, phases=[Phase.generate])
def test_a_flight_turned_has_its_vertical_turned(name: str, seed: int) -> None:
    flight = flight_over(name)
    turn = Rotation.random(random_state=seed % 2**31)
    points, route = turn.apply(points_of(flight)), turn.apply(route_of(flight))
    attitudes = (turn * Rotation.from_quat(flight.attitudes)).as_quat()
    # What is not known of the craft is not known.
    route[::3] = np.nan
    attitudes[1::3] = np.nan

    for up in (found(points, route), found(points, route, attitudes)):
        assert degrees_between(up.axis, turn.apply(Z)) < 3
        np.testing.assert_allclose(up.matrix @ up.axis, Z, atol=1e-12)
        assert 0 < up.level <= up.support <= 1
        assert 44.99 < degrees_between(up.axis, up.runner_up) < 135.01
        assert "the craft flew above" in up.summary


@pytest.mark.parametrize("name", ["house", "gym"])
def test_outliers_do_not_tilt_it(name: str) -> None:
    rng = np.random.default_rng(len(name))
    flight = flight_over(name)
    points = points_of(flight)
    low, high = points.min(axis=0) - 3, points.max(axis=0) + 3
    stray = rng.uniform(low, high, (len(points) // 10, 3))
    far = rng.normal(size=(20, 3)) * 1e6

    up = found(np.concatenate((points, stray, far)), route_of(flight))

    assert degrees_between(up.axis, Z) < 3


def test_a_slab_of_noise_lies_flat() -> None:
    rng = np.random.default_rng(12)
    slab = rng.normal(size=(30_000, 3)) * 0.03 + level(rng, 2, 0, 30_000)
    turn = Rotation.from_euler("x", -50, degrees=True)

    assert (
        degrees_between(found(turn.apply(slab), turn.apply([[0.0, 0.0, 1.0]])).axis, turn.apply(Z))
        < 2
    )


def test_neither_the_order_of_the_points_nor_their_repetition_changes_a_bit() -> None:
    rng = np.random.default_rng(1)
    points = points_of(flight_over("street"))
    once = found(points)
    again = found(np.concatenate((points[rng.permutation(len(points))], points[:1000])))

    assert once.axis.tobytes() == again.axis.tobytes()
    assert once.runner_up.tobytes() == again.runner_up.tobytes()
    assert once.summary == again.summary


@pytest.mark.parametrize(("below", "above"), [(600, 4000), (4000, 600)])
def test_a_ceiling_is_not_a_floor_because_it_was_seen_better(below: int, above: int) -> None:
    rng = np.random.default_rng(2)
    hall = np.concatenate((level(rng, 8, 0, below), level(rng, 8, 3, above)))
    route = np.column_stack((np.linspace(-3, 3, 20), np.zeros(20), np.full(20, 1.5)))
    still = np.tile([0.0, 0.0, 0.0, 1.0], (20, 1))

    for up in (found(hall, route), found(hall, route, still)):
        assert degrees_between(up.axis, Z) < 1
    # Upside down, or at any angle, the attitudes of the craft tell.
    for turn in (Rotation.from_euler("x", angle, degrees=True) for angle in (180, 70)):
        body = (turn * Rotation.from_quat(still)).as_quat()
        up = found(turn.apply(hall), turn.apply(route), body, "body")
        assert degrees_between(up.axis, turn.apply(Z)) < 1
        assert "the craft kept upright" in up.summary


def test_walls_larger_than_the_floor_do_not_lie_down() -> None:
    # Walls that stand at any angle, three times as much of them as there is ground.
    rng = np.random.default_rng(3)
    parts = [level(rng, 20, 0, 3000)]
    for angle in (0, 35, 80, 110, 150):
        wall = level(rng, 1, 0, 1800) * (12, 4, 0)
        stood = wall[:, [0, 2, 1]] + (0, 4, 2)
        parts.append(Rotation.from_euler("z", angle, degrees=True).apply(stood))
    turn = Rotation.random(random_state=4)

    up = found(turn.apply(np.concatenate(parts)), turn.apply([[0.0, 0.0, 6.0]]))

    assert degrees_between(up.axis, turn.apply(Z)) < 1
    assert up.level == pytest.approx(0.25, abs=0.06)
    assert up.plumb == pytest.approx(0.75, abs=0.06)


def test_attitudes_tell_the_vertical_of_a_scene_that_is_all_facade() -> None:
    rng = np.random.default_rng(5)
    facade = level(rng, 10, 0, 3000)[:, [0, 2, 1]]
    sill = level(rng, 1, 0, 300) * (8, 0.3, 0) + (0, 0.2, -2)
    # The camera looks at it (its z is y) and turns left and right.
    looking = Rotation.from_euler("x", -90, degrees=True)
    attitudes = (
        Rotation.from_euler("z", np.linspace(-70, 70, 30)[:, None], degrees=True) * looking
    ).as_quat()
    route = np.column_stack((np.linspace(-5, 5, 30), np.full(30, -6.0), np.zeros(30)))
    points = np.concatenate((facade, sill))

    assert degrees_between(found(points, route).axis, -np.eye(3)[1]) < 1
    assert degrees_between(found(points, route, attitudes).axis, Z) < 1


# A camera that looks along x, in a world with z up: x right, y down, z ahead.
CAMERA = Rotation.from_matrix([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


def flight_along(yaws: Float64, pitch: float, turn: Rotation) -> tuple[Float64, Float64, Float64]:
    """Return a facade across x, a route along it, and the attitudes of cameras that look along x.

    With a pitch of -90 they look straight down: then it is ground, seen from above.
    """
    rng = np.random.default_rng(13)
    facade = level(rng, 10, 0, 4000)[:, [2, 0, 1]] + rng.normal(0, 0.02, (4000, 3))
    angles = np.column_stack((yaws, np.full(len(yaws), pitch)))
    cameras = turn * Rotation.from_euler("ZY", angles, degrees=True) * CAMERA
    route = np.column_stack((np.full(len(yaws), -8.0), np.linspace(-4, 4, len(yaws)), yaws * 0))
    return turn.apply(facade), turn.apply(route), cameras.as_quat()


ANYHOW = Rotation.random(random_state=14)


@pytest.mark.parametrize("turn", [Rotation.identity(), CAMERA.inv(), ANYHOW])
def test_a_facade_is_no_ground_against_cameras_that_were_held_upright(turn: Rotation) -> None:
    points, route, attitudes = flight_along(np.linspace(-15, 15, 9), -10.0, turn)
    up = found(points, route, attitudes, "camera")

    assert degrees_between(up.axis, turn.apply(Z)) < 5
    assert "the cameras were held upright" in up.summary
    # Where it is not known that they are cameras, the turns of a flight are enough.
    points, route, attitudes = flight_along(np.linspace(-40, 40, 9), 0.0, turn)
    assert degrees_between(found(points, route, attitudes).axis, turn.apply(Z)) < 5
    # Without them, it is, but for a doubt.
    up = found(points)
    assert degrees_between(up.axis, turn.apply(Z)) > 80
    assert "a facade alone would look the same" in up.summary


@pytest.mark.parametrize("yaws", [np.zeros(3), np.full(12, 20.0), np.linspace(-4, 4, 9)])
def test_cameras_that_all_look_straight_at_a_plane_see_a_facade_or_ground(yaws: Float64) -> None:
    # As from photographs of ground from straight above, all with one side to the north. Where z is
    # up, or y down, it is a facade.
    for turn in (Rotation.identity(), CAMERA.inv()):
        up = found(*flight_along(yaws, -10.0, turn), "camera")
        assert degrees_between(up.axis, turn.apply(Z)) < 5
    with pytest.raises(InputError, match="two axes are supported about equally"):
        found(*flight_along(yaws, -10.0, ANYHOW), "camera")


@pytest.mark.parametrize("headings", [np.zeros(20), np.repeat([0.0, 180.0], 10)])
def test_cameras_that_look_straight_down_leave_ground_level(headings: Float64) -> None:
    rng = np.random.default_rng(24)
    ground = level(rng, 60, 0, 5000) + rng.normal(0, 0.1, (5000, 3))
    over = np.column_stack((rng.uniform(-25, 25, (20, 2)), np.full(20, 30.0)))
    angles = np.column_stack((headings, rng.normal(-88, 2, 20), rng.normal(0, 2, 20)))
    cameras = Rotation.from_euler("ZYX", angles * (1, -1, 1), degrees=True) * CAMERA

    up = found(ground, over, cameras.as_quat(), "camera")
    assert degrees_between(up.axis, Z) < 3
    if np.ptp(headings):
        # Legs there and back: in any frame.
        turned = (ANYHOW * cameras).as_quat()
        up = found(ANYHOW.apply(ground), ANYHOW.apply(over), turned, "camera")
        assert degrees_between(up.axis, ANYHOW.apply(Z)) < 3


@pytest.mark.parametrize("lean", [6, 12])
@pytest.mark.parametrize(("axes", "mount"), [("body", Rotation.identity()), ("camera", CAMERA)])
def test_a_craft_that_leans_as_it_flies_ahead_does_not_tip_the_floor(
    axes: Axes, mount: Rotation, lean: float
) -> None:
    rng = np.random.default_rng(26)
    floor = level(rng, 30, 0, 4000)
    wall = level(rng, 6, 0, 1500)[:, [0, 2, 1]] * (5, 1, 1) + (0, 15, 3)
    points = np.concatenate((floor, wall)) + rng.normal(0, 0.02, (5500, 3))
    # The whole time by so many degrees; a camera is mounted 3 degrees out of level.
    rolled = 0 if axes == "body" else 3
    held = Rotation.from_euler("ZYX", rng.normal((0, lean, rolled), 2, (30, 3)), degrees=True)
    attitudes = (held * mount).as_quat()
    route = np.column_stack((np.linspace(-10, 10, 30), np.zeros(30), np.full(30, 2.0)))

    assert degrees_between(found(points, route, attitudes, axes).axis, Z) < 0.5
    assert degrees_between(found(points, route, attitudes).axis, Z) < 0.5


def test_a_slope_stays_one_where_the_craft_turned_above_it() -> None:
    rng = np.random.default_rng(25)
    slope = Rotation.from_euler("y", 25, degrees=True).apply(level(rng, 40, 0, 5000))
    angles = np.column_stack((rng.normal(0, 40, 30), rng.normal(0, 4, (30, 2))))
    route = rng.uniform((-15, -15, 12), (15, 15, 20), (30, 3))

    for turn in (Rotation.identity(), ANYHOW):
        bodies = (turn * Rotation.from_euler("ZYX", angles, degrees=True)).as_quat()
        up = found(turn.apply(slope), turn.apply(route), bodies)
        assert degrees_between(up.axis, turn.apply(Z)) < 6


def test_a_tower_that_is_all_wall_has_the_sign_of_its_cameras() -> None:
    rng = np.random.default_rng(15)
    around = rng.uniform(0, 2 * np.pi, 3000)
    tower = np.column_stack((2 * np.cos(around), 2 * np.sin(around), rng.uniform(1, 10, 3000)))
    yaws = np.linspace(0, 330, 12)
    places = Rotation.from_euler("z", yaws[:, None], degrees=True).apply([-12.0, 0, 0])
    attitudes = Rotation.from_euler("z", yaws[:, None], degrees=True) * CAMERA

    for turn in (Rotation.from_euler("x", angle, degrees=True) for angle in (0, -90)):
        points, route = turn.apply(tower + rng.normal(0, 0.01, (3000, 3))), turn.apply(places)
        up = found(points, route, (turn * attitudes).as_quat(), "camera")
        assert degrees_between(up.axis, turn.apply(Z)) < 2
        # No share of what is level, of which there is nothing.
        assert "of what is level" not in up.summary


def test_cameras_tell_the_vertical_of_the_fewest_points() -> None:
    turn = Rotation.random(random_state=16)
    attitudes = turn * Rotation.from_euler("z", np.linspace(0, 90, 8)[:, None], True) * CAMERA
    points = np.random.default_rng(17).normal(size=(5, 3))

    up = found(points, np.zeros((8, 3)), attitudes.as_quat(), "camera")

    assert degrees_between(up.axis, turn.apply(Z)) < 3
    assert "points with flat surroundings" not in up.summary
    with pytest.raises(InputError, match="found 0 points"):
        found(points, np.zeros((8, 3)))
    # Not even different ones, or more than a line.
    for few in (np.ones((9, 3)), np.outer(np.arange(40.0), (1, 2, 3))):
        up = found(few, np.zeros((8, 3)), attitudes.as_quat(), "camera")
        assert degrees_between(up.axis, turn.apply(Z)) < 3


def test_a_scanner_that_turns_where_it_stands_is_no_craft_that_turns() -> None:
    rng = np.random.default_rng(18)
    hall = np.concatenate((level(rng, 8, 0, 3000), level(rng, 8, 0, 900)[:, [0, 2, 1]]))
    swept = Rotation.from_euler("y", np.linspace(-80, 80, 40)[:, None], degrees=True).as_quat()
    nodding = rng.normal((0, 0, 0.5), 0.005, (40, 3))

    assert degrees_between(found(hall, nodding, swept).axis, Z) < 1


@pytest.mark.parametrize("slope", [0.003, 0.2])
def test_the_coordinates_of_a_map_projection_have_z_up_exactly(slope: float) -> None:
    rng = np.random.default_rng(20)
    ground = level(rng, 100, 0, 5000)
    ground[:, 2] = slope * ground[:, 0] + rng.normal(0, 0.05, 5000)
    facade = level(rng, 20, 0, 5000)[:, [2, 0, 1]]

    for points in (ground, facade):
        up = found(np.add(points, (513_000.0, 5_403_000.0, 300.0)))
        assert up.axis.tolist() == [0, 0, 1]
        assert not up.middle.any()
        assert "map projection" in up.summary
    # Cameras come first: such coordinates may have been made of others without turning them.
    tipped = Rotation.from_euler("y", 50, degrees=True)
    yaw = Rotation.from_euler("z", np.linspace(0, 300, 15)[:, None], degrees=True)
    away = np.add(tipped.apply(ground), (513_000.0, 5_403_000.0, 300.0))
    up = found(away, None, (tipped * yaw * CAMERA).as_quat(), "camera")
    assert degrees_between(up.axis, tipped.apply(Z)) < 15
    assert up.middle.any()
    up = found(away, None, (yaw * CAMERA).as_quat(), "camera")
    assert up.axis.tolist() == [0, 0, 1]


def test_a_cloud_far_from_the_origin_turns_about_its_middle() -> None:
    rng = np.random.default_rng(21)
    turn = Rotation.from_euler("x", 100, degrees=True)
    ground = turn.apply(np.concatenate((level(rng, 20, 0, 4000), level(rng, 3, 1, 400))))
    away = np.array([3000.0, -20.0, 7000.0])

    assert not found(ground).middle.any()
    assert not found(np.add(ground, 8)).middle.any()
    up = found(ground + away)
    assert np.abs(up.middle - away).max() < 3
    assert (up.middle == np.round(up.middle)).all()
    # Neither the order of the points nor how often they come moves it.
    again = found(np.concatenate((ground[::-1], ground[:500])) + away)
    assert again.middle.tolist() == up.middle.tolist()


def test_an_axis_of_the_recording_is_found_as_that_axis() -> None:
    rng = np.random.default_rng(6)
    floor, box = level(rng, 10, 0, 5000), level(rng, 2, 1, 400)
    points = np.concatenate((floor, box))[:, [0, 2, 1]]

    up = found(points)

    assert up.axis.tolist() == [0, 1, 0]
    np.testing.assert_array_equal(up.matrix, [[1, 0, 0], [0, 0, -1], [0, 1, 0]])
    assert "up is y" in up.summary


def test_without_a_route_an_unusual_vertical_is_told_by_what_stands_on_the_ground() -> None:
    rng = np.random.default_rng(7)
    trees = np.column_stack((rng.uniform(-9, 9, (900, 2)), rng.exponential(1.0, 900)))
    points = np.concatenate((level(rng, 20, 0, 4000), trees))

    for turn in (Rotation.from_euler("y", angle, degrees=True) for angle in (0, 60, 90, 120, 180)):
        assert degrees_between(found(turn.apply(points)).axis, turn.apply(Z)) < 1


def test_a_ceiling_without_its_floor_leaves_z_up() -> None:
    rng = np.random.default_rng(8)
    room = np.concatenate(
        (level(rng, 8, 2.5, 4000), rng.uniform((-4, -4, 0.2), (4, 4, 2), (800, 3)))
    )

    up = found(room)

    assert degrees_between(up.axis, Z) < 1
    assert "which way along it is up is not" in up.summary


# What cannot be decided


@pytest.mark.parametrize("seed", range(5))
def test_two_axes_that_are_equal_are_both_named(seed: int) -> None:
    rng = np.random.default_rng(seed)
    floor = np.column_stack((level(rng, 10, 0, 3000)[:, :2], rng.normal(0, 0.02, 3000)))
    wall = np.column_stack((level(rng, 10, 0, 3000)[:, :2], rng.normal(0, 0.02, 3000)))
    points = np.concatenate((np.add(floor, (0, 5, 0)), np.add(wall[:, [0, 2, 1]], (0, 0, 5))))

    with pytest.raises(InputError) as error:
        found(points)
    message = str(error.value)
    assert "\n" not in message
    assert "`up` z" in message
    assert "`up` y" in message or "`up` -y" in message
    assert message.count("%") == 2


def test_a_cube_has_no_vertical() -> None:
    rng = np.random.default_rng(9)
    sides = [
        np.roll(level(rng, 2, height, 1500), axis, axis=1)
        for axis in range(3)
        for height in (-1, 1)
    ]
    with pytest.raises(InputError, match="two axes are supported about equally"):
        found(np.concatenate(sides))


def test_noise_has_no_vertical() -> None:
    with pytest.raises(InputError, match="`up` auto"):
        found(np.random.default_rng(10).normal(size=(5000, 3)))


@pytest.mark.parametrize("count", [0, 1, 3, 9])
def test_a_few_points_have_none_either(count: int) -> None:
    with pytest.raises(InputError, match=r"`up` auto: found \d+ points"):
        found(level(np.random.default_rng(11), 1, 0, count))


def test_points_on_a_line_have_none() -> None:
    with pytest.raises(InputError, match="`up` auto"):
        found(np.outer(np.arange(1000.0), [1.0, 2.0, 3.0]))
