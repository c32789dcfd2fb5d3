"""Messages of ROS for the tests to read, as rosbags serializes them."""

from __future__ import annotations

from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from mlscli.io.containers.container import Channel, Message

ENCODINGS = ["ros1", "cdr"]
_TRANSFORMS = "geometry_msgs/TransformStamped[] transforms"
_FOXGLOVE = {
    "PackedElementField": "string name\nuint32 offset\nuint8 type",
    "PointCloud": "TIME timestamp\nstring frame_id\ngeometry_msgs/Pose pose\n"
    "uint32 point_stride\nfoxglove_msgs/PackedElementField[] fields\nuint8[] data",
    "LaserScan": "TIME timestamp\nstring frame_id\ngeometry_msgs/Pose pose\n"
    "float64 start_angle\nfloat64 end_angle\nfloat64[] ranges\nfloat64[] intensities",
    "PoseInFrame": "TIME timestamp\nstring frame_id\ngeometry_msgs/Pose pose",
    "FrameTransform": "TIME timestamp\nstring parent_frame_id\nstring child_frame_id\n"
    "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation",
    "FrameTransforms": "foxglove_msgs/FrameTransform[] transforms",
}


def store_of(encoding: str) -> Typestore:
    """Return the types of ROS 1 or ROS 2, with those beside them that can be mapped."""
    store = get_typestore(Stores.ROS1_NOETIC if encoding == "ros1" else Stores.LATEST)
    beside = {"tf/msg/tfMessage": _TRANSFORMS, "tf2_msgs/msg/TFMessage": _TRANSFORMS}
    time = "time" if encoding == "ros1" else "builtin_interfaces/Time"
    for name, text in _FOXGLOVE.items():
        beside[f"foxglove_msgs/msg/{name}"] = text.replace("TIME", time)
    for type_, text in beside.items():
        store.register(get_types_from_msg(text, type_))
    return store


STORES = {encoding: store_of(encoding) for encoding in ENCODINGS}


def build(store: Typestore, type_: str, content: Any) -> Any:
    """Return a message; fields that the content leaves out are zero or empty."""
    values = {
        name: _value(store, desc, content.get(name)) for name, desc in store.fielddefs[type_][1]
    }
    return store.types[type_](**values)


def serialized(
    encoding: str,
    type_: str,
    content: Any,
    *,
    is_big_endian: bool = False,
    has_schema: bool = True,
) -> Message:
    """Return a message of the content, with its definition or without."""
    store = STORES[encoding]
    message: Any = build(store, type_, content) if isinstance(content, dict) else content
    if encoding == "ros1":
        data = store.serialize_ros1(message, type_)
    else:
        data = store.serialize_cdr(message, type_, little_endian=not is_big_endian)
    channel = Channel("/topic", type_, encoding, b"", "", None)
    if has_schema:
        version = 1 if encoding == "ros1" else 2
        schema = store.generate_msgdef(type_, ros_version=version)[0].encode()
        channel = Channel("/topic", type_, encoding, schema, f"ros{version}msg", None)
    return Message(channel, 0, bytes(data))


def header(seconds: int = 0, nanoseconds: int = 0, frame_id: str = "map") -> dict[str, Any]:
    """Return the content of a header."""
    return {"stamp": {"sec": seconds, "nanosec": nanoseconds}, "frame_id": frame_id}


def vector(*values: float) -> dict[str, float]:
    """Return the content of a point, a vector or a quaternion."""
    return dict(zip("xyzw", values, strict=False))


def random_message(store: Typestore, type_: str, rng: np.random.Generator) -> Any:
    """Return a message with random values and sequences of random length."""
    return store.types[type_](
        **{name: _random(store, desc, rng) for name, desc in store.fielddefs[type_][1]}
    )


def _value(store: Typestore, desc: Any, content: Any) -> Any:
    kind, inner = desc
    if kind == Nodetype.NAME:
        return build(store, inner, content or {})
    if kind == Nodetype.BASE:
        zero: Any = "" if inner[0] == "string" else np.dtype(_dtype(inner[0])).type(0).item()
        return zero if content is None else content
    element, count = inner
    if element[0] == Nodetype.BASE and element[1][0] != "string":
        given = [0] * (count if kind == Nodetype.ARRAY else 0) if content is None else content
        return np.array(given, dtype=_dtype(element[1][0]))
    return [_value(store, element, each) for each in content or ()]


def _random(store: Typestore, desc: Any, rng: np.random.Generator) -> Any:
    kind, inner = desc
    if kind == Nodetype.NAME:
        return random_message(store, inner, rng)
    if kind == Nodetype.BASE:
        if inner[0] == "string":
            return "".join(rng.choice(list("abcdeé/ "), int(rng.integers(0, 9))))
        return _numbers(inner[0], 1, rng)[0].item()
    element, count = inner
    count = count if kind == Nodetype.ARRAY else int(rng.integers(0, 4))
    if element[0] == Nodetype.BASE and element[1][0] != "string":
        return _numbers(element[1][0], count, rng)
    return [_random(store, element, rng) for _ in range(count)]


def _numbers(name: str, count: int, rng: np.random.Generator) -> Any:
    dtype = np.dtype(_dtype(name))
    if dtype.kind == "b":
        return rng.integers(0, 2, count).astype(bool)
    if dtype.kind == "f":
        return rng.normal(size=count).astype(dtype)
    limits = np.iinfo(dtype)
    return rng.integers(limits.min, limits.max, count, dtype=dtype, endpoint=True)


def _dtype(name: str) -> str:
    return {"bool": "bool", "byte": "int8", "char": "uint8"}.get(name, name)
