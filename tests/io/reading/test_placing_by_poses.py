"""Clouds brought into the map frame by the poses of a topic or of a trajectory.

How these tests could be cheated: by poses without rotation, or by times at which a pose was
told. So every pose turns and shifts, and clouds stand between poses.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mlscli.errors import InputError, UsageError
from mlscli.io.reading.recording import open_recording
from tests.helpers.craft import (
    BEGIN,
    FIRST,
    LEVER,
    SECOND_POSE,
    assert_near,
    between,
    cloud,
    clouds_of,
    matrix,
    moved,
    moving,
    odometry,
    opened,
    positions_of,
    transform,
)
from tests.helpers.texts import text


def test_poses_move_clouds_in_the_frame_of_the_craft(tmp_path: Path) -> None:
    recording = opened(
        tmp_path,
        [odometry(0, FIRST), odometry(4, SECOND_POSE), cloud(1, "base_link")],
        pose_topic="odometry",
    )
    (keyframe,) = recording.keyframes()
    base = between(FIRST, SECOND_POSE, 0.25)

    assert recording.frame_id == "odom"
    assert_near(keyframe.points, moved(base))
    assert_near(keyframe.position, base[:3, 3])
    assert not any("mounting" in note for note in recording.notes)


def test_poses_in_a_frame_below_the_map_are_moved_on(tmp_path: Path) -> None:
    messages = [
        transform(0, "map", "odom", LEVER, stays=True),
        odometry(0, FIRST),
        odometry(4, SECOND_POSE),
        cloud(0, "base_link"),
    ]
    recording = opened(tmp_path, messages, pose_topic="/odometry", frame="map")

    assert_near(clouds_of(recording), [moved(matrix(LEVER), matrix(FIRST))])
    assert_near(positions_of(recording), [(matrix(LEVER) @ matrix(FIRST))[:3, 3]])


def test_poses_in_a_frame_that_nothing_leads_from_are_an_error(tmp_path: Path) -> None:
    messages = [odometry(0, FIRST), odometry(4, SECOND_POSE), cloud(0, "base_link")]

    with pytest.raises(InputError, match=r"`pose_topic` /odometry: .*'odom' to 'map'"):
        opened(tmp_path, messages, pose_topic="/odometry", frame="map")


@pytest.mark.parametrize("connected_at", [0, 10])
@pytest.mark.parametrize("frame", ["map", "base_link"])
def test_poses_whose_frame_is_in_the_map_at_times_count_at_these(
    tmp_path: Path, connected_at: int, frame: str
) -> None:
    elsewhere = 10 - connected_at
    messages = [
        *(transform(connected_at + t, "map", "odom", LEVER) for t in (0, 4)),
        *(transform(elsewhere + t, "hall", "odom", LEVER) for t in (0, 4)),
        *(odometry(t, FIRST) for t in (0, 4, 10, 14)),
        *(cloud(t, frame) for t in (2, 12)),
    ]
    recording = opened(tmp_path, messages, pose_topic="/odometry", frame="map")
    keyframes = list(recording.keyframes())
    (there,) = (k for k in keyframes if k.stamp == BEGIN + connected_at + 2)
    position = (matrix(LEVER) @ matrix(FIRST))[:3, 3]
    if frame == "map":
        # Taken as they are; where the craft was is known of one.
        assert len(keyframes) == 2
        assert_near(there.position, position)
        assert np.isnan([k.position for k in keyframes if k is not there]).all()
    else:
        assert len(keyframes) == 1
        assert_near(there.points, moved(matrix(LEVER), matrix(FIRST)))
        assert recording.tally.unplaced == 1


def test_poses_of_several_bodies_in_one_topic_are_not_mixed(tmp_path: Path) -> None:
    messages = [
        odometry(0, FIRST),
        odometry(4, SECOND_POSE),
        odometry(2, LEVER, child="arm"),
        cloud(2, "base_link"),
    ]

    with pytest.raises(
        InputError, match=r"`pose_topic` /odometry: .*'arm' in 'odom', of 'base_link'"
    ):
        opened(tmp_path, messages, pose_topic="/odometry")


def test_a_topic_without_poses_is_wrong_usage_that_lists_those_with(tmp_path: Path) -> None:
    messages = [odometry(0, FIRST), cloud(0, "base_link")]

    with pytest.raises(UsageError, match="found no poses; topics with poses: /odometry"):
        opened(tmp_path, messages, pose_topic="/odometrie")
    with pytest.raises(UsageError, match="/cloud: sensor_msgs/msg/PointCloud tells no poses"):
        open_recording(tmp_path / "flight", pose_topic="/cloud")


def test_a_trajectory_tells_where_the_craft_was_before_all_else(tmp_path: Path) -> None:
    tum = tmp_path / "route.tum"
    tum.write_text(f"{BEGIN} 1 2 3 0 0 0 1\n{BEGIN + 4} 5 2 3 0 0 0 1\n")
    messages = [*moving(), cloud(1, "base_link"), cloud(5.9, "base_link"), cloud(6, "base_link")]
    recording = opened(tmp_path, messages, route=tum)

    assert_near(clouds_of(recording)[0], moved(between(FIRST, SECOND_POSE, 0.25)))
    assert_near(positions_of(recording), [(2, 2, 3), (5, 2, 3), (5, 2, 3)])


def test_what_is_cut_off_a_route_is_a_loss_of_the_recording(tmp_path: Path) -> None:
    path = text(tmp_path, "0 0 0 5\n1 1 0 5\n2 2", "route.txt")
    recording = open_recording(text(tmp_path, "1 2 3\n"), route=path)
    (loss,) = recording.losses
    assert "route.txt:3: found 2 columns" in loss


@pytest.mark.parametrize(
    ("begin", "unit", "known"),
    [(1_700_000_000, 1, True), (1_700_000_000, 10**9, True), (100, 1, False)],
)
def test_a_route_of_other_times_than_the_clouds_is_told(
    tmp_path: Path, begin: int, unit: int, known: bool
) -> None:
    # The cloud's times are in nanoseconds; what the route's are in is told apart from them.
    rows = "".join(f"{1_700_000_000 + k // 3}000000000,{k},1,2\n" for k in range(12))
    cloud_path = text(tmp_path, "t,x,y,z\n" + rows)
    path = "".join(f"{(begin + k) * unit} {k} 5 6 0 0 0 1\n" for k in range(4))
    recording = open_recording(cloud_path, route=text(tmp_path, path, "route.txt"))

    positions = positions_of(recording)
    assert positions[:4] == ([(k, 5, 6) for k in range(4)] if known else positions[:4])
    assert len(positions) == (4 if known else 8)
    told = [note for note in recording.notes if "it is a route of its own" in note]
    assert len(told) == (not known)
