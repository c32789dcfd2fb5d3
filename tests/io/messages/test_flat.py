"""Messages that hold points one by one.

How these tests could be cheated: with messages whose gaps happen to be empty, with sequences
that are never empty, or by reading what the same code wrote. So values, lengths and strings are
random, and rosbags writes and reads the same bytes.
"""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from mlscli.io.messages.flat import FlatReader
from tests.helpers.ros import ENCODINGS, STORES, random_message, serialized

POINT_BY_POINT = [
    "sensor_msgs/msg/PointCloud",
    "geometry_msgs/msg/PoseArray",
    "visualization_msgs/msg/Marker",
    "visualization_msgs/msg/MarkerArray",
]
OTHERS = [
    "sensor_msgs/msg/PointCloud2",
    "sensor_msgs/msg/LaserScan",
    "nav_msgs/msg/Odometry",
    "nav_msgs/msg/Path",
    "tf2_msgs/msg/TFMessage",
]


def plain(value: Any) -> Any:
    """Return nested lists of the values of a message, its structures as lists too."""
    if hasattr(value, "__dict__"):
        # rosbags lists constants among the fields, in capitals, and the type.
        names = [name for name in vars(value) if name.islower() and name != "__msgtype__"]
        return [plain(getattr(value, name)) for name in names]
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(member) for member in value]
    return value


def reader(encoding: str, type_: str) -> FlatReader:
    return FlatReader(type_, STORES[encoding].fielddefs, is_cdr=encoding == "cdr")


@pytest.mark.parametrize("is_big_endian", [False, True])
@pytest.mark.parametrize("type_", POINT_BY_POINT + OTHERS)
@pytest.mark.parametrize("encoding", ENCODINGS)
def test_a_message_holds_what_was_written(encoding: str, type_: str, is_big_endian: bool) -> None:
    rng = np.random.default_rng(1)
    for _ in range(30):
        sent = random_message(STORES[encoding], type_, rng)
        data = bytes(serialized(encoding, type_, sent, is_big_endian=is_big_endian).data)
        assert plain(reader(encoding, type_).read(data)) == plain(sent)


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_points_are_arrays_with_their_fields(encoding: str) -> None:
    points = [{"x": 1.5, "y": -2, "z": 3}, {"x": 4, "y": 5, "z": 6}]
    data = bytes(serialized(encoding, "sensor_msgs/msg/PointCloud", {"points": points}).data)

    read = reader(encoding, "sensor_msgs/msg/PointCloud").read(data).points

    assert read["x"].tolist() == [1.5, 4]
    assert read["y"].dtype == np.float32
    assert read["z"].tolist() == [3, 6]


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_a_message_that_is_too_short_or_too_long_is_refused(encoding: str) -> None:
    sent = random_message(
        STORES[encoding], "visualization_msgs/msg/MarkerArray", np.random.default_rng(2)
    )
    data = bytes(serialized(encoding, "visualization_msgs/msg/MarkerArray", sent).data)
    read = reader(encoding, "visualization_msgs/msg/MarkerArray").read

    for length in range(len(data)):
        with pytest.raises((ValueError, struct.error)):
            read(data[:length])
    with pytest.raises(ValueError, match="expected"):
        read(data + bytes(4))


def test_a_middleware_of_ros_2_may_fill_up_the_last_four_bytes() -> None:
    type_ = "geometry_msgs/msg/PoseArray"
    sent = random_message(STORES["cdr"], type_, np.random.default_rng(3))
    data = bytes(serialized("cdr", type_, sent).data)

    assert plain(reader("cdr", type_).read(data + bytes(3))) == plain(sent)
    with pytest.raises(ValueError, match="expected"):
        reader("ros1", type_).read(bytes(serialized("ros1", type_, {}).data) + bytes(1))


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize(
    ("fields", "alike"),
    [
        ("uint8 a\nfloat64 b\n", {"ros1": True, "cdr": False}),
        ("float64 b\nuint8 a\n", {"ros1": True, "cdr": False}),
        ("uint16 a\nuint16 b\n", {"ros1": True, "cdr": True}),
        ("string a\nuint16 b\n", {"ros1": False, "cdr": False}),
        ("uint16 b\nuint8[3] a\n", {"ros1": False, "cdr": False}),
    ],
)
def test_structures_of_different_sizes_have_gaps_in_cdr(
    encoding: str, fields: str, alike: dict[str, bool]
) -> None:
    store, type_ = get_typestore(Stores.EMPTY), "a_msgs/msg/A"
    store.register(get_types_from_msg("string name\nB[] some\nB[2] two\n", type_))
    store.register(get_types_from_msg(fields, "a_msgs/msg/B"))
    serialize = store.serialize_ros1 if encoding == "ros1" else store.serialize_cdr
    flat = FlatReader(type_, store.fielddefs, is_cdr=encoding == "cdr")
    rng = np.random.default_rng(4)

    for _ in range(30):
        sent: Any = random_message(store, type_, rng)
        read = flat.read(bytes(serialize(sent, type_)))
        assert plain(read) == plain(sent)
        assert isinstance(read.two, np.ndarray) == alike[encoding]
