"""Messages that are damaged, or made to harm.

How these tests could be cheated: with damage so gross that the first check finds it, or by
letting a wrong message pass for one without points. So messages are cut and flipped at many
places, definitions and members are exchanged one at a time, and what comes out whole is looked
at.
"""

from __future__ import annotations

import copy
import json
import time
import tracemalloc
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from mlscli.io.containers.container import Message
from mlscli.io.messages.decoding import Deserializer, MalformedMessageError
from mlscli.io.messages.registry import MalformedCloudError
from tests.helpers import foxglove
from tests.helpers.decoders import DECODERS
from tests.helpers.ros import ENCODINGS, STORES, random_message, serialized, vector

OF_ROS = [type_ for type_ in DECODERS if "/" in type_]
OF_FOXGLOVE = [type_.partition(".")[2] for type_ in DECODERS if "." in type_]

_POSE = {"position": vector(1, 2, 3), "orientation": vector(0, 0, 0, 1)}
_STAMPED = {"timestamp": {"sec": 1_700_000_000, "nsec": 5}, "frame_id": "lidar", "pose": _POSE}
_TRANSFORM = {
    "timestamp": {"sec": 1_700_000_000, "nsec": 5},
    "parent_frame_id": "a",
    "child_frame_id": "b",
    "translation": vector(1, 2, 3),
    "rotation": vector(0, 0, 0, 1),
}
FOXGLOVE: dict[str, dict[str, Any]] = {
    "PointCloud": {
        **_STAMPED,
        "point_stride": 12,
        "fields": [{"name": name, "offset": 4 * at, "type": 7} for at, name in enumerate("xyz")],
        "data": bytes(range(24)),
    },
    "LaserScan": {**_STAMPED, "start_angle": 0.5, "end_angle": 1.5, "ranges": [1.0, 2.0]},
    "PoseInFrame": _STAMPED,
    "FrameTransform": _TRANSFORM,
    "FrameTransforms": {"transforms": [_TRANSFORM, _TRANSFORM]},
}


def read_whole(deserializer: Deserializer, message: Message) -> str:
    """Decode a message; return what is wrong with it, if that is told as it should be."""
    try:
        made = DECODERS[message.channel.type](deserializer.read(message))
    except (MalformedMessageError, MalformedCloudError) as error:
        assert str(error)  # noqa: PT017
        assert "\n" not in str(error)  # noqa: PT017
        assert len(str(error)) < 600  # noqa: PT017
        return str(error)
    for part in made:
        arrays = [part.points] if hasattr(part, "points") else list(part[:3])
        assert all(array.dtype == np.float64 for array in arrays)
        assert [a.shape[1:] for a in arrays] in ([(3,)], [(), (3,), (4,)])
        assert all(isinstance(name, str) for name in _frames(part))
        assert not hasattr(part, "points") or len(part.points) == sum(map(len, part.split()))
    return ""


def _frames(part: Any) -> list[Any]:
    return [part.frame_id] if hasattr(part, "points") else [part.parent, part.child]


def samples(type_: str) -> list[Message]:
    """Return messages of a type in every serialization that it has."""
    if type_.startswith("foxglove."):
        name = type_.partition(".")[2]
        return [foxglove.message(kind, name, FOXGLOVE[name]) for kind in ("protobuf", "json")]
    rng = np.random.default_rng(5)
    return [
        serialized(encoding, type_, random_message(STORES[encoding], type_, rng))
        for encoding in ENCODINGS
        # Some of these random messages have sequences that are not empty.
        for _ in range(3)
    ]


@pytest.mark.parametrize("type_", DECODERS)
def test_a_message_cut_anywhere_is_told_as_malformed(type_: str) -> None:
    deserializer = Deserializer()
    for message in samples(type_):
        lengths = np.unique(np.linspace(0, len(message.data) - 1, 150).astype(int)).tolist()
        faults = [
            read_whole(deserializer, message._replace(data=message.data[:length]))
            for length in lengths
        ]
        # In protobuf a message can end behind any field; CDR may lack what fills it up.
        if message.channel.encoding in ("ros1", "json"):
            assert all(faults)
        assert sum(map(bool, faults)) > len(faults) // 2


@pytest.mark.parametrize("type_", DECODERS)
def test_a_message_with_flipped_bits_is_read_or_told_as_malformed(type_: str) -> None:
    deserializer, rng = Deserializer(), np.random.default_rng(7)
    for message in samples(type_):
        for _ in range(150):
            data = bytearray(message.data)
            for place in rng.integers(0, len(data), 3):
                data[place] ^= 1 << rng.integers(0, 8)
            read_whole(deserializer, message._replace(data=bytes(data)))


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("type_", OF_ROS)
def test_lengths_beyond_the_data_take_neither_memory_nor_time(encoding: str, type_: str) -> None:
    message = serialized(encoding, type_, {})
    deserializer = Deserializer()
    read_whole(deserializer, message)
    padded = bytes(message.data) + bytes(64)
    tracemalloc.start()
    begin = time.perf_counter()
    for place in range(4 if encoding == "cdr" else 0, len(padded) - 4):
        data = padded[:place] + b"\xff\xff\xff\x7f" + padded[place + 4 :]
        read_whole(deserializer, message._replace(data=data))
    seconds = time.perf_counter() - begin
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()

    assert peak < 2**22
    assert seconds < 20


WRONG_MEMBERS: list[Any] = [
    None, True, -1, 0, 1.5, 10**30, 10**400, float("nan"), float("inf"), "", "text", "7" * 5000,
    [], [1], [[1, 2], [3, 4]], [None], ["a"], {}, {"x": 1}, [{}],
]  # fmt: skip


def exchanged(content: Any, value: Any) -> Iterator[Any]:
    """Return copies of the content with one member exchanged, for each member."""
    members = content.items() if isinstance(content, dict) else enumerate(content)
    for key, member in list(members):
        changed = copy.copy(content)
        changed[key] = value
        yield changed
        if isinstance(member, dict | list):
            for inner in exchanged(member, value):
                yield copy.copy(content) | {key: inner} if isinstance(content, dict) else [inner]


@pytest.mark.parametrize("name", OF_FOXGLOVE)
def test_json_with_any_member_of_another_kind_is_read_or_told_as_malformed(name: str) -> None:
    deserializer = Deserializer()
    message = foxglove.message("json", name, FOXGLOVE[name])
    begin = time.perf_counter()
    faults = []
    for value in WRONG_MEMBERS:
        for content in exchanged(json.loads(bytes(message.data)), value):
            data = json.dumps(content).encode()
            faults.append(read_whole(deserializer, message._replace(data=data)))

    assert sum(map(bool, faults)) > len(faults) // 3
    assert time.perf_counter() - begin < 20


OTHER_KINDS = ["string", "float64[]", "int64", "string[]", "bool"]


@pytest.mark.parametrize(
    "type_",
    [
        "sensor_msgs/msg/PointCloud2",
        "sensor_msgs/msg/PointCloud",
        "sensor_msgs/msg/LaserScan",
        "visualization_msgs/msg/MarkerArray",
        "geometry_msgs/msg/PoseArray",
        "nav_msgs/msg/Odometry",
        "nav_msgs/msg/Path",
        "tf2_msgs/msg/TFMessage",
    ],
)
@pytest.mark.parametrize("encoding", ENCODINGS)
def test_a_definition_with_any_field_of_another_type_is_read_or_told_as_malformed(
    encoding: str, type_: str
) -> None:
    whole = serialized(encoding, type_, {})
    lines = whole.channel.schema.decode().split("\n")
    rng, deserializer = np.random.default_rng(11), Deserializer()
    faults = []
    file = ""
    for place, line in enumerate(lines):
        kind, _, name = line.partition(" ")
        file = name if kind == "MSG:" else file
        # Times are built in; of another kind they are refused with the definition.
        if not name or "=" in line or kind == "MSG:" or file.startswith("builtin_interfaces"):
            continue
        kinds = [other for other in OTHER_KINDS if other != kind]
        wrong = kinds[place % len(kinds)]
        text = "\n".join([*lines[:place], f"{wrong} {name}", *lines[place + 1 :]])
        store = get_typestore(Stores.EMPTY)
        store.register(get_types_from_msg(text, type_))
        sent: Any = random_message(store, type_, rng)
        serialize = store.serialize_ros1 if encoding == "ros1" else store.serialize_cdr
        channel = type(whole.channel)(**{**vars(whole.channel), "schema": text.encode()})
        message = Message(channel, 0, bytes(serialize(sent, type_)))
        faults.append(read_whole(deserializer, message))

    assert any(faults)
