"""The interface of message containers: ROS 1 bags, ROS 2 bags and MCAP files.

A container knows bytes, topics and times, but not what the messages mean.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Protocol


@dataclass(frozen=True)
class Channel:
    """A stream of messages of one topic, type and serialization.

    Attributes
    ----------
    topic : str
        As recorded.
    type : str
        As ROS 2 writes it (``sensor_msgs/msg/PointCloud2``), also in recordings of ROS 1; names
        of other types as recorded (``foxglove.PointCloud``).
    encoding : str
        The serialization of the messages: ros1, cdr, protobuf, json, or as recorded.
    schema : bytes
        The definition of the message, as recorded; empty where the recording has none.
    schema_encoding : str
        ros1msg, ros2msg, ros2idl, protobuf, jsonschema, or as recorded; empty without schema.
    count : int or None
        Number of messages that the container declares; None where not known before reading.
    """

    topic: str
    type: str
    encoding: str
    schema: bytes
    schema_encoding: str
    count: int | None


class Message(NamedTuple):
    """A message as recorded.

    Attributes
    ----------
    channel : Channel
    log_time : int
        When it was recorded, in nanoseconds.
    data : bytes or memoryview
        The serialized message.
    """

    channel: Channel
    log_time: int
    data: bytes | memoryview


class Container(Protocol):
    """A recording of messages; each pass reads it from the beginning."""

    @property
    def path(self) -> Path:
        """The file or folder."""

    @property
    def kind(self) -> str:
        """The name of its format."""

    @property
    def channels(self) -> Sequence[Channel]:
        """Its channels, sorted by topic, type, encoding and schema."""

    @property
    def time_span(self) -> tuple[int, int] | None:
        """The first and the last log time in nanoseconds; None without messages."""

    @property
    def notes(self) -> Sequence[str]:
        """What the user should know about how it is read."""

    @property
    def losses(self) -> Sequence[str]:
        """What opening it and the last pass could not read: messages, seconds, bytes."""

    def messages(self, topics: Collection[str] | None = None) -> Iterator[Message]:
        """Read the messages of these topics, or of all, in the order of their log times."""
