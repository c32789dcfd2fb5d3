"""Write MCAP files of states that resemble the ones before them.

In the usual layout a chunk holds about a megabyte of whatever comes, and compression sees nothing
before it. Here each topic has chunks of its own, large enough for several states, and zstandard
looks for repetitions over all of a chunk: of a state, only what has changed costs anything, though
every message is whole. Chunks of topics overlap in time, as the format allows
(https://mcap.dev/spec). A reader holds a chunk of each topic at once, and jumps more slowly.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import mcap.records as mcap
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.well_known import MessageEncoding, Profile, SchemaEncoding
from rosbags.typesys.store import Typestore

MAGIC = b"\x89MCAP0\r\n"

CHUNK_BYTES = 96 * 2**20
"""A chunk is closed before it exceeds this, unless one message does."""

# Chunks that are smaller are closed before a large one: what is little and comes first, as
# transforms do, stands first in the file.
_SMALL_BYTES = 2**20

# 128 MiB, the largest window that decoders take without being asked to.
_WINDOW_LOG = 27
_LEVEL = 3

# The header of a message record: opcode, length, and the fields before the data.
_MESSAGE_BYTES = 1 + 8 + 2 + 4 + 8 + 8


@dataclass
class _Chunk:
    """The messages of a topic that are not written yet, as records."""

    records: RecordBuilder = field(default_factory=RecordBuilder)
    places: list[tuple[int, int]] = field(default_factory=list)


class StateWriter:
    """An MCAP file being written, in the profile of ROS 2, with chunks of one topic each.

    It has no summary until it is closed without an error.

    Parameters
    ----------
    path : Path
        The file, which is created.
    store : Typestore
        Knows the definitions of the messages' types.

    Raises
    ------
    OSError
        Where the file exists or cannot be written; so do all methods.
    """

    def __init__(self, path: Path, store: Typestore) -> None:
        self._store = store
        self._file = path.open("xb")
        self._schemas: dict[str, mcap.Schema] = {}
        self._channels: list[mcap.Channel] = []
        self._chunks: dict[int, _Chunk] = {}
        self._counts: dict[int, int] = {}
        self._indexes: list[mcap.ChunkIndex] = []
        self._compressor = zstandard.ZstdCompressor(
            compression_params=zstandard.ZstdCompressionParameters.from_level(
                _LEVEL, window_log=_WINDOW_LOG, enable_ldm=True, write_checksum=True
            )
        )

    def __enter__(self) -> StateWriter:
        self._file.write(MAGIC)
        self._put(mcap.Header(profile=Profile.ROS2, library="mls"))
        return self

    def __exit__(self, error: object, *_: object) -> None:
        try:
            if error is None:
                self._finish()
        finally:
            self._file.close()

    def add_topic(self, topic: str, type_: str, metadata: Mapping[str, str]) -> int:
        """Return the number of a new topic, by which `write` knows it.

        Parameters
        ----------
        topic : str
        type_ : str
            Message type, as ``sensor_msgs/msg/PointCloud2``.
        metadata : mapping of str to str
            Of the channel.
        """
        if type_ not in self._schemas:
            definition, _ = self._store.generate_msgdef(type_, ros_version=2)
            self._schemas[type_] = mcap.Schema(
                id=len(self._schemas) + 1,
                name=type_,
                encoding=SchemaEncoding.ROS2,
                data=definition.encode(),
            )
        number = len(self._channels) + 1
        channel = mcap.Channel(
            id=number,
            topic=topic,
            message_encoding=MessageEncoding.CDR,
            schema_id=self._schemas[type_].id,
            metadata=dict(metadata),
        )
        self._channels.append(channel)
        self._chunks[number], self._counts[number] = _Chunk(), 0
        # Outside of chunks, before them all: readers without an index need them first.
        self._put(self._schemas[type_], channel)
        return number

    def write(self, topic: int, stamp: int, data: bytes) -> None:
        """Write a message in CDR, at a stamp in nanoseconds."""
        records = self._chunks[topic].records
        if records.count and records.count + _MESSAGE_BYTES + len(data) > CHUNK_BYTES:
            for other, waiting in self._chunks.items():
                if waiting.records.count < _SMALL_BYTES:
                    self._close_chunk(other)
            self._close_chunk(topic)
        chunk = self._chunks[topic]
        chunk.places.append((stamp, chunk.records.count))
        mcap.Message(
            channel_id=topic,
            log_time=stamp,
            data=data,
            publish_time=stamp,
            sequence=self._counts[topic],
        ).write(chunk.records)
        self._counts[topic] += 1

    def _close_chunk(self, topic: int) -> None:
        """Write the chunk of a topic, if it holds anything, and begin another."""
        chunk, self._chunks[topic] = self._chunks[topic], _Chunk()
        if not chunk.places:
            return
        stamps = [stamp for stamp, _ in chunk.places]
        records = _taken(chunk.records)
        data = self._compressor.compress(records)
        start = self._file.tell()
        self._put(
            mcap.Chunk(
                compression="zstd",
                data=data,
                message_start_time=min(stamps),
                message_end_time=max(stamps),
                # Not given: zstandard has a checksum of its own.
                uncompressed_crc=0,
                uncompressed_size=len(records),
            )
        )
        end = self._file.tell()
        self._put(mcap.MessageIndex(channel_id=topic, records=chunk.places))
        self._indexes.append(
            mcap.ChunkIndex(
                chunk_start_offset=start,
                chunk_length=end - start,
                compression="zstd",
                compressed_size=len(data),
                uncompressed_size=len(records),
                message_start_time=min(stamps),
                message_end_time=max(stamps),
                message_index_offsets={topic: end},
                message_index_length=self._file.tell() - end,
            )
        )

    def _finish(self) -> None:
        """Write the chunks that are left, the summary and the footer."""
        for topic in self._chunks:
            self._close_chunk(topic)
        self._put(mcap.DataEnd(data_section_crc=0))
        start = self._file.tell()
        summary = RecordBuilder()
        groups: list[tuple[Opcode, list[Any]]] = [
            (Opcode.SCHEMA, list(self._schemas.values())),
            (Opcode.CHANNEL, self._channels),
            (Opcode.STATISTICS, [self._statistics()]),
            (Opcode.CHUNK_INDEX, self._indexes),
        ]
        offsets = []
        for opcode, records in groups:
            begin = summary.count
            for record in records:
                record.write(summary)
            offsets.append(
                mcap.SummaryOffset(
                    group_opcode=opcode,
                    group_start=start + begin,
                    group_length=summary.count - begin,
                )
            )
        offsets_start = start + summary.count
        for offset in offsets:
            offset.write(summary)
        written = _taken(summary)
        footer = _bytes(mcap.Footer(start, offsets_start, summary_crc=0))
        # The checksum is of all before it, the beginning of the footer included.
        crc = zlib.crc32(footer[:-4], zlib.crc32(written))
        self._file.write(written)
        self._put(mcap.Footer(start, offsets_start, summary_crc=crc))
        self._file.write(MAGIC)

    def _statistics(self) -> mcap.Statistics:
        return mcap.Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=len(self._indexes),
            message_count=sum(self._counts.values()),
            message_start_time=min((i.message_start_time for i in self._indexes), default=0),
            message_end_time=max((i.message_end_time for i in self._indexes), default=0),
            metadata_count=0,
            schema_count=len(self._schemas),
        )

    def _put(self, *records: mcap.McapRecord) -> None:
        """Write records to the file."""
        self._file.write(_bytes(*records))


def _bytes(*records: mcap.McapRecord) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return _taken(builder)


def _taken(builder: RecordBuilder) -> bytes:
    """Return what was built, and leave nothing."""
    built: bytes = builder.end()  # type: ignore[no-untyped-call]
    return built
