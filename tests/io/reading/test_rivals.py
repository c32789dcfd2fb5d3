"""Two publishers of one frame: in two parents by turns, or at two places under one name.

How these tests could be cheated: by refusing all recordings with two parents, or by taking those of
the last. So clouds must come out by the poses of one parent alone, whichever is told last, and a
frame that is handed over must come out by both.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mlscli.errors import InputError
from tests.helpers.bags import Told
from tests.helpers.craft import (
    at,
    cloud,
    odometry,
    opened,
    positions_of,
    recorded,
    run,
    seen,
    transform,
)
from tests.io.reading.test_histories import xs

TIMES = range(12)


def by_turns(first: str, second: str, shift: float) -> list[Told]:
    """Return transforms in two frames, half a second after one another."""
    later = [
        recorded(transform(k + 0.5, second, "base_link", at(k + 0.5 + shift)), k + 0.5)
        for k in TIMES
    ]
    return [*run(0, 0, TIMES, first), *later]


def robots() -> list[Told]:
    """Return the transforms of two robots with one name, in one frame and topic."""
    return by_turns("map", "map", 30)


# Two parents


@pytest.mark.parametrize(
    ("first", "second", "frame", "expected"),
    [
        ("map", "odom", None, 0),
        ("odom", "map", None, 50),
        ("map", "odom", "map", 0),
        ("map", "odom", "odom", 50),
        ("odom", "map", "odom", 0),
        ("odom", "camera_init", None, 50),
        ("somewhere", "odom", None, 50),
    ],
)
def test_of_two_parents_by_turns_one_is_taken_for_all_clouds(
    tmp_path: Path, first: str, second: str, frame: str | None, expected: float
) -> None:
    told = by_turns(first, second, 50)
    recording = opened(tmp_path, [*told, *seen(0, 2, 2.5, 3.25, 9)], frame=frame)

    assert xs(recording) == [x + expected for x in (2, 2.5, 3.25, 9)]
    taken = second if expected else first
    (note,) = [note for note in recording.notes if "by turns" in note]
    assert f"{taken!r} is taken, `frame` names another" in note


def test_the_parent_is_taken_that_leads_to_the_frame_that_is_named(tmp_path: Path) -> None:
    told = [*by_turns("odom", "start", 50), transform(0, "world", "start", at(100), stays=True)]
    recording = opened(tmp_path, [*told, *seen(0, 2, 3.25)], frame="world")

    assert xs(recording) == [152, 153.25]


def test_a_parent_in_which_a_frame_never_moves_is_not_taken(tmp_path: Path) -> None:
    stays = [recorded(transform(k + 0.5, "map", "base_link", at(0)), k + 0.5) for k in TIMES]
    recording = opened(tmp_path, [*run(0, 0, TIMES, "odom"), *stays, *seen(0, 2, 3.25)])

    assert xs(recording) == [2, 3.25]


def test_a_frame_that_is_handed_over_goes_by_both_parents(tmp_path: Path) -> None:
    told = [*run(0, 0, range(6)), *run(0, 0, range(6, 12), "odom")]
    told += [transform(0, "map", "odom", at(0), stays=True)]
    recording = opened(tmp_path, [*told, *seen(0, 2, 9)])

    assert xs(recording) == [2, 9]
    assert not any("by turns" in note for note in recording.notes)


def test_static_transforms_by_turns_in_two_parents_are_those_of_one(tmp_path: Path) -> None:
    static = [
        recorded(transform(0, parent, "lidar", at(x), stays=True), k + late)
        for k in TIMES
        for parent, x, late in (("base_link", 0.25, 0), ("arm", 0.75, 0.5))
    ]
    told = [*run(0, 0, TIMES), *static, *seen(0, 2, 2.75, 6.25, frame="lidar")]

    assert xs(opened(tmp_path, told, frame="map")) == [2.25, 3, 6.5]


# Two places


@pytest.mark.parametrize("frame", ["base_link", "lidar"])
def test_clouds_of_one_of_two_robots_with_the_same_frames_are_refused(
    tmp_path: Path, frame: str
) -> None:
    mounted = transform(0, "base_link", "lidar", at(0.5), stays=True)
    told = [*robots(), mounted, *seen(0, 2, 5, frame=frame)]

    with pytest.raises(InputError, match=r"'base_link' in 'map' is told at two places by turns, "):
        opened(tmp_path, told)


def test_clouds_that_need_no_such_transform_are_mapped_without_a_route(tmp_path: Path) -> None:
    recording = opened(tmp_path, [*robots(), cloud(2, "map")])

    assert xs(recording) == [0]
    assert np.isnan(positions_of(recording)).all()
    assert any("told at two places by turns" in note for note in recording.notes)


def test_poses_of_a_topic_move_the_clouds_instead(tmp_path: Path) -> None:
    poses = [recorded(odometry(k, at(k), "map"), k) for k in TIMES]
    recording = opened(tmp_path, [*robots(), *poses, *seen(0, 3)], pose_topic="/odometry")

    assert xs(recording) == [3]


def test_poses_of_two_robots_in_one_topic_are_refused(tmp_path: Path) -> None:
    poses = [
        recorded(odometry(k + late, at(k + shift), "map"), k + late)
        for k in TIMES
        for shift, late in ((0, 0), (30, 0.5))
    ]

    with pytest.raises(InputError, match=r"`pose_topic` /odometry: its poses are told at two"):
        opened(tmp_path, [*poses, *seen(0, 3)], pose_topic="/odometry")


def test_two_mountings_of_a_sensor_by_turns_are_refused(tmp_path: Path) -> None:
    mounted = [
        recorded(transform(k + late, "base_link", "lidar", at(x)), k + late)
        for k in TIMES
        for x, late in ((0.25, 0.1), (0.75, 0.6))
    ]

    with pytest.raises(InputError, match=r"'lidar' in 'base_link' is told at two places"):
        opened(tmp_path, [*run(0, 0, TIMES), *mounted, *seen(0, 3, frame="lidar")])
