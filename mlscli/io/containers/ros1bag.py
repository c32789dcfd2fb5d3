"""ROS 1 bags, format 2.0 (http://wiki.ros.org/Bags/Format/2.0).

A bag is a line that names the version, followed by records: a bag header, then chunks. A chunk
holds messages, and the connections that these are the first to use; after it comes an index of its
messages for each connection. When the recording is closed, all connections and the times of all
chunks are appended.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import BinaryIO

from mlscli.errors import InputError
from mlscli.io.containers.chunked import Chunk, ChunkedFile, Contents, Entry, find
from mlscli.io.containers.container import Channel
from mlscli.io.containers.messagetypes import ros2_name
from mlscli.io.containers.ros1records import (
    BAG,
    CHUNK,
    CHUNK_INFO,
    CHUNK_START,
    CONNECTION,
    INDEX,
    MESSAGE,
    U32,
    Record,
    add_index,
    read_data,
    read_fields,
    read_record,
)
from mlscli.io.ros import NANOSECONDS
from mlscli.words import some

MAGIC = b"#ROSBAG V2.0\n"

_U64 = struct.Struct("<Q")
_TIME = struct.Struct("<II")


class Ros1Bag(ChunkedFile):
    """A ROS 1 bag, indexed or not."""

    kind = "ROS 1 bag"

    def __init__(self, path: Path, name: Path | None = None) -> None:
        self._connections: dict[int, Channel] = {}
        self._declared: dict[bytes, bytes] = {}
        super().__init__(path, name)

    def _definitions(self) -> dict[int, Channel]:
        return self._connections

    def _find_chunks(self, file: BinaryIO) -> None:
        self._check_version(file)
        at = len(MAGIC)
        listed = {CONNECTION: 0, CHUNK_INFO: 0}
        last: Chunk | None = None
        previous: Record | None = None
        while at < self._size:
            record = read_record(file, at, self._size)
            if record is None or record.stop > self._size:
                following = self._next_chunk(file, previous, record, at)
                if following is None:
                    self._break_off(record, last, at)
                    return
                self._skip(last, previous and previous.position, at, following)
                last, previous, at = None, None, following
                continue
            if record.op == CHUNK:
                last = record.chunk()
                self._chunks.append(last)
            elif record.op == INDEX:
                last = last and add_index(last, read_data(file, record), record.fields)
            elif record.op == CONNECTION:
                listed[CONNECTION] += 1
                self._define(record.fields, read_data(file, record))
            elif record.op == BAG:
                self._declared = record.fields
                self._refuse_encrypted()
            elif record.op == CHUNK_INFO:
                listed[CHUNK_INFO] += 1
            if record.op not in (CHUNK, INDEX):
                last = None
            previous, at = record, record.stop
        self._check_end(listed)

    def _check_version(self, file: BinaryIO) -> None:
        file.seek(0)
        head = file.read(len(MAGIC))
        if head != MAGIC:
            found = repr(head.split(b"\n")[0].decode(errors="replace")) if head else "nothing"
            raise InputError(
                f"{self.name}: begins with {found}, expected '#ROSBAG V2.0'; "
                "the tools of ROS 1 convert older bags"
            )

    def _refuse_encrypted(self) -> None:
        encryptor = self._declared.get(b"encryptor", b"").decode(errors="replace")
        if encryptor:
            raise InputError(
                f"{self.name}: is encrypted by {encryptor[:100]}, expected a bag that is not; "
                "`rosbag decrypt` makes one"
            )

    def _next_chunk(
        self, file: BinaryIO, previous: Record | None, record: Record | None, at: int
    ) -> int | None:
        """Return the offset of the next chunk after damage; None where there is none.

        The length of the record before may be wrong, so the search begins within that record; or,
        if the header of a chunk is at `at`, within that chunk.
        """
        start = previous.data_at if previous else at + 1
        if record is not None and record.op == CHUNK:
            start = record.data_at
        for place in find(file, CHUNK_START, start, self._size):
            found = read_record(file, place, self._size)
            if found is not None and found.op == CHUNK:
                return place
        return None

    def _break_off(self, record: Record | None, last: Chunk | None, at: int) -> None:
        """Record that the file breaks off; keep what there is of a chunk that its end cuts."""
        if last is not None and (record is None or record.op != CHUNK):
            # Its index may be missing in part; before a chunk it is whole.
            last.counts = None
        whole = len(self._chunks)
        kind, stop = "record", self._size
        if record is not None:
            stop = record.stop
            if record.op == CHUNK:
                chunk = record.chunk()
                chunk.data_size, chunk.cut = self._size - chunk.data_at, True
                self._chunks.append(chunk)
                kind = "chunk"
        declared = self._number(U32, b"chunk_count")
        self._found.add(
            f"breaks off in the {kind} at byte {at:,}, after "
            + (f"{whole:,} of {some(declared, 'chunk')}" if declared else some(whole, "chunk")),
            size=max(stop, self._number(_U64, b"index_pos")) - self._size,
        )

    def _check_end(self, listed: dict[bytes, int]) -> None:
        """Compare what the bag lists at its end with what its header declares."""
        index = self._number(_U64, b"index_pos")
        chunks, connections = (self._number(U32, n) for n in (b"chunk_count", b"conn_count"))
        if index and (listed[CHUNK_INFO], listed[CONNECTION]) == (chunks, connections):
            return
        if self._chunks and not listed[CONNECTION]:
            # Its index may be missing in part.
            self._chunks[-1].counts = None
        if not self._declared:
            self._found.add("has no bag header")
        elif not index:
            self._found.add("was not closed: what the recorder had not yet written is missing")
        else:
            self._found.add(
                f"lists {listed[CHUNK_INFO]:,} chunks and {listed[CONNECTION]:,} connections at "
                f"its end, declared {chunks:,} and {connections:,}",
                size=max(index - self._size, 0),
            )

    def _number(self, layout: struct.Struct, name: bytes) -> int:
        """Return a number of the bag header; 0 where it has none."""
        value = self._declared.get(name, b"")
        return int(layout.unpack(value)[0]) if len(value) == layout.size else 0

    def _define(self, header: dict[bytes, bytes], data: bytes) -> None:
        fields = read_fields(data)
        number = header.get(b"conn", b"")
        if fields is None or len(number) != 4 or b"topic" not in header:
            return
        channel = Channel(
            topic=header[b"topic"].decode(errors="replace"),
            type=ros2_name(fields.get(b"type", b"").decode(errors="replace")),
            encoding="ros1",
            schema=fields.get(b"message_definition", b""),
            schema_encoding="ros1msg" if fields.get(b"message_definition") else "",
            count=None,
        )
        self._connections.setdefault(U32.unpack(number)[0], channel)

    def _contents(self, data: bytes, *, define: bool = True) -> Contents:
        contents = Contents()
        at, size = 0, len(data)
        unpack = U32.unpack_from
        while at < size:
            start = stop = 0
            if at + 4 <= size:
                start = at + 8 + unpack(data, at)[0]
            if 0 < start <= size:
                stop = start + unpack(data, start - 4)[0]
            fields = read_fields(data[at + 4 : start - 4]) if 0 < stop <= size else None
            if fields is None:
                contents.fault = f"no record is at its byte {at:,}"
                break
            op = fields.get(b"op")
            if op == MESSAGE:
                number, time = fields.get(b"conn", b""), fields.get(b"time", b"")
                if len(number) == 4 and len(time) == 8:
                    seconds, nanoseconds = _TIME.unpack(time)
                    contents.entries.append(
                        Entry(seconds * NANOSECONDS + nanoseconds, unpack(number)[0], start, stop)
                    )
            elif define and op == CONNECTION:
                self._define(fields, data[start:stop])
            at = contents.end = stop
        return contents
