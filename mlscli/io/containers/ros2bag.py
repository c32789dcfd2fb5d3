"""ROS 2 bags: folders of SQLite or MCAP files, with or without a `metadata.yaml`.

The metadata say which files are meant, in the order of their recording, and what they should hold;
the files decide what there is. A recording may be split into several files. One that the metadata
do not name belongs to it if it goes on where they end, as after a crash, or if one that they name
is missing; but a copy, which holds messages that are there already, never does. A file that is
compressed as a whole is decompressed into a temporary folder when it is opened, and again when its
messages are due.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TypeAlias

from mlscli.errors import InputError
from mlscli.io.containers import mcaprecords, sqlitefile
from mlscli.io.containers.compression import ZSTD_MAGIC, decompress_file
from mlscli.io.containers.container import Channel, Message
from mlscli.io.containers.losses import Losses
from mlscli.io.containers.mcapfile import McapFile
from mlscli.io.containers.ros2metadata import STORAGE, Metadata
from mlscli.io.containers.sqlitefile import SqliteFile
from mlscli.io.containers.streams import in_settled_order, in_time_order, united
from mlscli.io.files import open_input
from mlscli.io.ros import METADATA_FILE
from mlscli.runtime.temporary import temporary_folder
from mlscli.words import some

Storage: TypeAlias = SqliteFile | McapFile

_NUMBER = re.compile(r"(?:_(\d+))?\.(?:db3|mcap)$")
_COMPRESSED = re.compile(r"\.zstd?$")
# So many messages of a file are looked for in others.
_LOOKED_FOR = 20


class Ros2Bag:
    """A ROS 2 bag.

    Parameters
    ----------
    path : Path
        The folder, or a single file of one.

    Raises
    ------
    InputError
        None of its files can be read.
    """

    kind = "ROS 2 bag"

    def __init__(self, path: Path) -> None:
        self.path = path
        self.notes: list[str] = []
        self._found = Losses(path)
        self._parts: list[_BagFile] = []
        metadata = Metadata()
        faults: list[str] = []
        files, others = [path], list[Path]()
        if path.is_dir():
            metadata = Metadata.read(path, self.notes)
            files, others = self._files(metadata, self._listing())
        for file in (*files, *others):
            try:
                part = _BagFile.open(file)
            except InputError as error:
                faults.append(str(error))
                self._lose(file.name, metadata, f"{file.name} cannot be read")
                continue
            of = f", which {METADATA_FILE} does not name," if file in others else ""
            if (len(files) > 1 or of) and part.repeats(self._parts):
                self.notes.append(
                    f"{path}: {file.name}{of} is not read: its messages are those of other files"
                )
                continue
            if of:
                self.notes.append(f"{path}: {METADATA_FILE} does not name {file.name}; it is read")
            self._parts.append(part)
        if not self._parts:
            raise InputError(faults[0] if faults else self._nothing())
        channels = {(at, c): c for at, part in enumerate(self._parts) for c in part.channels}
        self._channels = united(channels, {key: c.count for key, c in channels.items()})
        self._compare(metadata)

    @property
    def channels(self) -> Sequence[Channel]:
        """Its channels, sorted by topic, type, encoding and schema."""
        return in_settled_order(self._channels.values())

    @property
    def time_span(self) -> tuple[int, int] | None:
        """The first and the last log time in nanoseconds; None without messages."""
        spans = [part.span for part in self._parts if part.span is not None]
        return (min(s for s, _ in spans), max(e for _, e in spans)) if spans else None

    @property
    def losses(self) -> Sequence[str]:
        """What opening it and the last pass could not read, in a line for each file."""
        return [*self._found.lines(), *(line for part in self._parts for line in part.losses)]

    def messages(self, topics: Collection[str] | None = None) -> Iterator[Message]:
        """Read the messages of these topics, or of all, in the order of their log times.

        Messages of equal times come in the order of the files.
        """
        for part in self._parts:
            part.losses = part.found
        streams = [
            (part.span[0], self._read(at, part, topics))
            for at, part in enumerate(self._parts)
            if part.span is not None
            and (topics is None or any(channel.topic in topics for channel in part.channels))
        ]
        yield from in_time_order(streams, lambda s: s[0], lambda s: s[1])

    def _read(self, at: int, part: _BagFile, topics: Collection[str] | None) -> Iterator[Message]:
        """Read the messages of a file, with the merged channels of the bag."""
        with part.opened() as storage:
            # By identity, as a comparison of channels compares whole schemas.
            channels = {id(c): self._channels[at, c] for c in storage.channels}
            try:
                for channel, log_time, data in storage.messages(topics):
                    yield Message(channels[id(channel)], log_time, data)
            finally:
                part.take_losses(storage)

    def _listing(self) -> dict[str, Path]:
        try:
            # Hidden files are none of a bag's: macOS puts them beside those that it copies.
            seen = (path for path in self.path.iterdir() if not path.name.startswith("."))
            return {path.name: path for path in sorted(seen, key=_by_number)}
        except OSError as error:
            raise InputError(f"{self.path}: cannot be read: {error.strerror or error}") from error

    def _files(self, metadata: Metadata, there: dict[str, Path]) -> tuple[list[Path], list[Path]]:
        """Return the files that the metadata name, in their order, and others that may belong.

        A file that is named may also be there compressed, or decompressed. Without metadata all
        files count as named. Of others, a note tells those that are left out.

        Raises
        ------
        InputError
            There are no metadata, and the names of the files are those of several recordings.
        """
        files: dict[str, Path] = {}
        missing = False
        for name in metadata.files:
            plain = _COMPRESSED.sub("", name)
            alike = [n for n in (name, plain, f"{plain}.zstd", f"{plain}.zst") if n in there]
            if alike:
                files.setdefault(plain, there[alike[0]])
            else:
                missing = True
                self._lose(name, metadata, f"{METADATA_FILE} names {name}, which is missing")
        others = {
            plain: path
            for name, path in there.items()
            if STORAGE.search(name) and (plain := _COMPRESSED.sub("", name)) not in files
        }
        if not metadata.files:
            if len({_NUMBER.sub("", name) for name in others}) > 1:
                raise InputError(
                    f"{self.path}: holds {', '.join(path.name for path in others.values())} and no "
                    f"{METADATA_FILE} that makes them one recording; name one of them"
                )
            return list(others.values()), []
        last = {_NUMBER.sub("", name): _number(name) for name in sorted(files, key=_number)}
        going_on = {
            name: path
            for name, path in others.items()
            if missing or _number(name) > last.get(_NUMBER.sub("", name), _number(name))
        }
        if left := [path.name for name, path in others.items() if name not in going_on]:
            self.notes.append(
                f"{self.path}: not read: {', '.join(left)}, which {METADATA_FILE} does not name"
            )
        return list(files.values()), list(going_on.values())

    def _lose(self, name: str, metadata: Metadata, reason: str) -> None:
        declared = metadata.files.get(name)
        self._found.add(
            reason,
            messages=declared.messages if declared else 0,
            nanoseconds=declared.nanoseconds if declared else 0,
        )

    def _compare(self, metadata: Metadata) -> None:
        """Compare how many messages there are with how many the metadata declare."""
        count = sum(channel.count or 0 for channel in set(self._channels.values()))
        if metadata.messages is None or metadata.messages == count:
            return
        messages = some(metadata.messages, "message")
        fault = f"{METADATA_FILE} declares {messages}, the files hold {count:,}"
        missing = metadata.messages - count - self._found.total
        if missing > 0:
            self._found.add(fault, messages=missing)
        elif metadata.messages < count:
            self.notes.append(f"{self.path}: {fault}; read all the same")

    def _nothing(self) -> str:
        if self._found.reasons:
            return f"{self.path}: {self._found.reasons[0]}"
        names = list(self._listing())
        listed = ", ".join(names[:5]) + (", ..." if len(names) > 5 else "")
        return (
            f"{self.path}: holds {listed or 'nothing'}, expected the .db3 or .mcap files of a "
            "ROS 2 bag"
        )


@dataclass
class _BagFile:
    """A file of a bag.

    Attributes
    ----------
    path : Path
    channels : sequence of Channel
    span : tuple of int or None
        The first and the last log time in nanoseconds; None without messages.
    storage : SqliteFile, McapFile or None
        The file as opened; None where it is compressed, and decompressed for each use.
    fault : str
        What is wrong with the compressed file; empty where nothing is.
    found, losses : sequence of str
        What opening it, and what opening it and the last pass could not read.
    """

    path: Path
    channels: Sequence[Channel]
    span: tuple[int, int] | None
    storage: Storage | None
    fault: str = ""
    found: Sequence[str] = ()
    losses: Sequence[str] = ()

    @classmethod
    def open(cls, path: Path) -> _BagFile:
        part = cls(path, (), None, None)
        part.storage = None if _head(path).startswith(ZSTD_MAGIC) else _open_storage(path)
        with part.opened() as storage:
            part.channels, part.span = storage.channels, storage.time_span
            part.take_losses(storage)
        part.found = part.losses
        return part

    @contextmanager
    def opened(self) -> Iterator[Storage]:
        if self.storage is not None:
            yield self.storage
            return
        with temporary_folder(None, "bag") as folder:
            plain = folder / "plain"
            try:
                with open_input(self.path) as source, plain.open("wb") as target:
                    self.fault = decompress_file(source, target)
            except OSError as error:
                raise InputError(
                    f"{self.path}: cannot be decompressed into {folder}: {error.strerror or error}"
                ) from error
            if self.fault and not _head(plain):
                raise InputError(
                    f"{self.path}: cannot be decompressed: {self.fault}, within its first block"
                )
            yield _open_storage(plain, self.path)

    def repeats(self, others: Iterable[_BagFile]) -> bool:
        """Return whether its first messages are also in the others: same topic, time and size.

        Files whose times lie apart need not be read for that.
        """
        alike = [part for part in others if self.span and part.span and self._overlaps(part)]
        if not alike:
            return False
        with self.opened() as storage:
            first = {_identity(message) for message in islice(storage.messages(), _LOOKED_FOR)}
        if not first:
            return False
        latest = max(time for _, time, _ in first)
        for part in alike:
            with part.opened() as storage:
                for message in storage.messages({topic for topic, _, _ in first}):
                    if message.log_time > latest:
                        break
                    first.discard(_identity(message))
        return not first

    def _overlaps(self, other: _BagFile) -> bool:
        (begin, end), (other_begin, other_end) = self.span or (0, 0), other.span or (0, 0)
        return begin <= other_end and other_begin <= end

    def take_losses(self, storage: Storage) -> None:
        self.losses = storage.losses or ([f"{self.path}: {self.fault}"] if self.fault else [])


def _open_storage(path: Path, name: Path | None = None) -> Storage:
    """Open a file of a bag as SQLite or MCAP, by its content; see `MessageFile`.

    Raises
    ------
    InputError
        The file is neither, or cannot be read at all.
    """
    head = _head(path)
    if head.startswith(sqlitefile.MAGIC):
        return SqliteFile(path, name)
    if head.startswith(mcaprecords.MAGIC):
        return McapFile(path, name)
    found = f"begins with {head!r}" if head else "is empty"
    raise InputError(f"{name or path}: {found}, expected SQLite or MCAP, as ROS 2 bags hold")


def _identity(message: Message) -> tuple[str, int, int]:
    return message.channel.topic, message.log_time, len(message.data)


def _number(name: str) -> int:
    """Return the number of a file of a bag by its name; 0 where it has none."""
    found = _NUMBER.search(name)
    return int(found[1] or 0) if found else 0


def _head(path: Path) -> bytes:
    try:
        with open_input(path) as file:
            return file.read(16)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error


def _by_number(path: Path) -> list[tuple[int, str]]:
    """Return a key that sorts names by the numbers in them: bag_2 before bag_10."""
    words = re.split(r"(\d+)", path.name)
    return [(int(word), "") if word.isdecimal() else (-1, word) for word in words]
