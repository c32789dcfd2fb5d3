"""What ROS 1 bags and MCAP files share: messages in chunks that are located before they are read.

Opening walks from record to record and skips the content of the chunks: the index of a chunk says
how many messages of each channel it holds, and of what times. A chunk without an index, as at the
end of a recording that breaks off, is read once at opening instead. A pass then reads the chunks
that hold wanted messages, in the order of their times. Damaged parts are left out and reported; a
chunk cut by the end of the file is read as far as it goes.
"""

from __future__ import annotations

import re
import zlib
from abc import abstractmethod
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import BinaryIO, NamedTuple

from mlscli.io.containers.compression import decompress, decompress_start, plain
from mlscli.io.containers.container import Channel, Message
from mlscli.io.containers.losses import DamagedError, Losses
from mlscli.io.containers.messagefile import MessageFile, declared
from mlscli.io.containers.streams import in_time_order

_WINDOW = 1 << 20
_OVERLAP = 64


@dataclass
class Chunk:
    """A run of records in a file, among them messages.

    Attributes
    ----------
    position, stop : int
        Offsets in the file, in bytes: of its beginning, and of what follows it.
    data_at, data_size : int
        Offset in the file and size of its content as stored, in bytes.
    compression : str
        The compression of its content, as `decompress` names it.
    size : int
        Size of its decompressed content, in bytes.
    crc : int
        CRC-32 of its decompressed content; 0 without a checksum.
    start, end : int
        The first and the last log time in nanoseconds, once `counts` is known.
    counts : dict of int to int, or None
        Number of messages by channel number; None where not known.
    cut : bool
        Whether the file ends within it; that loss is already reported.
    bare : bool
        Whether its records lie in the file itself, outside any chunk.
    """

    position: int
    stop: int
    data_at: int
    data_size: int
    compression: str = ""
    size: int = 0
    crc: int = 0
    start: int = 0
    end: int = 0
    counts: dict[int, int] | None = None
    cut: bool = False
    bare: bool = False


class Entry(NamedTuple):
    """A message in the content of a chunk.

    Attributes
    ----------
    log_time : int
        Nanoseconds.
    channel : int
        Number of its channel.
    start, stop : int
        Offsets in the decompressed content where its data begins and ends, in bytes.
    """

    log_time: int
    channel: int
    start: int
    stop: int


@dataclass
class Contents:
    """The messages of a chunk.

    Attributes
    ----------
    entries : list of Entry
        In the order of the chunk.
    fault : str
        What is wrong after the last entry; empty where nothing is.
    end : int
        Offset in the decompressed content up to which there are records, in bytes.
    """

    entries: list[Entry] = field(default_factory=list)
    fault: str = ""
    end: int = 0


class ChunkedFile(MessageFile):
    """A file whose messages lie in chunks."""

    def _contained(self) -> tuple[Mapping[int, Channel], Mapping[int, int]]:
        self._chunks: list[Chunk] = []
        with self._opened() as file:
            self._size = file.seek(0, 2)
            self._find_chunks(file)
            for chunk in self._chunks:
                self._learn(file, chunk)
        self._chunks = [chunk for chunk in self._chunks if chunk.counts != {}]
        return self._definitions(), self._declared_counts()

    @property
    def time_span(self) -> tuple[int, int] | None:
        """The first and the last log time in nanoseconds, by the indexes; None without messages."""
        if not self._chunks:
            return None
        return min(c.start for c in self._chunks), max(c.end for c in self._chunks)

    def messages(self, topics: Collection[str] | None = None) -> Iterator[Message]:
        """Read the messages of these topics, or of all, in the order of their log times.

        Messages of equal times come in the order of the file.
        """
        wanted, losses = self._begin(topics)
        chunks = [c for c in self._chunks if c.counts is None or wanted.keys() & c.counts.keys()]
        came: Counter[str] = Counter()
        with self._opened() as file:
            for message in in_time_order(
                chunks, lambda c: c.start, lambda c: self._read(file, c, wanted, losses)
            ):
                came[message.channel.topic] += 1
                yield message
        losses.settle(came, declared(wanted.values()))

    @abstractmethod
    def _find_chunks(self, file: BinaryIO) -> None:
        """Walk the file: fill `_chunks`, and record losses and definitions of channels."""

    @abstractmethod
    def _contents(self, data: bytes, *, define: bool = True) -> Contents:
        """Find the messages in the content of a chunk, and record definitions of channels."""

    @abstractmethod
    def _definitions(self) -> dict[int, Channel]:
        """Return the channels defined so far, by number, without counts."""

    def _declared_counts(self) -> Mapping[int, int]:
        """Return the number of messages of each channel, by channel number."""
        counts: Counter[int] = Counter()
        for chunk in self._chunks:
            counts.update(chunk.counts or {})
        return counts

    def _skip(self, last: Chunk | None, previous: int | None, at: int, following: int) -> None:
        """Record damage, and correct the chunk before it.

        Parameters
        ----------
        last : Chunk or None
            The chunk that the record before the damage is, or belongs to.
        previous : int or None
            Offset of that record. Its length led to `at`, and is taken as wrong where
            `following` lies before `at`.
        at, following : int
            Offset at which no record was found, and that of the next record found.
        """
        begin = at
        if last is not None:
            # Its indexes may be missing in part.
            last.counts = None
        if previous is not None and following < at:
            begin = previous
            if last is not None and last.stop > begin:
                last.stop, last.data_size = begin, begin - last.data_at
            if last is not None and last.position == begin:
                self._chunks.remove(last)
        self._found.add(
            f"is damaged from byte {begin:,} to byte {following:,}", size=following - begin
        )

    def _load(self, file: BinaryIO, chunk: Chunk) -> bytes:
        """Return the decompressed content of a chunk; of one that is cut, what there is.

        Raises
        ------
        DamagedError
            It cannot be read or decompressed, or its checksum is wrong.
        """
        try:
            file.seek(chunk.data_at)
            data = file.read(chunk.data_size)
        except OSError as error:
            raise DamagedError(error.strerror or str(error)) from error
        if chunk.cut:
            return decompress_start(data, chunk.compression, chunk.size)
        if len(data) < chunk.data_size:
            raise DamagedError("the file has become shorter")
        content = decompress(data, chunk.compression, chunk.size)
        if chunk.crc and zlib.crc32(content) != chunk.crc:
            raise DamagedError("its checksum is wrong", content)
        return content

    def _read(
        self, file: BinaryIO, chunk: Chunk, wanted: Mapping[int, Channel], losses: Losses
    ) -> Iterator[Message]:
        """Read the wanted messages of a chunk, in time order; add damage to `losses`."""
        try:
            data = self._load(file, chunk)
        except DamagedError as fault:
            # All its messages, so that each pass says the same of it.
            losses.add(
                f"the chunk at byte {chunk.position:,} is damaged: {fault}",
                messages=self._by_topic(Counter(chunk.counts)),
                nanoseconds=chunk.end - chunk.start,
                size=chunk.data_size,
            )
            return
        contents = self._contents(data)
        if contents.fault and not chunk.cut:
            missing = Counter(chunk.counts)
            missing.subtract(entry.channel for entry in contents.entries)
            losses.add(
                f"the chunk at byte {chunk.position:,} is damaged: {contents.fault}",
                messages=self._by_topic(+missing),
            )
        entries = [entry for entry in contents.entries if entry.channel in wanted]
        entries.sort(key=lambda entry: entry.log_time)
        # No copy, which would cost as much as reading.
        view = memoryview(data)
        for log_time, number, start, stop in entries:
            channel = wanted[number]
            content = plain(view[start:stop], channel.encoding)
            if isinstance(content, DamagedError):
                losses.add(
                    f"a message of {channel.topic} is damaged: {content}",
                    messages={channel.topic: 1},
                    size=stop - start,
                )
            else:
                yield Message(channel, log_time, content)

    def _by_topic(self, counts: Mapping[int, int]) -> Counter[str]:
        """Return counts by channel number as counts by topic."""
        found: Counter[str] = Counter()
        for number, count in counts.items():
            found[self._channels[number].topic if number in self._channels else ""] += count
        return found

    def _learn(self, file: BinaryIO, chunk: Chunk) -> None:
        """Read a chunk if no index says what it holds, or if a channel of it is not defined."""
        if chunk.counts is not None and chunk.counts.keys() <= self._definitions().keys():
            return
        try:
            contents = self._contents(self._load(file, chunk))
        except DamagedError as fault:
            if chunk.counts is None:
                self._count_damaged(chunk, fault)
            return
        entries = contents.entries
        if chunk.cut:
            # Of what is there of it, some may be of no use: the rest of a message, or of a block.
            stored = chunk.stop - chunk.data_at
            read = stored * contents.end // max(chunk.size, 1)
            self._found.size += max(0, chunk.data_size - read)
        if chunk.counts is None:
            if not entries and contents.fault and not chunk.cut:
                # A pass will not read a chunk without entries: its fault is reported here.
                self._found.add(
                    f"the chunk at byte {chunk.position:,} is damaged: {contents.fault}",
                    size=chunk.data_size,
                )
            chunk.counts = dict(Counter(entry.channel for entry in entries))
        if entries:
            chunk.start = min(entry.log_time for entry in entries)
            chunk.end = max(entry.log_time for entry in entries)

    def _count_damaged(self, chunk: Chunk, fault: DamagedError) -> None:
        """Count the messages of a damaged chunk without an index; report it if none can be."""
        entries = self._contents(fault.content, define=False).entries
        if {entry.channel for entry in entries} & self._definitions().keys():
            # A pass will report it.
            self._set_counts(chunk, entries)
            return
        chunk.counts = {}
        self._found.add(
            f"the chunk at byte {chunk.position:,} is damaged: {fault}",
            messages=len(entries),
            size=chunk.data_size,
        )

    def _set_counts(self, chunk: Chunk, entries: Sequence[Entry]) -> None:
        chunk.counts = dict(Counter(entry.channel for entry in entries))
        chunk.start = min(entry.log_time for entry in entries)
        chunk.end = max(entry.log_time for entry in entries)


def find(file: BinaryIO, pattern: re.Pattern[bytes], start: int, stop: int) -> Iterator[int]:
    """Find where a pattern matches in a file, a megabyte at a time.

    Parameters
    ----------
    file : binary file
    pattern : re.Pattern
        Its matches are at most 64 bytes long.
    start, stop : int
        Offsets that bound the search, in bytes.

    Yields
    ------
    int
        Offset of each match in the file, in bytes.
    """
    at = start
    while at < stop:
        file.seek(at)
        window = file.read(min(_WINDOW + _OVERLAP, stop - at))
        for match in pattern.finditer(window):
            if match.start() < _WINDOW:
                yield at + match.start()
        at += _WINDOW
