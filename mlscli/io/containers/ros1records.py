"""The records of ROS 1 bags (http://wiki.ros.org/Bags/Format/2.0), read without trust in lengths.

A record is a length, a header, a length and data. The header is a list of fields `name=value`, of
which `op` is the kind of the record.
"""

from __future__ import annotations

import re
import struct
from typing import BinaryIO, NamedTuple

import numpy as np

from mlscli.io.containers.chunked import Chunk
from mlscli.io.ros import NANOSECONDS

MESSAGE, BAG, INDEX, CHUNK, CHUNK_INFO, CONNECTION = b"\2", b"\3", b"\4", b"\5", b"\6", b"\7"
U32 = struct.Struct("<I")
CHUNK_START = re.compile(rb"[\x28\x29]\0\0\0[\4\x0f\x10\x09]\0\0\0(?:op=|compression=|size=)")
"""The beginning of a chunk: a header of 40 or 41 bytes, of the fields op, compression and size."""

_LONGEST_HEADER = 1 << 20


class Record(NamedTuple):
    """A record at the top level of a bag; its data may reach beyond the end of the file.

    Attributes
    ----------
    position : int
        Offset of the record in the file, in bytes.
    op : bytes
        Its kind: `BAG`, `INDEX`, `CHUNK`, `CHUNK_INFO` or `CONNECTION`.
    fields : dict of bytes to bytes
        The fields of its header, by name.
    data_at, stop : int
        Offsets in the file where its data begins and ends, in bytes.
    """

    position: int
    op: bytes
    fields: dict[bytes, bytes]
    data_at: int
    stop: int

    def chunk(self) -> Chunk:
        """Return the chunk of a record of the kind `CHUNK`."""
        return Chunk(
            self.position,
            self.stop,
            self.data_at,
            self.stop - self.data_at,
            self.fields[b"compression"].decode(errors="replace"),
            U32.unpack(self.fields[b"size"])[0],
        )


_NEEDED = {
    BAG: (),
    INDEX: (b"conn", b"count"),
    CHUNK: (b"compression", b"size"),
    CHUNK_INFO: (),
    CONNECTION: (b"conn", b"topic"),
}
"""The kinds of record at the top level of a bag, and the fields they must have."""


def read_record(file: BinaryIO, at: int, size: int) -> Record | None:
    """Read the record at an offset in a file of `size` bytes; None where no record is there."""
    file.seek(at)
    head = file.read(4)
    if len(head) < 4:
        return None
    (length,) = U32.unpack(head)
    if length > min(_LONGEST_HEADER, size - at - 8):
        return None
    header = file.read(length + 4)
    if len(header) < length + 4:
        return None
    fields = read_fields(header[:length])
    if fields is None:
        return None
    op = fields.get(b"op", b"")
    if op not in _NEEDED or any(name not in fields for name in _NEEDED[op]):
        return None
    if any(len(fields[name]) != 4 for name in (b"conn", b"count", b"size") if name in fields):
        return None
    data_at = at + 8 + length
    return Record(at, op, fields, data_at, data_at + U32.unpack_from(header, length)[0])


def read_fields(header: bytes) -> dict[bytes, bytes] | None:
    """Return the fields of a header by name; None where it is malformed."""
    fields = {}
    at, size = 0, len(header)
    while at < size:
        if at + 4 > size:
            return None
        start = at + 4
        at = start + U32.unpack_from(header, at)[0]
        name, separator, value = header[start:at].partition(b"=")
        if not separator or at > size:
            return None
        fields[name] = value
    return fields


def read_data(file: BinaryIO, record: Record) -> bytes:
    """Read the data of a record that lies within the file."""
    file.seek(record.data_at)
    return file.read(record.stop - record.data_at)


def add_index(chunk: Chunk, data: bytes, fields: dict[bytes, bytes]) -> Chunk | None:
    """Add the messages that an index record lists to the counts and the times of its chunk.

    Parameters
    ----------
    chunk : Chunk
    data : bytes
        The index, version 1. An entry holds the seconds, the nanoseconds and the offset in the
        chunk of a message, in four bytes each.
    fields : dict of bytes to bytes
        The header of the index.

    Returns
    -------
    Chunk or None
        None where the index is not sound; the chunk has then no counts and must be read instead.
    """
    (count,) = U32.unpack(fields[b"count"])
    if len(data) != 12 * count:
        chunk.counts = None
        return None
    if count == 0:
        return chunk
    times = np.frombuffer(data, dtype="<u4").reshape(-1, 3)[:, :2].astype(np.int64)
    nanoseconds = times[:, 0] * NANOSECONDS + times[:, 1]
    start, end = int(nanoseconds.min()), int(nanoseconds.max())
    if chunk.counts is None:
        chunk.counts, chunk.start, chunk.end = {}, start, end
    (number,) = U32.unpack(fields[b"conn"])
    chunk.counts[number] = chunk.counts.get(number, 0) + count
    chunk.start, chunk.end = min(chunk.start, start), max(chunk.end, end)
    return chunk
