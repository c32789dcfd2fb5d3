"""From the bytes of a message to an object.

How these tests could be cheated: by reading everything with the types that come with a library,
whatever the recording defines. So definitions contradict those of the distribution and each
other.
"""

from __future__ import annotations

import struct

import numpy as np
import pytest

from mlscli.io.containers.container import Channel, Message
from mlscli.io.messages.decoding import Deserializer, MalformedMessageError
from tests.helpers import foxglove
from tests.helpers.decoders import DECODERS
from tests.helpers.ros import ENCODINGS, STORES, header, random_message, serialized, vector

TYPES = [type_ for type_ in DECODERS if "/" in type_]
WITH_HEADER = [
    "sensor_msgs/msg/PointCloud2",
    "sensor_msgs/msg/PointCloud",
    "sensor_msgs/msg/LaserScan",
    "visualization_msgs/msg/Marker",
    "geometry_msgs/msg/PoseArray",
    "nav_msgs/msg/Odometry",
    "nav_msgs/msg/Path",
]
FOXGLOVE_CLOUD = {
    "timestamp": {"sec": 1_700_000_000, "nsec": 250_000_000},
    "frame_id": "lidar",
    "pose": {"position": vector(0, 0, 0), "orientation": vector(0, 0, 0, 1)},
    "point_stride": 12,
    "fields": [{"name": name, "offset": 4 * at, "type": 7} for at, name in enumerate("xyz")],
    "data": struct.pack("<6f", 1, 2, 3, 4, 5, 6),
}


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("type_", WITH_HEADER)
@pytest.mark.parametrize("is_big_endian", [False, True])
@pytest.mark.parametrize("frame", ["map", "", "lidár/front"])
def test_the_time_and_frame_of_a_header_are_told_without_reading_the_message(
    encoding: str, type_: str, is_big_endian: bool, frame: str
) -> None:
    content = {"header": header(1_700_000_000, 123_456_789, frame)}
    message = serialized(encoding, type_, content, is_big_endian=is_big_endian)
    deserializer = Deserializer()

    assert deserializer.stamp(message) == 1_700_000_000.123456789
    assert deserializer.frame(message) == frame
    # Whatever follows the header may be damaged.
    message = message._replace(data=message.data[:40])
    assert deserializer.stamp(message) == 1_700_000_000.123456789


def test_times_before_1970_are_told_in_ros_2() -> None:
    content = {"header": header(-3, 250_000_000)}

    assert Deserializer().stamp(serialized("cdr", "nav_msgs/msg/Path", content)) == -2.75


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("type_", ["tf2_msgs/msg/TFMessage", "visualization_msgs/msg/MarkerArray"])
def test_a_message_without_a_header_has_no_time(encoding: str, type_: str) -> None:
    field = "transforms" if "tf" in type_ else "markers"
    message = serialized(encoding, type_, {field: [{"header": header(5, 0, "map")}] * 3})

    assert np.isnan(Deserializer().stamp(message))
    assert Deserializer().frame(message) == ""


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("length", [0, 1, 4, 7])
def test_a_message_too_short_for_a_time_has_none(encoding: str, length: int) -> None:
    message = serialized(encoding, "nav_msgs/msg/Path", {"header": header(5)})

    assert np.isnan(Deserializer().stamp(message._replace(data=message.data[:length])))


@pytest.mark.parametrize("spelling", foxglove.SPELLINGS)
def test_the_time_and_frame_of_a_foxglove_cloud_are_told(spelling: str) -> None:
    message = foxglove.message(spelling, "PointCloud", FOXGLOVE_CLOUD)

    assert Deserializer().stamp(message) == 1_700_000_000.25
    assert Deserializer().frame(message) == "lidar"


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_a_channel_is_read_by_its_own_definition(encoding: str) -> None:
    dialect = "ros1msg" if encoding == "ros1" else "ros2msg"
    mark = b"" if encoding == "ros1" else b"\0\1\0\0"
    texts = [b"float64 x\n", b"float32 y\nfloat32 x\n", b"int32 x\n"]
    bodies = [struct.pack("<d", 1.5), struct.pack("<ff", 9, 2.5), struct.pack("<i", -7)]
    messages = [
        Message(Channel("/a", "geometry_msgs/msg/Point", encoding, t, dialect, None), 0, mark + b)
        for t, b in zip(texts, bodies, strict=True)
    ]
    deserializer = Deserializer()

    assert [deserializer.read(m).x for m in messages + messages] == [1.5, 2.5, -7] * 2


@pytest.mark.parametrize(
    ("encoding", "type_"),
    [
        (encoding, type_)
        for encoding in ENCODINGS
        for type_ in TYPES
        # ROS 2 never had the old transforms; Foxglove's types come with neither.
        if "foxglove" not in type_ and (encoding, type_) != ("cdr", "tf/msg/tfMessage")
    ],
)
def test_without_a_definition_that_of_the_distribution_serves(encoding: str, type_: str) -> None:
    sent = random_message(STORES[encoding], type_, np.random.default_rng(3))
    with_schema = serialized(encoding, type_, sent)
    without = serialized(encoding, type_, sent, has_schema=False)

    assert str(Deserializer().read(without)) == str(Deserializer().read(with_schema))


def test_a_type_that_is_defined_nowhere_is_named() -> None:
    channel = Channel("/a", "foxglove_msgs/msg/PointCloud", "cdr", b"", "", None)
    deserializer = Deserializer()

    with pytest.raises(MalformedMessageError, match="lacks the definition of foxglove_msgs/msg/P"):
        deserializer.read(Message(channel, 0, bytes(80)))
    assert "foxglove_msgs/msg/PointCloud cannot be used" in deserializer.why_not(channel)


@pytest.mark.parametrize("encoding", ["cbor", "", "flatbuffer"])
def test_a_serialization_that_is_not_known_is_named(encoding: str) -> None:
    channel = Channel("/a", "foxglove.PointCloud", encoding, b"", "", None)
    deserializer = Deserializer()

    with pytest.raises(MalformedMessageError, match=f"serialized in '{encoding}', which cannot"):
        deserializer.read(Message(channel, 0, b"{}"))
    assert "can be read: ros1, cdr, protobuf, json" in deserializer.why_not(channel)
    assert np.isnan(deserializer.stamp(Message(channel, 0, b"{}")))


@pytest.mark.parametrize("spelling", foxglove.SPELLINGS)
def test_nothing_stands_against_a_channel_that_can_be_read(spelling: str) -> None:
    message = foxglove.message(spelling, "PointCloud", FOXGLOVE_CLOUD)

    assert Deserializer().why_not(message.channel) == ""


@pytest.mark.parametrize(
    "text", [b"[" * 100_000, b'{"a":' * 100_000, b"9" * 10_000, b"{", b"\xff\xfe", b""]
)
def test_json_that_is_damaged_or_made_to_harm_is_malformed(text: bytes) -> None:
    message = foxglove.message("json", "PointCloud", FOXGLOVE_CLOUD)

    with pytest.raises(MalformedMessageError, match=r"is no foxglove.PointCloud in json: "):
        Deserializer().read(message._replace(data=text))


def test_descriptors_may_come_in_any_order() -> None:
    message = foxglove.message("protobuf", "PointCloud", FOXGLOVE_CLOUD)
    for has_imports_last in (False, True):
        schema = foxglove.descriptors(has_imports_last=has_imports_last)
        channel = Channel("/a", "foxglove.PointCloud", "protobuf", schema, "protobuf", None)
        read = Deserializer().read(message._replace(channel=channel))
        assert read.frame_id == "lidar"


def test_descriptors_that_import_each_other_are_refused() -> None:
    schema = foxglove.circular_descriptors()
    channel = Channel("/a", "foxglove.PointCloud", "protobuf", schema, "protobuf", None)

    assert "cannot be used" in Deserializer().why_not(channel)


@pytest.mark.parametrize("share", [0, 0.3, 0.9])
def test_descriptors_that_are_cut_or_missing_are_refused(share: float) -> None:
    message = foxglove.message("protobuf", "PointCloud", FOXGLOVE_CLOUD)
    schema = message.channel.schema[: int(share * len(message.channel.schema))]
    channel = Channel("/a", "foxglove.PointCloud", "protobuf", schema, "protobuf", None)

    with pytest.raises(MalformedMessageError, match=r"foxglove.PointCloud cannot be used"):
        Deserializer().read(message._replace(channel=channel))
