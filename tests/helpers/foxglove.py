"""Foxglove's messages for the tests to read: in protobuf, in json and as messages of ROS.

Numbers and types of the fields are those of Foxglove's published schemas.
"""

from __future__ import annotations

import base64
import json
from typing import Any

from google.protobuf import (
    descriptor_pb2,
    descriptor_pool,
    json_format,
    message_factory,
    timestamp_pb2,
)

from mlscli.io.containers.container import Channel, Message
from tests.helpers.ros import serialized

SPELLINGS = ["protobuf", "json", "ros1", "cdr"]

_STAMP = "timestamp google.protobuf.Timestamp"
_DEFINITIONS = {
    "Vector3": ["x double", "y double", "z double"],
    "Quaternion": ["x double", "y double", "z double", "w double"],
    "Pose": ["position foxglove.Vector3", "orientation foxglove.Quaternion"],
    "PackedElementField": ["name string", "offset fixed32", "type int32"],
    "PointCloud": [
        _STAMP,
        "frame_id string",
        "pose foxglove.Pose",
        "point_stride fixed32",
        "fields *foxglove.PackedElementField",
        "data bytes",
    ],
    "LaserScan": [
        _STAMP,
        "frame_id string",
        "pose foxglove.Pose",
        "start_angle double",
        "end_angle double",
        "ranges *double",
        "intensities *double",
    ],
    "PoseInFrame": [_STAMP, "frame_id string", "pose foxglove.Pose"],
    "FrameTransform": [
        _STAMP,
        "parent_frame_id string",
        "child_frame_id string",
        "translation foxglove.Vector3",
        "rotation foxglove.Quaternion",
    ],
    "FrameTransforms": ["transforms *foxglove.FrameTransform"],
}


def message(spelling: str, name: str, content: dict[str, Any]) -> Message:
    """Return a message; content is as json has it, but for data in bytes."""
    if spelling == "protobuf":
        return _protobuf(name, content)
    if spelling == "json":
        text = json.dumps(content, default=lambda data: base64.b64encode(data).decode())
        channel = Channel("/topic", f"foxglove.{name}", "json", b"{}", "jsonschema", None)
        return Message(channel, 0, text.encode())
    return serialized(spelling, f"foxglove_msgs/msg/{name}", _of_ros(content))


def descriptors(*, has_imports_last: bool = False) -> bytes:
    """Return the set of descriptors, a file for each message, imported files first or last."""
    files = [_file(name, fields) for name, fields in _DEFINITIONS.items()]
    stamp = descriptor_pb2.FileDescriptorProto()
    timestamp_pb2.DESCRIPTOR.CopyToProto(stamp)
    files.insert(0, stamp)
    ordered = files[::-1] if has_imports_last else files
    return descriptor_pb2.FileDescriptorSet(file=ordered).SerializeToString()


def circular_descriptors() -> bytes:
    """Return two files that import each other."""
    files = [
        descriptor_pb2.FileDescriptorProto(name=one, package="foxglove", dependency=[other])
        for one, other in [("a.proto", "b.proto"), ("b.proto", "a.proto")]
    ]
    return descriptor_pb2.FileDescriptorSet(file=files).SerializeToString()


def _file(name: str, fields: list[str]) -> descriptor_pb2.FileDescriptorProto:
    kinds = descriptor_pb2.FieldDescriptorProto
    type_ = descriptor_pb2.DescriptorProto(name=name)
    imports = set()
    for number, text in enumerate(fields, start=1):
        field, kind = text.split()
        label = kinds.LABEL_REPEATED if kind[0] == "*" else kinds.LABEL_OPTIONAL
        made = type_.field.add(name=field, number=number, label=label)
        kind = kind.lstrip("*")
        if "." in kind:
            made.type, made.type_name = kinds.TYPE_MESSAGE, f".{kind}"
            path = kind.replace(".", "/")
            imports.add(path.lower() if kind.startswith("google") else path)
        else:
            made.type = kinds.Type.Value(f"TYPE_{kind.upper()}")
    return descriptor_pb2.FileDescriptorProto(
        name=f"foxglove/{name}.proto",
        package="foxglove",
        dependency=[f"{path}.proto" for path in sorted(imports)],
        message_type=[type_],
        syntax="proto3",
    )


def _protobuf(name: str, content: dict[str, Any]) -> Message:
    schema = descriptors()
    pool = descriptor_pool.DescriptorPool()
    for file in descriptor_pb2.FileDescriptorSet.FromString(schema).file:
        pool.Add(file)
    type_ = message_factory.GetMessageClass(pool.FindMessageTypeByName(f"foxglove.{name}"))
    made = json_format.ParseDict(_of_protobuf(content), type_())
    channel = Channel("/topic", f"foxglove.{name}", "protobuf", schema, "protobuf", None)
    return Message(channel, 0, made.SerializeToString())


def _of_protobuf(content: Any) -> Any:
    """Return the content as protobuf's own json has it: times as text, bytes in base64."""
    if isinstance(content, dict) and "nsec" in content:
        return timestamp_pb2.Timestamp(seconds=content["sec"], nanos=content["nsec"]).ToJsonString()
    if isinstance(content, dict):
        return {name: _of_protobuf(value) for name, value in content.items()}
    if isinstance(content, list):
        return [_of_protobuf(value) for value in content]
    return base64.b64encode(content).decode() if isinstance(content, bytes) else content


def _of_ros(content: Any) -> Any:
    if isinstance(content, dict):
        names = {"nsec": "nanosec"}
        return {names.get(name, name): _of_ros(value) for name, value in content.items()}
    if isinstance(content, bytes):
        return list(content)
    return [_of_ros(value) for value in content] if isinstance(content, list) else content
