"""ROS 2 bags: folders of SQLite or MCAP files, with or without a `metadata.yaml`.

The files decide what there is; the metadata give the order of their recording and what they should
hold. A recording may be split into several files. A file that is compressed as a whole is
decompressed into a temporary folder when it is opened, and again when its messages are due.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
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
from mlscli.io.ros import METADATA_FILE

Storage: TypeAlias = SqliteFile | McapFile

_NUMBER = re.compile(r"(?:_\d+)?\.(?:db3|mcap)$")
_COMPRESSED = re.compile(r"\.zstd?$")


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
        files = [path]
        if path.is_dir():
            metadata = Metadata.read(path, self.notes)
            files = self._files(metadata, self._listing())
        for file in files:
            try:
                self._parts.append(_BagFile.open(file))
            except InputError as error:
                faults.append(str(error))
                self._lose(file.name, metadata, f"{file.name} cannot be read")
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
            return {path.name: path for path in sorted(self.path.iterdir(), key=_by_number)}
        except OSError as error:
            raise InputError(f"{self.path}: cannot be read: {error.strerror or error}") from error

    def _files(self, metadata: Metadata, there: dict[str, Path]) -> list[Path]:
        """Return the files to read: those that the metadata name, in their order, then all others.

        A file that is named may also be there compressed, or decompressed.

        Raises
        ------
        InputError
            There are no metadata, and the names of the files are those of several recordings.
        """
        files: dict[str, Path] = {}
        for name in metadata.files:
            plain = _COMPRESSED.sub("", name)
            alike = [n for n in (name, plain, f"{plain}.zstd", f"{plain}.zst") if n in there]
            if alike:
                files.setdefault(plain, there[alike[0]])
            else:
                self._lose(name, metadata, f"{METADATA_FILE} names {name}, which is missing")
        others = {
            plain: path
            for name, path in there.items()
            if STORAGE.search(name) and (plain := _COMPRESSED.sub("", name)) not in files
        }
        if not metadata.files and len({_NUMBER.sub("", name) for name in others}) > 1:
            raise InputError(
                f"{self.path}: holds {', '.join(path.name for path in others.values())} and no "
                f"{METADATA_FILE} that makes them one recording; name one of them"
            )
        if others and metadata.files:
            names = ", ".join(path.name for path in others.values())
            self.notes.append(
                f"{self.path}: {METADATA_FILE} does not name {names}; read all the same"
            )
        return [*files.values(), *others.values()]

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
        fault = f"{METADATA_FILE} declares {metadata.messages:,} messages, the files hold {count:,}"
        missing = metadata.messages - count - self._found.messages
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
        with tempfile.TemporaryDirectory(prefix="mls-") as folder:
            plain = Path(folder) / "plain"
            try:
                with self.path.open("rb") as source, plain.open("wb") as target:
                    self.fault = decompress_file(source, target)
            except OSError as error:
                raise InputError(
                    f"{self.path}: cannot be decompressed into {folder}: {error.strerror or error}"
                ) from error
            yield _open_storage(plain, self.path)

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


def _head(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(16)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error


def _by_number(path: Path) -> list[tuple[int, str]]:
    """Return a key that sorts names by the numbers in them: bag_2 before bag_10."""
    words = re.split(r"(\d+)", path.name)
    return [(int(word), "") if word.isdecimal() else (-1, word) for word in words]
