"""Recorded messages of other people's sensors.

How these tests could be cheated: by reading each file in a way of its own. So the recordings
that exist in ROS 1 and ROS 2 must give the same arrays, and the others what rosbags reads.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from mlscli.io.containers.container import Channel, Message
from mlscli.io.messages.decoding import Deserializer
from mlscli.io.messages.registry import CloudPart
from mlscli.io.source import StampedPoses
from tests.helpers.decoders import DECODERS


def of_bag(path: Path, type_: str) -> Iterator[Message]:
    with AnyReader([path]) as reader:
        encoding, dialect = ("cdr", "ros2msg") if reader.is2 else ("ros1", "ros1msg")
        connections = [c for c in reader.connections if c.msgtype == type_]
        for connection, time, data in reader.messages(connections):
            schema = connection.msgdef.data.encode()
            channel = Channel(connection.topic, type_, encoding, schema, dialect, None)
            yield Message(channel, time, data)


def decoded(messages: Iterator[Message]) -> list[Any]:
    deserializer = Deserializer()
    return [
        part
        for message in messages
        for part in DECODERS[message.channel.type](deserializer.read(message))
    ]


def test_a_scan_is_the_same_in_both_versions_of_ros(shared_data: Path) -> None:
    scans: list[list[CloudPart]] = [
        decoded(of_bag(shared_data / "bags" / name, "sensor_msgs/msg/LaserScan"))
        for name in ("ros1_jackal_scan_pose.bag", "ros2_jackal_scan_pose")
    ]

    assert len(scans[0]) == len(scans[1]) == 189
    for one, two in zip(*scans, strict=True):
        assert one.points.tobytes() == two.points.tobytes()
        assert (one.frame_id, one.stamp) == (two.frame_id, two.stamp)
        distances = np.linalg.norm(one.points[np.isfinite(one.points[:, 0])], axis=1)
        assert len(distances) > 100
        assert distances.max() < 31


def test_poses_are_the_same_in_both_versions_of_ros(shared_data: Path) -> None:
    poses: list[list[StampedPoses]] = [
        decoded(of_bag(shared_data / "bags" / name, "geometry_msgs/msg/PoseStamped"))
        for name in ("ros1_jackal_scan_pose.bag", "ros2_jackal_scan_pose")
    ]

    assert len(poses[0]) == len(poses[1]) == 2283
    for one, two in zip(*poses, strict=True):
        assert [a.tobytes() for a in one[:3]] == [a.tobytes() for a in two[:3]]
        assert (one.parent, one.child, one.refused) == (two.parent, two.child, two.refused)
        assert (one.parent, one.refused) == ("world", 0)


def test_transforms_are_the_same_in_both_versions_of_ros(shared_data: Path) -> None:
    transforms: list[list[StampedPoses]] = [
        decoded(of_bag(shared_data / "bags" / name, "tf2_msgs/msg/TFMessage"))
        for name in ("ros1_tf_example.bag", "ros2_tf_example")
    ]

    assert len(transforms[0]) == len(transforms[1]) >= 518
    for one, two in zip(*transforms, strict=True):
        assert [a.tobytes() for a in one[:3]] == [a.tobytes() for a in two[:3]]
        assert one[3:] == two[3:]


def test_the_old_transforms_of_a_tilting_laser_name_frames_without_a_slash(
    shared_data: Path,
) -> None:
    transforms = decoded(of_bag(shared_data / "bags/ros1_tilt_laser_tf.bag", "tf/msg/tfMessage"))
    scans = decoded(
        of_bag(shared_data / "bags/ros1_tilt_laser_tf.bag", "sensor_msgs/msg/LaserScan")
    )

    frames = {poses.parent for poses in transforms} | {poses.child for poses in transforms}
    assert not [frame for frame in frames if frame.startswith("/")]
    assert {scan.frame_id for scan in scans} == {"/laser"}
    assert "laser" in frames
    assert len(scans) == 178


def test_a_spinning_lidar_in_an_mcap_of_ros_1_is_read(shared_data: Path) -> None:
    clouds = []
    with (shared_data / "bags/ros1_ouster_in_mcap_zstd.mcap").open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            if schema is None or schema.name != "sensor_msgs/PointCloud2":
                continue
            type_ = "sensor_msgs/msg/PointCloud2"
            made = Channel(channel.topic, type_, "ros1", schema.data, schema.encoding, None)
            clouds.append(Message(made, message.log_time, message.data))

    parts = decoded(iter(clouds))

    assert [part.points.shape for part in parts] == [(64 * 2048, 3)] * 2
    zeros = np.concatenate([part.points == 0 for part in parts]).all(axis=1).mean()
    assert 0.6 < zeros < 0.7


def test_a_lidar_with_gaps_between_its_fields_is_read(shared_data: Path) -> None:
    path, type_ = shared_data / "bags/ros1_luminar_pc2_lz4.bag", "sensor_msgs/msg/PointCloud2"

    parts = decoded(of_bag(path, type_))

    assert len(parts) == 5
    with AnyReader([path]) as reader:
        for part, message in zip(parts, of_bag(path, type_), strict=True):
            plain: Any = reader.deserialize(bytes(message.data), type_)
            at = next(field.offset for field in plain.fields if field.name == "y")
            rows = plain.data.reshape(-1, plain.point_step)[:, at : at + 4]
            expected = np.ascontiguousarray(rows).view("<f4").ravel().astype(float)
            np.testing.assert_array_equal(part.points[:, 1], expected)
            assert (part.frame_id, part.keyframes) == ("luminar_lidar", None)
