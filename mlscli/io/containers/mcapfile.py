"""MCAP files of any profile (https://mcap.dev/spec).

A file is a magic, records, and the magic again. Messages lie in chunks, which may be compressed,
or among the other records; index records after a chunk list its messages for each channel. After
the data, a summary may repeat all channels, with the offset and the times of each chunk and the
number of messages of each channel: chunks that it lists are skipped in one step.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import BinaryIO

import mcap.records as mcap
from mcap.opcode import Opcode

from mlscli.errors import InputError
from mlscli.io.containers.chunked import Chunk, ChunkedFile, Contents, Entry, find
from mlscli.io.containers.container import Channel
from mlscli.io.containers.losses import DamagedError
from mlscli.io.containers.mcaprecords import (
    MAGIC,
    MESSAGE_START,
    PRIVATE,
    RECORD,
    RECORD_START,
    Record,
    add_index,
    chunk_at,
    chunk_by_index,
    is_among_records,
    read_as,
    read_content,
    read_record,
    read_summary,
)
from mlscli.io.containers.messagetypes import ros2_name
from mlscli.words import some

_LARGEST_RUN = 1 << 20


class McapFile(ChunkedFile):
    """An MCAP file, whole or broken off, with or without indexes."""

    kind = "MCAP"

    def __init__(self, path: Path, name: Path | None = None) -> None:
        self._schemas: dict[int, mcap.Schema] = {}
        self._recorded: dict[int, mcap.Channel] = {}
        self._defined: dict[int, Channel] = {}
        self._statistics: mcap.Statistics | None = None
        super().__init__(path, name)

    def _definitions(self) -> dict[int, Channel]:
        if len(self._defined) < len(self._recorded):
            self._defined = {n: self._channel(c) for n, c in self._recorded.items()}
        return self._defined

    def _channel(self, record: mcap.Channel) -> Channel:
        schema = self._schemas.get(record.schema_id)
        is_ros = record.message_encoding in ("ros1", "cdr")
        type_ = schema.name if schema else ""
        return Channel(
            topic=record.topic,
            type=ros2_name(type_) if is_ros else type_,
            encoding=record.message_encoding,
            schema=schema.data if schema else b"",
            schema_encoding=schema.encoding if schema and schema.data else "",
            count=None,
        )

    def _load(self, file: BinaryIO, chunk: Chunk) -> bytes:
        if not chunk.bare and not chunk.cut:
            # The summary does not hold the checksum.
            record = read_record(file, chunk.position)
            found = chunk_at(file, record) if record is not None else None
            if found is None or record is None or record.kind != Opcode.CHUNK:
                raise DamagedError("no chunk begins there")
            chunk = found
        return super()._load(file, chunk)

    def _declared_counts(self) -> Mapping[int, int]:
        counts = self._statistics.channel_message_counts if self._statistics is not None else {}
        # A writer may leave them out, which says nothing of the messages.
        if self._statistics is not None and (counts or not self._statistics.message_count):
            return counts
        return super()._declared_counts()

    def _find_chunks(self, file: BinaryIO) -> None:
        file.seek(0)
        head = file.read(len(MAGIC))
        if head != MAGIC:
            found = f"begins with {head!r}" if head else "is empty"
            raise InputError(f"{self.name}: {found}, expected {MAGIC!r}, which begins an MCAP file")
        known = self._read_summary(file)
        at = len(MAGIC)
        last: Chunk | None = None
        previous: Record | None = None
        while True:
            if at in known:
                last = known[at]
                self._chunks.append(last)
                previous, at = None, last.stop
                continue
            record = read_record(file, at)
            if record is None or record.stop > self._size:
                following = self._resume(file, previous, record, at)
                if following is None:
                    self._break_off(file, record, last, at)
                    return
                self._skip(last, previous and previous.at, at, following)
                last, previous, at = None, None, following
            elif record.kind in (Opcode.DATA_END, Opcode.FOOTER):
                self._check_end(file, record.stop)
                return
            else:
                last = self._take(file, record, last)
                previous, at = record, record.stop

    def _take(self, file: BinaryIO, record: Record, last: Chunk | None) -> Chunk | None:
        """Evaluate a record among the data; return the chunk that the next record may belong to."""
        if record.kind == Opcode.CHUNK:
            chunk = chunk_at(file, record)
            if chunk is not None:
                self._chunks.append(chunk)
                return chunk
            self._found.add(f"the chunk at byte {record.at:,} is damaged", size=record.size)
        elif record.kind == Opcode.MESSAGE_INDEX and last is not None and not last.bare:
            if not add_index(last, read_content(file, record)):
                last.counts = None
                return None
            return last
        elif record.kind == Opcode.MESSAGE:
            return self._extend(file, record, last)
        elif record.kind in (Opcode.SCHEMA, Opcode.CHANNEL):
            self._define(record.kind, read_content(file, record))
        elif record.kind == 0 or Opcode.DATA_END < record.kind < PRIVATE:
            self._found.add(
                f"the record at byte {record.at:,} is of kind {record.kind}, which does not exist",
                size=record.size,
            )
        return None

    def _extend(self, file: BinaryIO, record: Record, last: Chunk | None) -> Chunk | None:
        """Add a message outside any chunk to the run of such messages before it, or begin a run.

        A run is read like a chunk. Returns the run.
        """
        file.seek(record.content_at)
        start = file.read(MESSAGE_START.size)
        if len(start) < MESSAGE_START.size or record.size < len(start):
            self._found.add(f"the message at byte {record.at:,} is damaged", size=record.size)
            return None
        number, _, time, _ = MESSAGE_START.unpack(start)
        if last is None or not last.bare or record.stop - last.position > _LARGEST_RUN:
            last = Chunk(record.at, 0, record.at, 0, start=time, end=time, counts={}, bare=True)
            self._chunks.append(last)
        assert last.counts is not None
        last.counts[number] = last.counts.get(number, 0) + 1
        last.start, last.end = min(last.start, time), max(last.end, time)
        last.stop = record.stop
        last.data_size = last.stop - last.position
        return last

    def _resume(
        self, file: BinaryIO, previous: Record | None, record: Record | None, at: int
    ) -> int | None:
        """Return the offset after damage from which records follow again; None where there is none.

        The length of the record before the damage may be wrong, so the search begins within that
        record; or, if a sound header of a chunk is at the damage, within that chunk.
        """
        if at == self._size:
            return None
        start = previous.content_at if previous else at + 1
        before = chunk_at(file, previous) if previous else None
        if before is not None and self._are_its_records(file, before, at):
            start = at + 1
        chunk = chunk_at(file, record) if record is not None else None
        if record is not None and chunk is not None:
            if self._are_its_records(file, chunk, self._size):
                return None
            start = record.content_at
        for place in find(file, RECORD_START, start, self._size):
            if is_among_records(file, place, self._size):
                return place
        return None

    def _are_its_records(self, file: BinaryIO, chunk: Chunk, stop: int) -> bool:
        """Return whether the records of a chunk go on to an offset, or to the end of the file.

        They can be seen in one that is not compressed: messages, and what defines them.
        """
        if chunk.compression:
            return False
        at = chunk.data_at
        while at < stop:
            record = read_record(file, at)
            if record is None:
                return stop == self._size
            if record.kind not in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE):
                return False
            at = record.stop
        return at == stop or stop == self._size

    def _break_off(
        self, file: BinaryIO, record: Record | None, last: Chunk | None, at: int
    ) -> None:
        """Record that the file breaks off; keep what there is of a chunk that its end cuts."""
        whole = sum(not chunk.bare for chunk in self._chunks)
        chunk = (
            chunk_at(file, record) if record is not None and record.kind == Opcode.CHUNK else None
        )
        if last is not None and not last.bare and chunk is None:
            # Its indexes may be missing in part; before a chunk they are whole.
            last.counts = None
        if chunk is not None:
            chunk.data_size, chunk.cut = self._size - chunk.data_at, True
            self._chunks.append(chunk)
        missing = 0 if record is None else record.stop - self._size
        self._found.add(
            f"breaks off at byte {at:,}" + f", after {some(whole, 'chunk')}" * bool(whole),
            size=missing if missing > 0 else self._size - at,
        )

    def _check_end(self, file: BinaryIO, at: int) -> None:
        """Record a loss if the file breaks off after its data, in its summary."""
        file.seek(max(self._size - len(MAGIC), at))
        if file.read() != MAGIC:
            self._found.add("breaks off in its summary, which follows all data")

    def _read_summary(self, file: BinaryIO) -> dict[int, Chunk]:
        """Return the chunks that the summary lists, by position; none where it is not sound."""
        summary = read_summary(file, self._size)
        indexes: list[mcap.ChunkIndex] = []
        at = 0
        while summary is not None and at < len(summary):
            if len(summary) < at + RECORD.size:
                return {}
            kind, size = RECORD.unpack_from(summary, at)
            at += RECORD.size
            content, at = summary[at : at + size], at + size
            if kind in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._define(kind, content)
            elif kind == Opcode.CHUNK_INDEX and (index := read_as(mcap.ChunkIndex, content)):
                indexes.append(index)
            elif kind == Opcode.STATISTICS:
                self._statistics = read_as(mcap.Statistics, content)
        if self._statistics is None or self._statistics.chunk_count != len(indexes):
            return {}
        chunks = {index.chunk_start_offset: chunk_by_index(index) for index in indexes}
        return {at: chunk for at, chunk in chunks.items() if chunk and chunk.stop <= self._size}

    def _define(self, kind: int, content: bytes) -> None:
        """Record a schema or a channel; of several with the same number the first counts."""
        if kind == Opcode.SCHEMA:
            schema = read_as(mcap.Schema, content)
            if schema is not None and schema.id not in self._schemas:
                self._schemas[schema.id] = schema
                self._defined = {}
        else:
            channel = read_as(mcap.Channel, content)
            if channel is not None:
                self._recorded.setdefault(channel.id, channel)

    def _contents(self, data: bytes, *, define: bool = True) -> Contents:
        contents = Contents()
        entries = contents.entries
        at, size = 0, len(data)
        while at < size:
            start = at + RECORD.size
            kind, length = RECORD.unpack_from(data, at) if start <= size else (0, size)
            stop = start + length
            if stop > size or (kind == Opcode.MESSAGE and length < MESSAGE_START.size):
                contents.fault = f"no record is at its byte {at:,}"
                break
            if kind == Opcode.MESSAGE:
                number, _, time, _ = MESSAGE_START.unpack_from(data, start)
                entries.append(Entry(time, number, start + MESSAGE_START.size, stop))
            elif define and kind in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._define(kind, data[start:stop])
            at = contents.end = stop
        return contents
