"""Containers for the tests to break, and what must remain of them.

What lies whole before a cut is told by rosbags' and mcap's own readers of the whole file, never
by the reader that is tested.
"""

from __future__ import annotations

import io
import random
import struct
import tracemalloc
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from mcap.opcode import Opcode
from mcap.reader import NonSeekingReader
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.highlevel import AnyReader
from rosbags.rosbag1 import Reader as Reader1
from rosbags.rosbag1 import Writer as Writer1
from rosbags.typesys import Stores, get_typestore

from mlscli.errors import InputError
from mlscli.io.containers.container import Container
from tests.helpers.bags import write_serialized

STRING = "std_msgs/msg/String"
SECOND = 10**9


class Sent(NamedTuple):
    """A message as it is written, and as it must be read."""

    topic: str
    log_time: int
    data: bytes


def flight(
    count: int = 120, *, size: int = 400, topics: Sequence[str] = ("/a", "/b"), seed: int = 1
) -> list[Sent]:
    """Return messages of the topics in turn, of various sizes, hard to compress, a second apart."""
    rng = random.Random(seed)
    return [
        Sent(
            topics[n % len(topics)],
            (n + 1) * SECOND,
            rng.randbytes(size // 2 + rng.randrange(size)),
        )
        for n in range(count)
    ]


def content(container: Container, topics: Iterable[str] | None = None) -> list[Sent]:
    return [
        Sent(message.channel.topic, message.log_time, bytes(message.data))
        for message in container.messages(None if topics is None else set(topics))
    ]


def by_anyreader(path: Path) -> list[Sent]:
    with AnyReader([path], default_typestore=get_typestore(Stores.LATEST)) as reader:
        return [Sent(c.topic, time, bytes(data)) for c, time, data in reader.messages()]


def write_ros1(
    path: Path, messages: Iterable[Sent], compression: str = "none", threshold: int = 4096
) -> Path:
    writer = Writer1(path)
    if compression != "none":
        writer.set_compression(Writer1.CompressionFormat[compression.upper()])
    writer.chunk_threshold = threshold
    strings = ((topic, STRING, time, data) for topic, time, data in messages)
    write_serialized(writer, get_typestore(Stores.ROS1_NOETIC), strings)
    return path


def write_mcap(
    path: Path,
    messages: Iterable[Sent],
    compression: str = "none",
    *,
    encoding: str = "cdr",
    schema: str = "ros2msg",
    type_: str = STRING,
    definition: bytes = b"string data",
    **options: Any,
) -> Path:
    with path.open("wb") as file:
        writer: Any = McapWriter(
            file,
            **{"chunk_size": 4096, **options},
            compression=CompressionType[compression.upper()],
        )
        writer.start("ros2", "tests")
        number = writer.register_schema(type_, schema, definition) if schema else 0
        channels: dict[str, int] = {}
        for topic, time, data in messages:
            if topic not in channels:
                channels[topic] = writer.register_channel(topic, encoding, number)
            writer.add_message(channels[topic], time, data, time)
        writer.finish()
    return path


def whole_in_ros1(path: Path) -> Callable[[int], list[Sent]]:
    """Return what tells the messages that lie whole before a byte; of a chunk that is not
    compressed, those before the byte, of others all or none."""
    placed: list[tuple[int, Sent]] = []
    raw = path.read_bytes()
    with Reader1(path) as reader:
        connections = {c.id: c for c in reader.connections}
        for position, chunk in reader.chunks.items():
            entries = sorted(
                (entry.offset, entry.time, number)
                for number, index in reader.indexes.items()
                for entry in index
                if entry.chunk_pos == position
            )
            plain = chunk.decompressor(raw[chunk.datapos : chunk.datapos + chunk.datasize])
            ends = [offset for offset, _, _ in entries[1:]] + [len(plain)]
            for (offset, time, number), end in zip(entries, ends, strict=True):
                is_plain = chunk.datasize == len(plain)
                stop = chunk.datapos + (end if is_plain else chunk.datasize)
                message = _last_record(plain, offset, end)
                placed.append((stop, Sent(connections[number].topic, time, message)))
    return lambda size: [message for stop, message in placed if stop <= size]


def _last_record(plain: bytes, offset: int, end: int) -> bytes:
    """Return the data of the first message record from an offset: connections may precede it."""
    while offset < end:
        (length,) = struct.unpack_from("<I", plain, offset)
        is_message = b"op=\2" in plain[offset + 4 : offset + 4 + length]
        start = offset + 8 + length
        (size,) = struct.unpack_from("<I", plain, start - 4)
        if is_message:
            return plain[start : start + size]
        offset = start + size
    raise AssertionError("no message where the index says there is one")


def whole_in_mcap(path: Path) -> Callable[[int], list[Sent]]:
    """Return what tells the messages that mcap's reader yields of a file's first bytes."""

    def messages(size: int) -> list[Sent]:
        found = []
        with path.open("rb") as file:
            stream = io.BytesIO(file.read(size))
            try:
                for _, channel, message in NonSeekingReader(stream).iter_messages(
                    log_time_order=False
                ):
                    found.append(Sent(channel.topic, message.log_time, message.data))
            except Exception:
                return found
        return found

    return messages


def mcap_records(data: bytes | bytearray, kind: Opcode) -> list[tuple[int, int]]:
    """Return where the records of a kind begin at the top of an MCAP file, and where they end."""
    found = []
    at = 8
    while at + 9 <= len(data) - 8:
        opcode, length = struct.unpack_from("<BQ", data, at)
        if opcode == kind:
            found.append((at, at + 9 + length))
        at += 9 + length
    return found


def check_every_cut(
    path: Path,
    folder: Path,
    open_: Callable[[Path], Container],
    whole: Callable[[int], list[Sent]],
    places: int,
) -> None:
    """Cut a file at many places: what lay whole is read, nothing else is, and the loss is told."""
    data = path.read_bytes()
    everything = Counter(content(open_(path)))
    part = folder / path.name
    for place in range(places):
        size = len(data) * place // places
        part.write_bytes(data[:size])
        found, told = read_or_refused(open_, part)
        times = [message.log_time for message in found]
        assert times == sorted(times), f"cut at byte {size}"
        assert not Counter(found) - everything, f"cut at byte {size}"
        assert not Counter(whole(size)) - Counter(found), f"cut at byte {size}"
        assert len(told) == 1, f"cut at byte {size}"
        assert one_line(told[0])


def check_bit_rot(
    path: Path, folder: Path, open_: Callable[[Path], Container], rounds: int
) -> None:
    """Flip bits anywhere: nothing but `InputError` comes of it, and what is missing is told."""
    data = path.read_bytes()
    count = len(content(open_(path)))
    part = folder / path.name
    rng = random.Random(7)
    for turn in range(rounds):
        rotten = bytearray(data)
        for _ in range(rng.choice([1, 1, 1, 4, 30])):
            near = rng.choice([len(data), min(len(data), 5000)])
            at = rng.choice([rng.randrange(near), -1 - rng.randrange(near)])
            rotten[at] ^= 1 << rng.randrange(8)
        part.write_bytes(rotten)
        found, told = read_or_refused(open_, part)
        assert len(found) >= count or told, f"turn {turn}"
        assert all(one_line(line) for line in told), f"turn {turn}"


def read_or_refused(
    open_: Callable[[Path], Container], path: Path
) -> tuple[list[Sent], Sequence[str]]:
    """Return what can be read of a file and what is told of the rest."""
    try:
        container = open_(path)
        return content(container), container.losses
    except InputError as error:
        return [], [str(error)]


def one_line(words: object) -> bool:
    return "\n" not in str(words) and 0 < len(str(words)) < 600


def told(lost: Iterable[Sent]) -> str:
    """Return the words for lost messages by topic."""
    counts = Counter(message.topic for message in lost)
    order = sorted(counts, key=lambda topic: (-counts[topic], topic))
    return ", ".join(f"{counts[topic]} of {topic}" for topic in order)


@contextmanager
def allocating_less_than(size: int) -> Iterator[None]:
    tracemalloc.start()
    try:
        yield
        assert tracemalloc.get_traced_memory()[1] < size
    finally:
        tracemalloc.stop()


def refusal(open_: Callable[[Path], Container], path: Path) -> str:
    with pytest.raises(InputError) as raised:
        content(open_(path))
    assert one_line(raised.value)
    assert str(raised.value).startswith(str(path))
    return str(raised.value)
