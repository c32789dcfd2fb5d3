"""Clouds brought into the map frame by transforms, poses and mountings.

How these tests could be cheated: by poses without rotation, by sensors at the craft's origin, by
one transform where there are several, or by times at which a pose was told. So every pose turns
and shifts, chains are of several frames, clouds stand between poses, and what must come out is
computed here with 4 x 4 matrices.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from mlscli.errors import InputError, UsageError
from mlscli.io.recording import Recording, open_recording
from mlscli.typing import Float64
from tests.bags import Told, write_told
from tests.ros import header, vector

POINTS = np.array([[1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.5, -1.0, 3.0]])
SECOND = 10**9
BEGIN = 1_600_000_000

Pose = tuple[tuple[float, float, float], tuple[float, float, float]]
"""x, y, z, and the angles of turns about x, y and z in degrees."""

FIRST: Pose = ((10.0, -4.0, 2.0), (10.0, -20.0, 30.0))
SECOND_POSE: Pose = ((14.0, 0.0, 3.0), (-15.0, 5.0, 80.0))
MOUNT: Pose = ((0.3, 0.1, -0.2), (180.0, 10.0, 45.0))
LEVER: Pose = ((0.0, 0.5, 0.1), (0.0, 90.0, -30.0))


def rotation(pose: Pose) -> Rotation:
    return Rotation.from_euler("xyz", pose[1], degrees=True)


def matrix(pose: Pose) -> Float64:
    whole = np.eye(4)
    whole[:3, :3], whole[:3, 3] = rotation(pose).as_matrix(), pose[0]
    return whole


def between(first: Pose, second: Pose, share: float) -> Float64:
    """Return the matrix of a pose on the way from one to another."""
    whole = np.eye(4)
    turns = Rotation.concatenate([rotation(first), rotation(second)])
    whole[:3, :3] = Slerp([0.0, 1.0], turns)(share).as_matrix()
    whole[:3, 3] = (1 - share) * np.array(first[0]) + share * np.array(second[0])
    return whole


def moved(*matrices: Float64, points: Float64 = POINTS) -> Float64:
    """Return points moved by the product of matrices."""
    whole = np.eye(4)
    for each in matrices:
        whole = whole @ each
    return points @ whole[:3, :3].T + whole[:3, 3]


def content(pose: Pose, place: str, turn: str) -> dict[str, Any]:
    return {place: vector(*pose[0]), turn: vector(*rotation(pose).as_quat())}


def stamp(seconds: float) -> int:
    return round(seconds * SECOND)


def head(seconds: float, frame: str) -> dict[str, Any]:
    whole, rest = divmod(stamp(seconds), SECOND)
    return header(BEGIN + whole, rest, frame)


def log_time(seconds: float) -> int:
    """Return when a message is recorded: a while after the time in its header."""
    return (BEGIN + 1000) * SECOND + stamp(seconds)


def cloud(seconds: float, frame: str, points: Float64 = POINTS, topic: str = "/cloud") -> Told:
    listed = [vector(*point) for point in points.tolist()]
    message = {"header": head(seconds, frame), "points": listed}
    return Told(topic, "sensor_msgs/msg/PointCloud", message, log_time(seconds))


def transform(
    seconds: float, parent: str, child: str, pose: Pose, *, stays: bool = False, old: bool = False
) -> Told:
    each = {
        "header": head(seconds, parent),
        "child_frame_id": child,
        "transform": content(pose, "translation", "rotation"),
    }
    type_ = "tf/msg/tfMessage" if old else "tf2_msgs/msg/TFMessage"
    topic = "/tf_static" if stays else "/tf"
    return Told(topic, type_, {"transforms": [each]}, log_time(seconds))


def odometry(seconds: float, pose: Pose, parent: str = "odom", child: str = "base_link") -> Told:
    message = {
        "header": head(seconds, parent),
        "child_frame_id": child,
        "pose": {"pose": content(pose, "position", "orientation")},
    }
    return Told("/odometry", "nav_msgs/msg/Odometry", message, log_time(seconds))


def pose_stamped(seconds: float, pose: Pose, parent: str = "world") -> Told:
    message = {
        "header": head(seconds, parent),
        "pose": content(pose, "position", "orientation"),
    }
    return Told("/pose", "geometry_msgs/msg/PoseStamped", message, log_time(seconds))


def moving(parent: str = "map", child: str = "base_link", **options: Any) -> list[Told]:
    """Return a frame's transforms at 0 and at 4 s."""
    return [
        transform(0, parent, child, FIRST, **options),
        transform(4, parent, child, SECOND_POSE, **options),
    ]


def opened(path: Path, messages: Iterable[Told], kind: str = "ros1", **options: Any) -> Recording:
    told = sorted(messages, key=lambda message: message.log_time)
    return open_recording(write_told(path / "flight", told, kind), **options)


def clouds_of(recording: Recording) -> list[Float64]:
    return [keyframe.points for keyframe in recording.keyframes()]


def positions_of(recording: Recording) -> list[tuple[float, float, float]]:
    return [keyframe.position for keyframe in recording.keyframes()]


def assert_near(found: Any, expected: Any) -> None:
    np.testing.assert_allclose(found, expected, atol=1e-6)


# Transforms


@pytest.mark.parametrize("kind", ["ros1", "ros2", "mcap"])
def test_a_sensor_is_moved_through_frames_that_move_and_frames_that_stay(
    tmp_path: Path, kind: str
) -> None:
    recording = opened(
        tmp_path,
        [
            *moving(),
            transform(0, "base_link", "arm", LEVER, stays=True),
            transform(0, "arm", "lidar", MOUNT, stays=True),
            cloud(1, "lidar"),
            cloud(4, "lidar"),
        ],
        kind,
    )
    first, second = recording.keyframes()

    assert recording.frame_id == "map"
    base = between(FIRST, SECOND_POSE, 0.25)
    assert_near(first.points, moved(base, matrix(LEVER), matrix(MOUNT)))
    assert_near(second.points, moved(matrix(SECOND_POSE), matrix(LEVER), matrix(MOUNT)))
    # The craft is where its own frame is, not where the sensor is.
    assert_near(first.position, base[:3, 3])
    assert [first.stamp, second.stamp] == [BEGIN + 1, BEGIN + 4]
    assert any("moved from 'lidar' into 'map' by the transforms" in n for n in recording.notes)


def test_the_first_generation_of_transforms_with_slashes_before_names(tmp_path: Path) -> None:
    recording = opened(
        tmp_path,
        [
            *moving("/odom", "/base_link", old=True),
            transform(0, "base_link", "/lidar", MOUNT, old=True),
            transform(4, "/base_link", "lidar", MOUNT, old=True),
            cloud(2, "/lidar"),
        ],
    )

    assert_near(clouds_of(recording), [moved(between(FIRST, SECOND_POSE, 0.5), matrix(MOUNT))])
    assert recording.frame_id == "odom"


def test_the_map_is_the_topmost_of_the_world_frames(tmp_path: Path) -> None:
    messages = [
        transform(0, "map", "odom", LEVER, stays=True),
        *moving("odom"),
        cloud(0, "base_link"),
    ]
    recording = opened(tmp_path, messages)
    other = open_recording(tmp_path / "flight", frame="/odom")

    assert (recording.frame_id, other.frame_id) == ("map", "odom")
    assert_near(clouds_of(recording), [moved(matrix(LEVER), matrix(FIRST))])
    assert_near(clouds_of(other), [moved(matrix(FIRST))])


def test_a_root_below_which_something_moves_is_a_map(tmp_path: Path) -> None:
    recording = opened(tmp_path, [*moving("hall", "lidar"), cloud(0, "lidar")])

    assert recording.frame_id == "hall"
    assert_near(clouds_of(recording), [moved(matrix(FIRST))])


def test_a_root_that_all_hangs_below_unmoved_is_a_part_of_the_craft(tmp_path: Path) -> None:
    messages = [transform(0, "mast", "lidar", MOUNT, stays=True), cloud(0, "lidar")]

    with pytest.raises(InputError, match="lead to 'mast' only; where 'mast' stands still, --frame"):
        opened(tmp_path, messages)
    assert_near(
        clouds_of(open_recording(tmp_path / "flight", frame="mast")), [moved(matrix(MOUNT))]
    )


def test_clouds_in_a_world_frame_stay_while_the_craft_moves_in_another(tmp_path: Path) -> None:
    recording = opened(
        tmp_path,
        [transform(0, "map", "odom", LEVER, stays=True), *moving("odom"), cloud(2, "map")],
    )
    (keyframe,) = recording.keyframes()

    assert keyframe.points.tolist() == POINTS.tolist()
    where = matrix(LEVER) @ between(FIRST, SECOND_POSE, 0.5)
    assert_near(keyframe.position, where[:3, 3])


def test_a_cloud_without_a_transform_at_its_time_is_left_out_and_counted(tmp_path: Path) -> None:
    # Two seconds, half a period, are bridged at either end.
    times = [-2.1, -1.9, 4, 5.9, 6.1, 60]
    recording = opened(tmp_path, [*moving(), *(cloud(t, "base_link") for t in times)])
    found = clouds_of(recording)

    assert_near(found[0], moved(matrix(FIRST)))
    assert_near(found[2], moved(matrix(SECOND_POSE)))
    assert len(found) == 3
    assert recording.tally.unplaced == 3
    assert recording.tally.dropped == {"no transform at their time": 9}
    assert any("3 of 6 keyframes are left out" in note for note in recording.notes)


def test_where_no_cloud_has_a_transform_at_its_time_the_error_says_so(tmp_path: Path) -> None:
    recording = opened(tmp_path, [*moving(), cloud(99, "base_link")])

    with pytest.raises(InputError, match="all 3 were dropped, 3 no transform at their time"):
        list(recording.keyframes())


def test_frames_that_nothing_connects_are_an_error_that_names_them(tmp_path: Path) -> None:
    messages = [*moving(), transform(0, "rover", "lidar", MOUNT), cloud(0, "lidar")]

    with pytest.raises(InputError, match=r"/flight: /cloud.*'lidar'.* to 'map'"):
        opened(tmp_path, messages, frame="map")


def test_frames_in_a_circle_are_an_error_only_for_clouds_below_them(tmp_path: Path) -> None:
    circle = [transform(0, "a", "b", MOUNT), transform(0, "b", "a", MOUNT)]
    taken = opened(tmp_path, [*circle, cloud(0, "map")])

    assert clouds_of(taken)[0].tolist() == POINTS.tolist()
    (tmp_path / "other").mkdir()
    with pytest.raises(InputError, match=r"/flight: .*circle"):
        opened(tmp_path / "other", [*circle, cloud(0, "b")])


# Several frames, several sources, points that are no measurement


def markers(seconds: float, frames: Iterable[str]) -> Told:
    listed = [
        {
            "header": head(seconds, frame),
            "id": number,
            "type": 8,
            "scale": vector(1, 1, 1),
            "pose": {"orientation": vector(0, 0, 0, 1)},
            "points": [vector(*point) for point in POINTS.tolist()],
        }
        for number, frame in enumerate(frames)
    ]
    type_ = "visualization_msgs/msg/MarkerArray"
    return Told("/markers", type_, {"markers": listed}, log_time(seconds))


def test_the_markers_of_one_message_are_each_in_a_frame_of_their_own(tmp_path: Path) -> None:
    recording = opened(
        tmp_path,
        [
            *moving(),
            transform(0, "base_link", "lidar", MOUNT, stays=True),
            markers(4, ["base_link", "map", "lidar"]),
        ],
    )
    found = np.concatenate(clouds_of(recording))

    expected = [
        moved(matrix(SECOND_POSE)), POINTS, moved(matrix(SECOND_POSE), matrix(MOUNT)),
    ]  # fmt: skip
    assert_near(found, np.concatenate(expected))


def test_start_and_end_go_by_the_times_of_markers(tmp_path: Path) -> None:
    told = [markers(seconds, ["map"]) for seconds in (0, 1, 2, 3)]

    assert len(clouds_of(opened(tmp_path, told, start=0.5, end=2))) == 2


def test_each_source_has_transforms_that_serve_all(tmp_path: Path) -> None:
    one, two = tmp_path / "one", tmp_path / "two"
    write_told(one, [*moving(), cloud(0, "base_link")])
    write_told(two, [transform(0, "base_link", "lidar", MOUNT, stays=True), cloud(4, "lidar")])

    first, second = open_recording(one, two).keyframes()

    assert_near(first.points, moved(matrix(FIRST)))
    assert_near(second.points, moved(matrix(SECOND_POSE), matrix(MOUNT)))


def test_nothing_returns_from_where_a_sensor_is_itself(tmp_path: Path) -> None:
    points = np.array([[0.0, 0.0, 0.0], [-0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 2.0]])
    sensor = opened(tmp_path, [*moving(), cloud(0, "base_link", points)])
    (tmp_path / "world").mkdir()
    world = opened(tmp_path / "world", [cloud(0, "map", points)])

    assert_near(clouds_of(sensor), [moved(matrix(FIRST), points=points[2:])])
    assert sensor.tally.dropped == {"no return": 2}
    assert len(clouds_of(world)[0]) == 4
    assert world.tally.dropped == {}


# Times


def test_recordings_whose_headers_are_empty_go_by_the_time_of_recording(tmp_path: Path) -> None:
    def without_time(told: Told) -> Told:
        inside = told.content["transforms"][0] if "transforms" in told.content else told.content
        inside["header"]["stamp"] = {"sec": 0, "nanosec": 0}
        return told

    messages = [*map(without_time, [*moving(), cloud(1, "base_link")])]
    recording = opened(tmp_path, messages, time_source="log")
    (keyframe,) = recording.keyframes()

    assert_near(keyframe.points, moved(between(FIRST, SECOND_POSE, 0.25)))
    assert keyframe.stamp == BEGIN + 1001


# Poses of a topic


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
        ([cloud(0, "lidar")], "found the frames none; give --pose-topic too"),
    ],
)
def test_a_mounting_that_fits_nothing_is_wrong_usage(
    tmp_path: Path, messages: list[Told], words: str
) -> None:
    with pytest.raises(UsageError, match=words):
        opened(tmp_path, messages, extrinsic=numbers(MOUNT))


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

    with pytest.raises(InputError, match=r"--pose-topic /odometry: .*'odom' to 'map'"):
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
        InputError, match=r"--pose-topic /odometry: .*'arm' in 'odom', of 'base_link'"
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
