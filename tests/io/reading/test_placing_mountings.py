"""Where a sensor is on the craft: as transforms know it, as the user tells it, or unknown.

How these tests could be cheated: by sensors at the craft's origin. So every mounting turns and
shifts, and the craft itself must not be where its sensor is.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from mlscli.errors import UsageError
from tests.helpers.bags import Told
from tests.helpers.craft import (
    FIRST,
    LEVER,
    MOUNT,
    SECOND_POSE,
    Pose,
    assert_near,
    between,
    cloud,
    clouds_of,
    matrix,
    moved,
    moving,
    odometry,
    opened,
    pose_stamped,
    positions_of,
    rotation,
    transform,
)


def test_the_mounting_comes_from_the_transforms_where_they_know_it(tmp_path: Path) -> None:
    recording = opened(
        tmp_path,
        [
            odometry(0, FIRST),
            odometry(4, SECOND_POSE),
            transform(0, "base_link", "arm", LEVER, stays=True),
            transform(0, "arm", "lidar", MOUNT, stays=True),
            cloud(1, "lidar"),
        ],
        pose_topic="/odometry",
    )
    (keyframe,) = recording.keyframes()
    base = between(FIRST, SECOND_POSE, 0.25)

    assert_near(keyframe.points, moved(base, matrix(LEVER), matrix(MOUNT)))
    assert_near(keyframe.position, base[:3, 3])


def test_a_mounting_that_nobody_knows_is_taken_as_none_and_said(tmp_path: Path) -> None:
    messages = [pose_stamped(0, FIRST), pose_stamped(4, SECOND_POSE), cloud(4, "velodyne")]
    recording = opened(tmp_path, messages, pose_topic="/pose")

    assert_near(clouds_of(recording), [moved(matrix(SECOND_POSE))])
    assert recording.frame_id == "world"
    assert any("'velodyne' on the craft is not known" in note for note in recording.notes)


def numbers(pose: Pose) -> list[float]:
    return [*pose[0], *rotation(pose).as_quat().tolist()]


def test_the_user_tells_where_the_sensor_is_on_the_craft(tmp_path: Path) -> None:
    messages = [pose_stamped(0, FIRST), pose_stamped(4, SECOND_POSE), cloud(1, "velodyne")]
    recording = opened(tmp_path, messages, pose_topic="/pose", extrinsic=numbers(MOUNT))
    (keyframe,) = recording.keyframes()
    base = between(FIRST, SECOND_POSE, 0.25)

    assert_near(keyframe.points, moved(base, matrix(MOUNT)))
    assert_near(keyframe.position, base[:3, 3])
    assert not any("not known" in note for note in recording.notes)


def test_the_user_tells_it_beside_transforms_of_the_craft(tmp_path: Path) -> None:
    recording = opened(tmp_path, [*moving(), cloud(4, "lidar")], extrinsic=numbers(MOUNT))

    assert_near(clouds_of(recording), [moved(matrix(SECOND_POSE), matrix(MOUNT))])
    assert_near(positions_of(recording), [SECOND_POSE[0]])
    assert any("'lidar' is taken as mounted on 'base_link'" in n for n in recording.notes)


@pytest.mark.parametrize(
    ("messages", "words"),
    [
        ([*moving(), cloud(0, "base_link")], "transforms tell where 'base_link' is; leave it out"),
        ([*moving(), cloud(0, "map")], "transforms tell where 'map' is; leave it out"),
        ([*moving(), cloud(0, "world")], "in the frame 'world', which is on no craft"),
        ([*moving(), cloud(0, "")], "in no frame, which is on no craft"),
        ([cloud(0, "lidar")], "found the frames none; give `pose_topic` too"),
    ],
)
def test_a_mounting_that_fits_nothing_is_wrong_usage(
    tmp_path: Path, messages: list[Told], words: str
) -> None:
    with pytest.raises(UsageError, match=words):
        opened(tmp_path, messages, extrinsic=numbers(MOUNT))
