"""Flights: which points are recorded, by which keyframe, where and when.

Ways to pass without being right: everything is recorded, seen or not; the truth is what was flown;
seeds that are ignored, or that change everything when one thing is asked for more.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import mlscli.runtime.threads
from mlscli.errors import UsageError
from mlscli.keyframes.batches import gather
from mlscli.maps.grid import Grid
from mlscli.pipeline.grouping import group
from mlscli.runtime.arrays import Float64
from mlscli.scenes.flight import Craft, Flight, fly
from mlscli.scenes.noise import Noise
from mlscli.scenes.parts import floor
from mlscli.scenes.presets import SCENE_PRESETS, make
from mlscli.scenes.route import fly_route, survey
from mlscli.scenes.surfaces import Leg, Scatter, Scene
from mlscli.scenes.truth import truth

CELL, GAP, THICKNESS = 0.15, 0.5, 0.15
EXACT = Noise(sigma=Scatter(0.0, 0.0), salt_pepper=0.0)


def all_points(flight: Flight) -> Float64:
    return gather(flight.keyframes).points.xyz


def same(one: Flight, other: Flight) -> bool:
    a, b = gather(one.keyframes), gather(other.keyframes)
    return (
        a.points.xyz.tobytes() == b.points.xyz.tobytes()
        and a.points.keyframe.tobytes() == b.points.keyframe.tobytes()
        and a.route.tobytes() == b.route.tobytes()
        and one.attitudes.tobytes() == other.attitudes.tobytes()
    )


def with_texture(scene: Scene) -> Scene:
    surfaces = (replace(surface, texture=1.0, textureless=()) for surface in scene.surfaces)
    return replace(scene, surfaces=tuple(surfaces))


@pytest.mark.parametrize("name", [preset.name for preset in SCENE_PRESETS])
def test_the_map_of_a_dense_flight_without_noise_is_the_truth(name: str) -> None:
    scene = with_texture(make(name, size=2 if name == "village" else None))
    flight = fly(scene, CELL / 8, EXACT)
    built = group(gather(flight.keyframes).points, Grid(CELL, GAP, THICKNESS))
    true = truth(scene, CELL, GAP, THICKNESS)
    assert built.ix.tolist() == true.ix.tolist()
    assert built.iy.tolist() == true.iy.tolist()
    # The outermost points are at most a step from the edges of walls; slopes even out.
    assert np.abs(built.height - true.height).max() < CELL / 8
    assert np.abs(built.depth - true.depth).max() < CELL / 4
    assert np.array_equal(built.depth > 0, true.depth > 0)


def test_the_ground_under_a_deck_is_in_the_flight() -> None:
    points = all_points(fly(make("bridge", 1.2), 0.1, EXACT))
    under = points[(np.abs(points[:, 1]) < 0.9) & (np.abs(points[:, 0]) < 0.9)]
    levels, counts = np.unique(under[:, 2], return_counts=True)
    assert levels.tolist() == [0.0, 1.2]
    assert counts.tolist() == [18 * 18, 18 * 18]


def test_without_the_legs_beside_it_the_middle_under_a_wide_deck_is_not() -> None:
    scene = make("bridge", 1.2)
    wide = floor(replace(scene, legs=()), (-3, 3), (-3, 3), 1.2)
    points = all_points(fly(wide, 0.1, EXACT))
    middle = points[(np.abs(points[:, :2]) < 1).all(axis=1)]
    assert set(middle[:, 2].tolist()) == {1.2}


def test_what_nothing_sees_is_not_recorded_unless_all_points_are_asked_for() -> None:
    box = floor(floor(Scene("box"), (-3, 3), (-3, 3), 0.0), (-3, 3), (-3, 3), 0.01)
    recorded = all_points(fly(box, 0.1, EXACT))
    # Flat rays from beyond the edge reach a few points of the lower floor.
    inner = np.abs(recorded[:, :2]).max(axis=1) < 2.8
    assert set(recorded[inner, 2].tolist()) == {0.01}
    everything = all_points(fly(box, 0.1, EXACT, visibility=False))
    assert len(everything) == 2 * 60 * 60


def test_all_points_go_to_the_nearest_keyframe() -> None:
    flight = fly(make("planes"), 0.2, EXACT, visibility=False)
    positions = fly_route(make("planes"), 1.5).position
    for keyframe in flight.keyframes:
        apart = np.linalg.norm(keyframe.points[:, None] - positions, axis=2)
        nearest = positions[apart.argmin(axis=1)]
        assert np.allclose(
            np.linalg.norm(keyframe.points - keyframe.position, axis=1),
            np.linalg.norm(keyframe.points - nearest, axis=1),
        )


def test_points_belong_to_the_first_keyframe_that_sees_them() -> None:
    flat = floor(Scene("flat"), (-3, 3), (-3, 3), 0.0)
    craft = Craft(height=1.0, field_of_view=90.0)
    flight = fly(flat, 0.2, EXACT, craft)
    poses = fly_route(flat, 1.0)
    # Straight below, half a right angle wide: circles as wide as the craft is high.
    apart = np.linalg.norm(all_points(flight)[:, None, :2] - poses.position[:, :2], axis=2)
    first = (apart <= 1.0).argmax(axis=1)
    stamps = np.repeat(
        [k.stamp for k in flight.keyframes], [len(k.points) for k in flight.keyframes]
    )
    assert stamps.tolist() == (1_700_000_000.0 + 0.5 * first).tolist()
    assert len(set(stamps)) > 20


def test_the_survey_and_each_leg_may_find_their_points_anew() -> None:
    scene = make("bridge", 1.2)
    parts = [replace(scene, legs=()), *(replace(scene, legs=(leg,)) for leg in scene.legs)]
    flight = fly(scene, 0.2, EXACT, anew=True)
    once = {tuple(point) for point in all_points(fly(scene, 0.2, EXACT)).tolist()}
    assert {tuple(point) for point in all_points(flight).tolist()} == once
    # Without legs, it is the survey's flight; and what a leg finds does not depend on the others.
    assert same(fly(parts[0], 0.2, EXACT, anew=True), fly(parts[0], 0.2, EXACT))
    of_survey = fly(parts[0], 0.2, EXACT).points
    of_legs = [fly(part, 0.2, EXACT, anew=True).points - of_survey for part in parts[1:]]
    assert flight.points == of_survey + sum(of_legs)
    assert min(of_legs) > 0
    stamps = [keyframe.stamp for keyframe in flight.keyframes]
    assert stamps == sorted(set(stamps))
    poses = fly_route(scene, 1.5)
    for keyframe in flight.keyframes:
        number = round((keyframe.stamp - 1_700_000_000) / 0.5)
        assert keyframe.position == tuple(poses.position[number])


def test_keyframes_tell_when_and_where_and_how_the_craft_was() -> None:
    scene = make("bridge")
    flight, poses = fly(scene, 0.2, EXACT), fly_route(scene, 1.5)
    stamps = [keyframe.stamp for keyframe in flight.keyframes]
    assert stamps == sorted(set(stamps))
    for keyframe, attitude in zip(flight.keyframes, flight.attitudes, strict=True):
        number = round((keyframe.stamp - 1_700_000_000) / 0.5)
        assert keyframe.position == tuple(poses.position[number])
        assert attitude.tolist() == poses.attitude[number].tolist()
        assert len(keyframe.points)


def test_the_attitude_turns_straight_down_into_the_way_the_camera_looks() -> None:
    from scipy.spatial.transform import Rotation

    poses = fly_route(make("house"), 1.5)
    assert len(np.unique(poses.tilt)) > 1
    turned = Rotation.from_quat(poses.attitude).apply([0.0, 0.0, -1.0])
    assert turned == pytest.approx(poses.direction, abs=1e-12)
    # The craft does not roll: its left stays level.
    assert Rotation.from_quat(poses.attitude).apply([0, 1, 0])[:, 2] == pytest.approx(0, abs=1e-12)


def test_a_leg_is_flown_from_start_to_end_looking_to_its_side() -> None:
    scene = floor(Scene(""), (0, 1), (0, 1), 0.0).with_legs(Leg((0, 0, 1), (0, 2, 1), 90, 90))
    poses = fly_route(scene, 1.0)
    leg = poses.position[-5:]
    assert leg.tolist() == [[0, y, 1] for y in (0, 0.5, 1, 1.5, 2)]
    # North is ahead, and to its left is west.
    assert poses.direction[-1] == pytest.approx((-1, 0, 0), abs=1e-12)


def test_a_survey_flies_back_and_forth_over_all_of_the_scene() -> None:
    scene = floor(Scene(""), (0, 8), (0, 3), 1.0)
    lanes = survey(scene, 2.0)
    assert [lane.start[0] for lane in lanes] == [-1.5, 9.5, -1.5, 9.5][: len(lanes)]
    assert [lane.end[0] for lane in lanes] == [9.5, -1.5, 9.5, -1.5][: len(lanes)]
    assert {lane.start[2] for lane in lanes} == {3.0}
    places = [lane.start[1] for lane in lanes]
    assert (places[0], places[-1]) == (-1.5, 4.5)
    assert np.diff(places).max() <= 3.0


def test_a_seed_gives_the_same_flight_whatever_the_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    noise = Noise("slam", outliers=0.05)
    flights = []
    for processors in (1, 2, 3):
        monkeypatch.setattr(mlscli.runtime.threads, "processors", lambda n=processors: n)
        flights.append(fly(make("gym"), 0.08, noise, holes=(3, 0.8), seed=7))
    assert same(flights[0], flights[1])
    assert same(flights[0], flights[2])
    assert not same(flights[0], fly(make("gym"), 0.08, noise, holes=(3, 0.8), seed=8))


def test_more_of_one_fault_changes_no_other_point() -> None:
    scene = make("bridge")
    plain = all_points(fly(scene, seed=3))
    with_outliers = all_points(fly(scene, noise=Noise(outliers=0.1), seed=3))
    changed = (plain != with_outliers).any(axis=1)
    assert 0.08 < changed.mean() < 0.12
    salted = all_points(fly(scene, noise=Noise(salt_pepper=0.3), seed=3))
    assert 0.15 < (plain != salted).any(axis=1).mean() < 0.25


def test_range_and_field_of_view_limit_what_is_seen() -> None:
    scene = make("planes")
    sizes = {
        (angle, reach): fly(scene, 0.1, EXACT, Craft(1.5, angle, reach)).points
        for angle, reach in ((120, None), (30, None), (120, 1.6))
    }
    assert sizes[120, None] > 1.2 * sizes[30, None]
    # Only the middle plane is near enough: the others lie 2.4 or more below the craft.
    points = all_points(fly(scene, 0.1, EXACT, Craft(1.5, 120, 1.6)))
    assert set(points[:, 2].tolist()) == {0.9}


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"grid": 0.0}, "`grid` 0"),
        ({"grid": math.nan}, "`grid` nan"),
        ({"grid": 1e-6}, "`grid` 1e-06: makes"),
        ({"craft": Craft(height=0.0)}, "`route_height` 0"),
        ({"craft": Craft(height=1e-4)}, "`route_height` 0.0001"),
        ({"craft": Craft(field_of_view=0.0)}, "`field_of_view` 0"),
        ({"craft": Craft(range=-1.0)}, "`range` -1"),
        ({"craft": Craft(range=0.01)}, "sees nothing"),
        ({"noise": Noise(salt_pepper=1.5)}, "`salt_pepper` 1.5"),
        ({"noise": Noise(outliers=-0.1)}, "`outliers` -0.1"),
        ({"noise": Noise(sigma=Scatter(0.1, -1.0))}, "`sigma` 0.1,-1"),
        ({"holes": (-1, 0.5)}, "`holes` -1,0.5"),
        ({"holes": (1, math.inf)}, "`holes` 1,inf"),
        ({"seed": -1}, "`seed` -1"),
    ],
)
def test_values_out_of_range_are_refused_by_name(options: dict[str, object], named: str) -> None:
    with pytest.raises(UsageError) as caught:
        fly(make("bridge"), **options)  # type: ignore[arg-type]
    assert named in str(caught.value)
    assert "\n" not in str(caught.value)


def test_outliers_need_a_height_to_be_spread_over() -> None:
    flat = floor(Scene("flat"), (0, 1), (0, 1), 0.0)
    with pytest.raises(UsageError, match="flat"):
        fly(flat, noise=Noise(outliers=0.1))
    with pytest.raises(UsageError, match="no surface"):
        fly(Scene("nothing"))
