"""Deserialize messages: from bytes to an object with the fields of the message.

The channel states the serialization and the definition: ros1 and cdr with definitions of ROS,
protobuf with its descriptors, or json, which needs none.
"""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, Protocol

from rosbags.interfaces import Nodetype

from mlscli.errors import one_line
from mlscli.io.containers.container import Channel, Message
from mlscli.io.messages.definitions import typestore_of
from mlscli.io.messages.flat import FlatReader
from mlscli.io.messages.parts import seconds

_HEADER, _TIME = "std_msgs/msg/Header", "builtin_interfaces/msg/Time"


class MalformedMessageError(ValueError):
    """The bytes of a message do not fit its definition; one line states what is wrong."""

    def __init__(self, words: str) -> None:
        super().__init__(one_line(words))


class Deserializer:
    """Reads the messages of any number of channels, each by its own definition."""

    def __init__(self) -> None:
        self._codecs: dict[tuple[str, str, str, bytes], _Codec] = {}

    def read(self, message: Message) -> Any:
        """Return an object whose attributes are the fields of the message.

        In ROS messages, sequences of numbers are arrays (N,); sequences of structures of numbers,
        such as points or poses, are structured arrays (N,).

        Raises
        ------
        MalformedMessageError
            The bytes do not fit the definition, or the definition cannot be used.
        """
        codec = self._codec(message.channel)
        try:
            return codec.read(message.data)
        except MalformedMessageError:
            raise
        except Exception as error:  # The libraries fail in many ways on damaged messages.
            raise MalformedMessageError(
                f"is no {message.channel.type} in {message.channel.encoding}: {_reason(error)}"
            ) from error

    def stamp(self, message: Message) -> float:
        """Return the stamp that the message begins with, in seconds; NaN where it has none.

        A message of ROS is not deserialized for this.
        """
        return self._head(message)[0]

    def frame(self, message: Message) -> str:
        """Return the frame that follows the stamp; empty where there is none."""
        return self._head(message)[1]

    def why_not(self, channel: Channel) -> str:
        """Say why messages of a channel cannot be read; empty where they can."""
        codec = self._codec(channel)
        return codec.reason if isinstance(codec, _Unreadable) else ""

    def _head(self, message: Message) -> tuple[float, str]:
        try:
            return self._codec(message.channel).head(message.data)
        except Exception:  # What is wrong with the message is reported when it is read.
            return math.nan, ""

    def _codec(self, channel: Channel) -> _Codec:
        key = (channel.type, channel.encoding, channel.schema_encoding, channel.schema)
        if key not in self._codecs:
            self._codecs[key] = _codec_of(channel)
        return self._codecs[key]


def _reason(error: Exception) -> str:
    """Return the error of a library as one line."""
    return one_line(error) or f"it is damaged ({type(error).__name__})"


class _Codec(Protocol):
    def read(self, data: bytes | memoryview) -> Any:
        """Return a message as an object."""

    def head(self, data: bytes | memoryview) -> tuple[float, str]:
        """Return the stamp (s) and the frame that a message begins with."""


class _Ros:
    """Messages of ROS 1, or of ROS 2 in CDR."""

    def __init__(self, channel: Channel) -> None:
        definitions = typestore_of(channel).fielddefs
        self._is_cdr = channel.encoding == "cdr"
        self.read = FlatReader(channel.type, definitions, is_cdr=self._is_cdr).read
        fields = definitions[channel.type][1]
        if fields and fields[0][1] == (Nodetype.NAME, _HEADER):
            fields = definitions[_HEADER][1]
        has_sequence_number = bool(fields) and fields[0][1] == (Nodetype.BASE, ("uint32", 0))
        opening = [desc for _, desc in fields[has_sequence_number:][:2]]
        self._has_time = opening[:1] == [(Nodetype.NAME, _TIME)]
        self._has_frame = self._has_time and opening[1:] == [(Nodetype.BASE, ("string", 0))]
        # In CDR four bytes that hold the byte order come first.
        self._time_at = 4 * (self._is_cdr + has_sequence_number)

    def head(self, data: bytes | memoryview) -> tuple[float, str]:
        if not self._has_time:
            return math.nan, ""
        order = ">" if self._is_cdr and not data[1] & 1 else "<"
        time = struct.unpack_from(order + ("iI" if self._is_cdr else "II"), data, self._time_at)
        stamp = seconds(SimpleNamespace(sec=time[0], nanosec=time[1]))
        if not self._has_frame:
            return stamp, ""
        begin = self._time_at + 8 + 4
        (length,) = struct.unpack_from(order + "I", data, begin - 4)
        return stamp, bytes(data[begin : begin + length]).rstrip(b"\0").decode(errors="replace")


class _Named:
    """Messages whose fields have names: protobuf and json."""

    def __init__(self, read: Callable[[bytes], Any]) -> None:
        self._read = read

    def read(self, data: bytes | memoryview) -> Any:
        return self._read(bytes(data))

    def head(self, data: bytes | memoryview) -> tuple[float, str]:
        message = self.read(data)
        stamp = seconds(message.timestamp) if hasattr(message, "timestamp") else math.nan
        frame = getattr(message, "frame_id", "")
        return stamp, frame if isinstance(frame, str) else ""


class _Unreadable:
    """Messages whose serialization or definition is not known."""

    def __init__(self, reason: str) -> None:
        self.reason = reason

    def read(self, data: bytes | memoryview) -> Any:  # noqa: ARG002
        raise MalformedMessageError(self.reason)

    def head(self, data: bytes | memoryview) -> tuple[float, str]:  # noqa: ARG002
        return math.nan, ""


def _codec_of(channel: Channel) -> _Codec:
    try:
        if channel.encoding in ("ros1", "cdr"):
            return _Ros(channel)
        if channel.encoding == "protobuf":
            from mlscli.io.messages.protobuf import reader

            return _Named(reader(channel))
    except Exception as error:  # Parsers fail in many ways on damaged definitions.
        return _Unreadable(f"the definition of {channel.type} cannot be used: {_reason(error)}")
    if channel.encoding == "json":
        return _Named(lambda data: json.loads(data, object_hook=_as_object))
    return _Unreadable(
        f"is serialized in {channel.encoding!r}, which cannot be read; can be read: ros1, cdr, "
        "protobuf, json"
    )


def _as_object(members: dict[str, Any]) -> SimpleNamespace:
    return SimpleNamespace(**members)
