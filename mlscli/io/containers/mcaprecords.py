"""The records of MCAP files (https://mcap.dev/spec), read without trust in their lengths.

A record is a kind, a length and content. Definitions and the records of the summary are parsed by
the classes of the package mcap.
"""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Callable
from io import BytesIO
from typing import Any, BinaryIO, NamedTuple

import mcap.records as mcap
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode

from mlscli.io.containers.chunked import Chunk

MAGIC = b"\x89MCAP0\r\n"
PRIVATE = 128
"""Kinds of record from this number on are private, not defined by the format."""

RECORD = struct.Struct("<BQ")
MESSAGE_START = struct.Struct("<HIQQ")
RECORD_START = re.compile(rb"[\3-\7\x09\x0c\x0f][\s\S]{4}\0{4}")
"""The beginning of a record of less than 4 GiB, of a kind that occurs among the data."""

_CHUNK_TIMES = struct.Struct("<QQQII")
_U64 = struct.Struct("<Q")
_INDEX_START = struct.Struct("<HI")
_INDEX_ENTRY = 16
_FOOTER_SIZE = RECORD.size + 20 + len(MAGIC)


class Record(NamedTuple):
    """The head of a record; its content may reach beyond the end of the file.

    Attributes
    ----------
    at : int
        Offset of the record in the file, in bytes.
    kind : int
        Its opcode.
    size : int
        Stated size of its content, in bytes.
    """

    at: int
    kind: int
    size: int

    @property
    def content_at(self) -> int:
        """Offset in the file of its content, in bytes."""
        return self.at + RECORD.size

    @property
    def stop(self) -> int:
        """Offset in the file of what follows it, in bytes."""
        return self.content_at + self.size


def read_record(file: BinaryIO, at: int) -> Record | None:
    """Read the head of the record at an offset; None where the file ends within it."""
    file.seek(at)
    head = file.read(RECORD.size)
    return Record(at, *RECORD.unpack(head)) if len(head) == RECORD.size else None


def read_content(file: BinaryIO, record: Record) -> bytes:
    """Read the content of a record that lies within the file."""
    file.seek(record.content_at)
    return file.read(record.size)


def read_as(kind: Any, content: bytes) -> Any:
    """Parse the content of a record with a class of `mcap.records`; None where it is damaged."""
    read: Callable[[ReadDataStream], Any] = kind.read
    try:
        return read(ReadDataStream(BytesIO(content)))
    except (McapError, struct.error, UnicodeDecodeError):
        return None


def chunk_at(file: BinaryIO, record: Record) -> Chunk | None:
    """Read the header of a chunk; None where its lengths contradict each other."""
    file.seek(record.content_at)
    head = file.read(_CHUNK_TIMES.size + 16 + _U64.size)
    if len(head) < _CHUNK_TIMES.size:
        return None
    start, end, size, crc, name = _CHUNK_TIMES.unpack_from(head)
    content = _CHUNK_TIMES.size + name + _U64.size
    if name > 16 or len(head) < content:
        return None
    (data_size,) = _U64.unpack_from(head, content - _U64.size)
    if content + data_size != record.size:
        return None
    compression = head[_CHUNK_TIMES.size : content - _U64.size].decode(errors="replace")
    data_at = record.content_at + content
    return Chunk(record.at, record.stop, data_at, data_size, compression, size, crc, start, end)


def chunk_by_index(index: mcap.ChunkIndex) -> Chunk | None:
    """Return the chunk that an index in the summary describes; None where it contradicts itself."""
    stop = index.chunk_start_offset + index.chunk_length
    offsets = sorted((at, number) for number, at in index.message_index_offsets.items())
    # They must lie behind the chunk: otherwise the walk along the file might never end.
    if not offsets or index.chunk_length <= 0 or offsets[0][0] < stop:
        return None
    # The index records of a chunk follow one another, so their lengths give their entries.
    ends = [at for at, _ in offsets[1:]] + [stop + index.message_index_length]
    counts = {}
    for (at, number), end in zip(offsets, ends, strict=True):
        count, rest = divmod(end - at - RECORD.size - _INDEX_START.size, _INDEX_ENTRY)
        if rest or count < 0:
            return None
        counts[number] = count
    return Chunk(
        index.chunk_start_offset,
        stop + index.message_index_length,
        stop - index.compressed_size,
        index.compressed_size,
        start=index.message_start_time,
        end=index.message_end_time,
        counts=counts,
    )


def add_index(chunk: Chunk, content: bytes) -> bool:
    """Add the number of messages that an index record lists to the counts of its chunk.

    Returns whether the record is sound; if not, the counts stay as they are.
    """
    if len(content) < _INDEX_START.size:
        return False
    number, size = _INDEX_START.unpack_from(content)
    count, rest = divmod(size, _INDEX_ENTRY)
    if rest or size != len(content) - _INDEX_START.size:
        return False
    chunk.counts = chunk.counts or {}
    if count:
        chunk.counts[number] = chunk.counts.get(number, 0) + count
    return True


def read_summary(file: BinaryIO, size: int) -> bytes | None:
    """Return the summary section of a file of `size` bytes; None where there is no sound one."""
    if size < _FOOTER_SIZE:
        return None
    file.seek(size - _FOOTER_SIZE)
    end = file.read(_FOOTER_SIZE)
    if not end.endswith(MAGIC) or RECORD.unpack_from(end) != (Opcode.FOOTER, 20):
        return None
    footer = mcap.Footer.read(ReadDataStream(BytesIO(end[RECORD.size :])))
    if not 0 < footer.summary_start < size - _FOOTER_SIZE:
        return None
    file.seek(footer.summary_start)
    summary = file.read(size - _FOOTER_SIZE - footer.summary_start)
    checked = zlib.crc32(end[: RECORD.size + 16], zlib.crc32(summary))
    return None if footer.summary_crc not in (0, checked) else summary


def is_among_records(file: BinaryIO, at: int, size: int) -> bool:
    """Return whether records follow one another from an offset in a file of `size` bytes.

    Four sound records in a row are enough, or fewer where a chunk, the end of the data or the end
    of the file comes first.
    """
    for _ in range(4):
        record = read_record(file, at)
        if (
            record is None
            or record.stop > size
            or not Opcode.HEADER < record.kind <= Opcode.DATA_END
        ):
            return False
        if record.kind == Opcode.CHUNK:
            return chunk_at(file, record) is not None
        if record.kind == Opcode.MESSAGE and record.size < MESSAGE_START.size:
            return False
        if record.kind == Opcode.DATA_END:
            return record.size == 4
        at = record.stop
        if at == size:
            break
    return True
