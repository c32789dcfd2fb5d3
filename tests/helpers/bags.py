"""Writes recordings for the tests to read back."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from mlscli.runtime.arrays import Float64
from tests.helpers.ros import STORES, build

POINT_CLOUD_2 = "sensor_msgs/msg/PointCloud2"
POINT_CLOUD = "sensor_msgs/msg/PointCloud"


@dataclass(frozen=True, eq=False)
class Sent:
    """A cloud to be written as one message.

    `changes` are fields of a PointCloud2 that contradict the points.
    """

    points: Float64
    nanoseconds: int = 0
    labels: Sequence[int] | None = None
    frame_id: str = "map"
    changes: Mapping[str, Any] = field(default_factory=dict)


def write_bag(
    path: Path,
    messages: Sequence[Sent],
    kind: str = "ros1",
    *,
    message_type: str = POINT_CLOUD_2,
    dtype: str = "<f8",
    topics: Sequence[str] = ("/cloud",),
    label_name: str = "keyframe",
) -> Path:
    """Write the messages to each of the topics; kinds are ros1, ros2 and mcap."""
    is_ros1 = kind == "ros1"
    store = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.LATEST)
    writer: Any
    if is_ros1:
        writer = Writer1(path)
    else:
        plugin = StoragePlugin.SQLITE3 if kind == "ros2" else StoragePlugin.MCAP
        writer = Writer2(path, version=9, storage_plugin=plugin)
    with writer:
        for topic in topics:
            connection = writer.add_connection(topic, message_type, typestore=store)
            for number, message in enumerate(messages):
                content = _message(store, message, message_type, dtype, label_name)
                serialize = store.serialize_ros1 if is_ros1 else store.serialize_cdr
                # The log's clock is not the header's: nothing may mistake one for the other.
                writer.write(connection, 5_000 + number, serialize(content, message_type))
    return path


def _message(
    store: Typestore, sent: Sent, message_type: str, dtype: str, label_name: str
) -> object:
    types: Any = store.types
    seconds, nanoseconds = divmod(sent.nanoseconds, 10**9)
    stamp = types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=nanoseconds)
    header_fields = store.fielddefs["std_msgs/msg/Header"][1]
    sequence = {"seq": 0} if any(name == "seq" for name, _ in header_fields) else {}
    header = types["std_msgs/msg/Header"](**sequence, stamp=stamp, frame_id=sent.frame_id)
    if message_type == POINT_CLOUD:
        return _point_cloud(types, header, sent, label_name)
    return _point_cloud_2(types, header, sent, np.dtype(dtype), label_name)


def _point_cloud(types: Any, header: object, sent: Sent, label_name: str) -> object:
    point, channel = types["geometry_msgs/msg/Point32"], types["sensor_msgs/msg/ChannelFloat32"]
    labels = [] if sent.labels is None else [np.array(sent.labels, dtype=np.float32)]
    return types[POINT_CLOUD](
        header=header,
        points=[point(x=x, y=y, z=z) for x, y, z in sent.points.tolist()],
        channels=[channel(name=label_name, values=values) for values in labels],
    )


def _point_cloud_2(
    types: Any, header: object, sent: Sent, dtype: np.dtype[Any], label_name: str
) -> object:
    named = types["sensor_msgs/msg/PointField"]
    number = {4: 7, 8: 8}[dtype.itemsize]
    step = 3 * dtype.itemsize + 4
    fields = [
        named(name=name, offset=axis * dtype.itemsize, datatype=number, count=1)
        for axis, name in enumerate("xyz")
    ]
    if sent.labels is not None:
        fields.append(named(name=label_name, offset=step - 4, datatype=6, count=1))
    labels = sent.labels if sent.labels is not None else [0] * len(sent.points)
    layout = f"{dtype.byteorder}3{dtype.char}I".replace("=", "<")
    data = b"".join(
        struct.pack(layout, *point, label)
        for point, label in zip(sent.points.tolist(), labels, strict=True)
    )
    content = {
        "header": header,
        "height": 1,
        "width": len(sent.points),
        "fields": fields,
        "is_bigendian": dtype.byteorder == ">",
        "point_step": step,
        "row_step": step * len(sent.points),
        "data": np.frombuffer(data, dtype=np.uint8),
        "is_dense": False,
    }
    return types[POINT_CLOUD_2](**content | dict(sent.changes))


class Told(NamedTuple):
    """A message to be written: its content as `tests.helpers.ros.build` takes it."""

    topic: str
    type: str
    content: dict[str, Any]
    log_time: int = 0


def write_told(
    path: Path, messages: Iterable[Told], kind: str = "ros1", compression: str = ""
) -> Path:
    """Write messages of any type; kinds are ros1, which may be compressed, ros2 and mcap."""
    is_ros1 = kind == "ros1"
    store = STORES["ros1" if is_ros1 else "cdr"]
    plugin = StoragePlugin.SQLITE3 if kind == "ros2" else StoragePlugin.MCAP
    writer: Any = Writer1(path) if is_ros1 else Writer2(path, version=9, storage_plugin=plugin)
    if compression:
        writer.set_compression(Writer1.CompressionFormat[compression.upper()])
    serialize = store.serialize_ros1 if is_ros1 else store.serialize_cdr
    serialized = (
        (topic, type_, log_time, serialize(build(store, type_, content), type_))
        for topic, type_, content, log_time in messages
    )
    write_serialized(writer, store, serialized)
    return path


def write_serialized(
    writer: Any, store: Typestore, messages: Iterable[tuple[str, str, int, bytes | memoryview]]
) -> None:
    """Write topics, types, times and data with a writer of rosbags, and close it."""
    connections: dict[tuple[str, str], Any] = {}
    with writer:
        for topic, type_, log_time, data in messages:
            key = topic, type_
            if key not in connections:
                connections[key] = writer.add_connection(topic, type_, typestore=store)
            writer.write(connections[key], log_time, data)
