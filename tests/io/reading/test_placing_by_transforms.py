"""Clouds brought into the map frame by transforms.

How these tests could be cheated: by transforms without rotation, by one transform where there
are several, or by times at which a transform was told. So every transform turns and shifts,
chains are of several frames, and clouds stand between transforms.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest

from mlscli.errors import InputError
from mlscli.io.reading.recording import open_recording
from tests.helpers.bags import Told, write_told
from tests.helpers.craft import (
    BEGIN,
    FIRST,
    LEVER,
    MOUNT,
    POINTS,
    SECOND_POSE,
    assert_near,
    between,
    cloud,
    clouds_of,
    head,
    log_time,
    matrix,
    moved,
    moving,
    opened,
    rotation,
    transform,
)
from tests.helpers.ros import vector

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


def test_a_transform_that_was_left_out_is_told_where_nothing_leads_on(tmp_path: Path) -> None:
    mount = transform(0, "base_link", "lidar", MOUNT, stays=True)
    mount.content["transforms"][0]["transform"]["rotation"] = vector(0, 0, 0, 0)

    with pytest.raises(InputError, match=r"/tf_static: 1 pose left out, not finite or with a quat"):
        opened(tmp_path, [*moving("odom"), mount, cloud(0, "lidar")])


def test_a_root_below_which_something_moves_is_a_map(tmp_path: Path) -> None:
    recording = opened(tmp_path, [*moving("hall", "lidar"), cloud(0, "lidar")])

    assert recording.frame_id == "hall"
    assert_near(clouds_of(recording), [moved(matrix(FIRST))])


def test_a_root_that_all_hangs_below_unmoved_is_a_part_of_the_craft(tmp_path: Path) -> None:
    messages = [transform(0, "mast", "lidar", MOUNT, stays=True), cloud(0, "lidar")]

    with pytest.raises(InputError, match="lead to 'mast' only; where 'mast' stands still, `frame`"):
        opened(tmp_path, messages)
    assert_near(
        clouds_of(open_recording(tmp_path / "flight", frame="mast")), [moved(matrix(MOUNT))]
    )


def told_the_other_way(child: str) -> list[Told]:
    """Return the poses of the craft as transforms of the world below it."""
    way = []
    for seconds, pose in ((0, FIRST), (4, SECOND_POSE)):
        back = rotation(pose).inv()
        x, y, z = back.apply(np.negative(pose[0])).tolist()
        angles = tuple(back.as_euler("xyz", degrees=True).tolist())
        way.append(transform(seconds, "base_link", child, ((x, y, z), angles)))
    return way


@pytest.mark.parametrize("sensor", ["base_link", "lidar"])
def test_a_world_told_below_the_craft_is_the_map_all_the_same(tmp_path: Path, sensor: str) -> None:
    mount = [transform(0, "base_link", "lidar", MOUNT, stays=True)] if sensor == "lidar" else []
    recording = opened(tmp_path, [*told_the_other_way("odom"), *mount, cloud(4, sensor)])

    assert recording.frame_id == "odom"
    there = [matrix(SECOND_POSE)] + ([matrix(MOUNT)] if mount else [])
    assert_near(clouds_of(recording), [moved(*there)])


def test_what_moves_below_the_craft_without_the_name_of_a_world_is_offered(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="'tag_0' below; `frame` takes one that stands still"):
        opened(tmp_path, [*told_the_other_way("tag_0"), cloud(0, "base_link")])
    told = open_recording(tmp_path / "flight", frame="tag_0")
    assert_near(clouds_of(told), [moved(matrix(FIRST))])


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


def test_a_part_of_a_split_recording_without_static_transforms_names_what_hangs_the_sensor(
    tmp_path: Path,
) -> None:
    with pytest.raises(InputError, match="`extrinsic` hangs it below 'base_link'"):
        opened(tmp_path, [*moving("odom"), cloud(1, "lidar")])
