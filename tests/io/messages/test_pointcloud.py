"""Clouds whose points are listed one by one.

How these tests could be cheated: by a decoder that is given what it makes itself. So messages
are serialized by rosbags, in both versions of ROS.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest

from mlscli.io.messages.decoding import Deserializer
from mlscli.io.messages.registry import CLOUD_TYPES, CloudPart, MalformedCloudError
from tests.helpers.ros import ENCODINGS, STORES, header, serialized, vector

POINT_CLOUD = "sensor_msgs/msg/PointCloud"
POSE_ARRAY = "geometry_msgs/msg/PoseArray"


def decode(encoding: str, type_: str, content: Any) -> CloudPart:
    message = serialized(encoding, type_, content)
    (part,) = CLOUD_TYPES[type_](Deserializer().read(message))
    return part


def point_cloud(channel: str, labels: list[float]) -> dict[str, Any]:
    return {
        "header": header(3, 500_000_000, "odom"),
        "points": [vector(i, 0.5, -1.0) for i in range(4)],
        "channels": [{"name": "rgb", "values": np.zeros(4)}, {"name": channel, "values": labels}],
    }


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_a_point_cloud_is_read_with_its_frame_and_time(encoding: str) -> None:
    part = decode(encoding, POINT_CLOUD, point_cloud("intensity", [1, 2, 3, 4]))

    assert part.points.dtype == np.float64
    assert part.points.tolist() == [[0, 0.5, -1], [1, 0.5, -1], [2, 0.5, -1], [3, 0.5, -1]]
    assert (part.frame_id, part.stamp, part.keyframes) == ("odom", 3.5, None)


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("name", ["keyframe", "kf", "kf_id"])
def test_a_keyframe_channel_splits_a_point_cloud(encoding: str, name: str) -> None:
    clouds = decode(encoding, POINT_CLOUD, point_cloud(name, [7, 3, 7, 3])).split()

    assert [[x for x, _, _ in cloud.tolist()] for cloud in clouds] == [[0, 2], [1, 3]]


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_of_two_channels_with_one_name_the_first_counts(encoding: str) -> None:
    content = point_cloud("kf", [7, 3, 7, 3])
    content["channels"].append({"name": "kf", "values": [1, 1, 1, 1]})

    assert len(decode(encoding, POINT_CLOUD, content).split()) == 2


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_a_keyframe_channel_of_another_length_is_refused(encoding: str) -> None:
    with pytest.raises(MalformedCloudError, match="3 values in channel kf, expected one for each"):
        decode(encoding, POINT_CLOUD, point_cloud("kf", [1, 2, 3]))


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("type_", [POINT_CLOUD, POSE_ARRAY])
def test_a_message_without_points_is_an_empty_cloud(encoding: str, type_: str) -> None:
    assert decode(encoding, type_, {"header": header()}).points.shape == (0, 3)


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_the_positions_of_a_pose_array_are_points(encoding: str) -> None:
    poses = [
        {"position": vector(1, 2, 3), "orientation": vector(0, 0, 0, 1)},
        {"position": vector(1e9 + 0.125, 5, 6), "orientation": vector(1, 0, 0, 0)},
    ]

    part = decode(encoding, POSE_ARRAY, {"header": header(9, 0, "map"), "poses": poses})

    assert part.points.tolist() == [[1, 2, 3], [1e9 + 0.125, 5, 6]]
    assert (part.frame_id, part.stamp) == ("map", 9)


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("type_", [POINT_CLOUD, POSE_ARRAY])
def test_reading_takes_no_longer_than_the_library_takes_for_objects(
    encoding: str, type_: str
) -> None:
    field = "points" if type_ == POINT_CLOUD else "poses"
    message = serialized(encoding, type_, {field: [{}] * 20_000})
    store, deserializer = STORES[encoding], Deserializer()
    library = store.deserialize_ros1 if encoding == "ros1" else store.deserialize_cdr

    def duration(work: Any) -> float:
        times = []
        for _ in range(3):
            begin = time.perf_counter()
            work()
            times.append(time.perf_counter() - begin)
        return min(times)

    ours = duration(lambda: CLOUD_TYPES[type_](deserializer.read(message)))
    assert ours < duration(lambda: library(message.data, type_))
