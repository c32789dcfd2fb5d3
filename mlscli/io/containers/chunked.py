"""What ROS 1 bags and MCAP files share: messages in chunks that are found before they are read.

Opening walks from record to record and skips the chunks' content; what a chunk holds and when is
told by the index beside it. A chunk whose index is missing, as at the end of a recording that
breaks off, is read once at opening instead. A pass then reads the chunks that hold what is
wanted, in the order of their times. What is damaged is left out and told; what the end of the
file cuts is read as far as it goes.
"""

from __future__ import annotations

import re
import zlib
from abc import abstractmethod
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from typing import BinaryIO, NamedTuple

from mlscli.io.containers.compression import decompress, decompress_start, plain
from mlscli.io.containers.container import Channel, Message
from mlscli.io.containers.losses import DamagedError, Losses
from mlscli.io.containers.messagefile import MessageFile
from mlscli.io.containers.streams import in_time_order

_WINDOW = 1 << 20
_OVERLAP = 64


@dataclass
class Chunk:
    """A run of records in a file, among them messages.

    Attributes
    ----------
    position, stop : int
        Where it begins in the file, and where what follows it does, in bytes.
    start, end : int
        The first and the last log time in nanoseconds, once `counts` are known.
    counts : dict or None
        The messages of each channel by its number; None where not known.
    data_at, data_size : int
        Where its content lies, as stored.
    compression, size, crc
        How that is compressed, its bytes decompressed, and their checksum; 0 without one.
    cut : bool
        The file ends before it does, which is told already.
    bare : bool
        Its records stand in the file itself, in no chunk.
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
    """A message in the content of a chunk: its time, its channel, and where its data lies."""

    log_time: int
    channel: int
    start: int
    stop: int


@dataclass
class Contents:
    """The messages of a chunk, and what is wrong after the last of them; empty if nothing."""

    entries: list[Entry] = field(default_factory=list)
    fault: str = ""


class ChunkedFile(MessageFile):
    """A file of chunks."""

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
        """The first and the last log time in nanoseconds, as its indexes tell."""
        if not self._chunks:
            return None
        return min(c.start for c in self._chunks), max(c.end for c in self._chunks)

    def messages(self, topics: Collection[str] | None = None) -> Iterator[Message]:
        """Read the messages of these topics, or of all, in the order of their log times.

        Of equal times, the message that stands first in the file comes first.
        """
        wanted, losses = self._begin(topics)
        chunks = [c for c in self._chunks if c.counts is None or wanted.keys() & c.counts.keys()]
        came = 0
        with self._opened() as file:
            for message in in_time_order(
                chunks, lambda c: c.start, lambda c: self._read(file, c, wanted, losses)
            ):
                came += 1
                yield message
        losses.settle(came, sum(channel.count or 0 for channel in set(wanted.values())))

    @abstractmethod
    def _find_chunks(self, file: BinaryIO) -> None:
        """Walk the file: fill `_chunks`, tell losses, and take note of definitions."""

    @abstractmethod
    def _contents(self, data: bytes) -> Contents:
        """Find the messages in the content of a chunk, and take note of definitions."""

    @abstractmethod
    def _definitions(self) -> dict[int, Channel]:
        """Return the channels that were defined, by their numbers, without counts."""

    def _declared_counts(self) -> Mapping[int, int]:
        """Return the messages of each channel."""
        counts: Counter[int] = Counter()
        for chunk in self._chunks:
            counts.update(chunk.counts or {})
        return counts

    def _skip(self, last: Chunk | None, previous: int | None, at: int, following: int) -> None:
        """Go on after damage.

        Parameters
        ----------
        last : Chunk or None
            The chunk that the record before the damage belongs to.
        previous : int or None
            Where that record begins. Its length led to the damage, and is at fault where what
            follows was found within.
        at, following : int
            Where no record is, and where what follows was found.
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
        """Return the content of a chunk; of one that is cut, what there is."""
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
            raise DamagedError("its checksum is wrong")
        return content

    def _read(
        self, file: BinaryIO, chunk: Chunk, wanted: Mapping[int, Channel], losses: Losses
    ) -> Iterator[Message]:
        """Read the messages of a chunk, in time order."""
        try:
            data = self._load(file, chunk)
        except DamagedError as fault:
            counts = chunk.counts or {}
            losses.add(
                f"the chunk at byte {chunk.position:,} is damaged: {fault}",
                messages=sum(count for number, count in counts.items() if number in wanted),
                nanoseconds=chunk.end - chunk.start,
                size=chunk.data_size,
            )
            return
        contents = self._contents(data)
        if contents.fault and not chunk.cut:
            losses.add(f"the chunk at byte {chunk.position:,} is damaged: {contents.fault}")
        entries = [entry for entry in contents.entries if entry.channel in wanted]
        entries.sort(key=lambda entry: entry.log_time)
        # A copy would cost as much as reading.
        view = memoryview(data)
        for log_time, number, start, stop in entries:
            channel = wanted[number]
            content = plain(view[start:stop], channel.encoding)
            if isinstance(content, DamagedError):
                losses.add(
                    f"a message of {channel.topic} is damaged: {content}",
                    messages=1,
                    size=stop - start,
                )
            else:
                yield Message(channel, log_time, content)

    def _learn(self, file: BinaryIO, chunk: Chunk) -> None:
        """Read a chunk where no index tells what it holds, or what its channels are."""
        if chunk.counts is not None and chunk.counts.keys() <= self._definitions().keys():
            return
        try:
            contents = self._contents(self._load(file, chunk))
        except DamagedError as fault:
            if chunk.counts is None:
                chunk.counts = {}
                self._found.add(
                    f"the chunk at byte {chunk.position:,} is damaged: {fault}",
                    size=chunk.data_size,
                )
            return
        entries = contents.entries
        if chunk.counts is None:
            if not entries and contents.fault and not chunk.cut:
                # A chunk of which nothing is known is not read again, and its fault told here.
                self._found.add(
                    f"the chunk at byte {chunk.position:,} is damaged: {contents.fault}",
                    size=chunk.data_size,
                )
            chunk.counts = dict(Counter(entry.channel for entry in entries))
        if entries:
            chunk.start = min(entry.log_time for entry in entries)
            chunk.end = max(entry.log_time for entry in entries)


def find(file: BinaryIO, pattern: re.Pattern[bytes], start: int, stop: int) -> Iterator[int]:
    """Find where a pattern of at most 64 bytes matches in a file, a megabyte at a time."""
    at = start
    while at < stop:
        file.seek(at)
        window = file.read(min(_WINDOW + _OVERLAP, stop - at))
        for match in pattern.finditer(window):
            if match.start() < _WINDOW:
                yield at + match.start()
        at += _WINDOW
