"""ROS 1 and ROS 2 bags, message by message."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path

from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection, MessageDefinitionFormat
from rosbags.typesys import Stores, get_typestore

from mlscli.errors import InputError, UsageError
from mlscli.io.base import Cloud, Topic, Wanted, everything
from mlscli.io.container import Channel, Message
from mlscli.io.decoding import Deserializer, reason
from mlscli.io.messages import CLOUD_TYPES, Part

_NANOSECONDS = 10**9


class RosBag:
    """A ROS 1 or ROS 2 bag; its clouds are read anew at each pass and never held together.

    Parameters
    ----------
    path : Path
    kind : str
        What messages to the user call the format.
    suffix : str
        The file name's ending that belongs to the content; empty for a folder.
    topic : str, optional
        The topic of the clouds; not needed where there is only one.

    Raises
    ------
    InputError
        The bag cannot be opened.
    """

    notes: Sequence[str] = ()

    def __init__(self, path: Path, kind: str, suffix: str, topic: str | None = None) -> None:
        self.path = path
        self.kind = kind
        self.losses: list[str] = []
        self._suffix = suffix
        self._asked = topic
        self._split: set[str] = set()
        with self._open() as reader:
            self._topics = self._describe(reader)
            holds_messages = reader.message_count > 0
            self._span = (
                (reader.start_time / _NANOSECONDS, (reader.end_time - 1) / _NANOSECONDS)
                if holds_messages
                else (math.nan, math.nan)
            )

    @property
    def label(self) -> str:
        """The path and the topic."""
        return f"{self.path}: {self._topic.name}"

    @property
    def frame_id(self) -> str:
        """The frame of the first cloud; empty where none is stated."""
        return self._topic.frame

    @property
    def expected_keyframes(self) -> int | None:
        """The messages of the topic; None where they hold several keyframes each."""
        return None if self._topic.name in self._split else self._topic.count

    def topics(self) -> Sequence[Topic]:
        """Describe all topics of the bag, by name."""
        return self._topics

    def time_span(self) -> tuple[float, float]:
        """Return when the first and the last message were recorded, in seconds."""
        return self._span

    def clouds(self, wanted: Wanted = everything) -> Iterator[Cloud]:
        """Read the clouds of the topic in the order of their recording.

        Messages that cannot be read are left out and told in `losses` when the pass ends.
        """
        self.losses = []
        came = lost = 0
        broken_off = first_fault = ""
        deserializer = Deserializer()
        with self._open() as reader:
            messages = reader.messages(_connections(reader, self._topic.name, self._topic.type))
            while True:
                # A damaged bag can fail in any way the storage and compression libraries know.
                try:
                    message = _message(reader, *next(messages))
                except StopIteration:
                    break
                except Exception as error:
                    broken_off = f" before it breaks off: {reason(error)}"
                    break
                came += 1
                stamp = deserializer.stamp(message)
                if not (math.isnan(stamp) or wanted(stamp)):
                    continue
                try:
                    parts = _decode(deserializer, message)
                except Exception as error:
                    lost += 1
                    first_fault = first_fault or f"the first at {stamp:.9f}: {reason(error)}"
                    continue
                for part in parts:
                    for points in part.split():
                        yield Cloud(points, part.stamp, frame_id=part.frame_id)
        declared = self._topic.count
        if broken_off or came < declared:
            self.losses.append(
                f"{self.label}: yields {came} of {declared} messages declared{broken_off}"
            )
        if lost:
            self.losses.append(
                f"{self.label}: {lost} of {came} messages cannot be read, {first_fault}"
            )

    @cached_property
    def _topic(self) -> Topic:
        """The topic of the clouds: the one asked for, or the only one."""
        if self._asked is not None:
            return self._named(self._asked)
        mappable = [topic for topic in self._topics if topic.mappable]
        if not mappable:
            raise InputError(
                f"{self.path}: holds no clouds, found {_listed(self._topics)}; can be mapped: "
                f"{', '.join(CLOUD_TYPES)}"
            )
        if len(mappable) > 1:
            raise UsageError(
                f"{self.path}: holds {len(mappable)} topics with clouds, of which --topic picks "
                f"one: {_listed(mappable)}"
            )
        return mappable[0]

    def _named(self, name: str) -> Topic:
        named = [topic for topic in self._topics if topic.name.strip("/") == name.strip("/")]
        if not named:
            raise UsageError(
                f"{self.path}: --topic {name}: no such topic, found {_listed(self._topics)}"
            )
        topic = next((topic for topic in named if topic.mappable), named[0])
        if not topic.mappable:
            raise UsageError(f"{self.path}: --topic {name}: {topic.why_not}")
        return topic

    def _describe(self, reader: AnyReader) -> list[Topic]:
        """Describe all topics; of those with clouds, the first message tells the frame."""
        counts: dict[tuple[str, str], int] = {}
        for connection in reader.connections:
            key = (connection.topic, connection.msgtype)
            counts[key] = counts.get(key, 0) + connection.msgcount
        topics = []
        for (name, type_), count in sorted(counts.items()):
            why_not, frame = "", ""
            if type_ not in CLOUD_TYPES:
                why_not = f"{type_} cannot be mapped; can be mapped: {', '.join(CLOUD_TYPES)}"
            elif count == 0:
                why_not = "it holds no messages"
            else:
                frame = self._first_frame(reader, name, type_)
            topics.append(Topic(name, type_, count, not why_not, why_not, frame))
        return topics

    def _first_frame(self, reader: AnyReader, name: str, type_: str) -> str:
        try:
            first = next(reader.messages(_connections(reader, name, type_)))
            parts = _decode(Deserializer(), _message(reader, *first))
        except Exception:  # What is wrong with the message is told when it is read.
            return ""
        if len(parts) != 1 or parts[0].keyframes is not None:
            self._split.add(name)
        return parts[0].frame_id if parts else ""

    @contextmanager
    def _open(self) -> Iterator[AnyReader]:
        """Open the bag under a name whose ending fits its content, which rosbags goes by."""
        if self._suffix == ".mcap" and (profile := _mcap_profile(self.path)) != "ros2":
            raise InputError(
                f"{self.path}: is an MCAP file of profile {profile!r}, which cannot be read; "
                "can be read: profile 'ros2'"
            )
        with tempfile.TemporaryDirectory(prefix="mls-") as folder:
            link = Path(folder) / f"bag{self._suffix}"
            link.symlink_to(self.path.resolve(), target_is_directory=self.path.is_dir())
            try:
                # Bags of early ROS 2 do not define their messages; clouds never changed.
                reader = AnyReader([link], default_typestore=get_typestore(Stores.LATEST))
                reader.open()
            except Exception as error:
                why = reason(error).replace(str(link), str(self.path))
                raise InputError(f"{self.path}: cannot be read as a {self.kind}: {why}") from error
            try:
                yield reader
            finally:
                reader.close()


def _connections(reader: AnyReader, topic: str, type_: str) -> list[Connection]:
    return [c for c in reader.connections if (c.topic, c.msgtype) == (topic, type_)]


def _message(reader: AnyReader, connection: Connection, time: int, data: bytes) -> Message:
    encoding, dialect = ("cdr", "ros2msg") if reader.is2 else ("ros1", "ros1msg")
    schema_encoding = {
        MessageDefinitionFormat.NONE: "",
        MessageDefinitionFormat.MSG: dialect,
        MessageDefinitionFormat.IDL: "ros2idl",
    }[connection.msgdef.format]
    channel = Channel(
        connection.topic,
        connection.msgtype,
        encoding,
        connection.msgdef.data.encode(),
        schema_encoding,
        connection.msgcount,
    )
    return Message(channel, time, data)


def _decode(deserializer: Deserializer, message: Message) -> list[Part]:
    return CLOUD_TYPES[message.channel.type](deserializer.read(message))


def _mcap_profile(path: Path) -> str:
    """Return the profile that the header of an MCAP file states."""
    with path.open("rb") as file:
        # Magic (8), the header's opcode (1) and length (8), the profile's length (4).
        head = file.read(21)
        length = int.from_bytes(head[17:21], "little")
        return file.read(min(length, 64)).decode(errors="replace")


def _listed(topics: Sequence[Topic]) -> str:
    return ", ".join(f"{t.name} ({t.type} x {t.count})" for t in topics) or "no topics"
