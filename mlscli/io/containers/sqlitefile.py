"""SQLite files of ROS 2 bags, whole or damaged.

A file is opened so that SQLite writes nothing beside it. Opening reads the row, topic and time of
all messages, 24 bytes each; a pass then reads the messages one by one in the order of their times.
"""

from __future__ import annotations

import shutil
import sqlite3
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from mlscli.errors import InputError
from mlscli.io.containers.compression import plain
from mlscli.io.containers.container import Channel, Message
from mlscli.io.containers.losses import DamagedError
from mlscli.io.containers.messagefile import MessageFile
from mlscli.io.containers.sqlitepages import Pages
from mlscli.io.containers.sqlitetables import Database, MessageRows, Salvage, Tables, values
from mlscli.io.files import open_input
from mlscli.runtime.temporary import temporary_folder

MAGIC = b"SQLite format 3\0"

_HEADER_SIZE = 100
# Of the text of a statement, in bytes, in a file however small.
_LONGEST = 1 << 20
_LOGS = ("-wal", "-journal")


class SqliteFile(MessageFile):
    """The messages of a SQLite file."""

    kind = "ROS 2 bag (SQLite)"

    def _contained(self) -> tuple[Mapping[int, Channel], Mapping[int, int]]:
        missing = self._missing_size()
        fault = f"breaks off at byte {self._size:,}" if missing else ""
        # SQLite would read zeros for what is missing of the last page.
        self._damaged = missing > 0 and not self._has_log()
        try:
            definitions = self._read_tables()
        except sqlite3.Error as error:
            self._damaged = True
            fault = fault or f"is damaged: {error}"
            definitions = self._read_tables()
        if self._damaged and not missing and set(np.unique(self._rows.topics)) - definitions.keys():
            fault = "its table of topics is damaged"
        if self._damaged or self._missing_messages:
            fault = fault or "holds rows that are no messages"
            self._found.add(fault, messages=self._missing_messages, size=missing)
        return definitions, Counter(self._rows.topics.tolist())

    @property
    def time_span(self) -> tuple[int, int] | None:
        """The first and the last log time in nanoseconds; None without messages."""
        times = self._rows.times
        return (int(times[0]), int(times[-1])) if len(times) else None

    def messages(self, topics: Collection[str] | None = None) -> Iterator[Message]:
        """Read the messages of these topics, or of all, in the order of their log times.

        Messages of equal times come in the order of recording.
        """
        wanted, losses = self._begin(topics)
        chosen = self._rows.take(np.flatnonzero(np.isin(self._rows.topics, list(wanted))))
        with self._tables() as tables:
            data = tables.data(chosen)
            topics_and_times = values(chosen.topics), values(chosen.times)
            for stored, topic, time in zip(data, *topics_and_times, strict=True):
                channel = wanted[topic]
                content = plain(stored, channel.encoding) if isinstance(stored, bytes) else stored
                if isinstance(content, DamagedError):
                    losses.add(
                        f"a message of {channel.topic} is damaged: {content}",
                        messages={channel.topic: 1},
                    )
                else:
                    yield Message(channel, time, content)

    def _read_tables(self) -> dict[int, Channel]:
        """Find the messages, in the order of their times; return the channels by topic number.

        Raises
        ------
        InputError
            The tables of a bag are missing.
        """
        self._missing_messages = 0
        with self._tables() as tables:
            names = tables.names()
            # Messages are salvaged even where the entry of their table is lost.
            if not {"topics", *(() if self._damaged else ("messages",))} <= names:
                raise InputError(self._without_tables(names))
            channels, rows = tables.channels(), tables.messages()
            self._missing_messages = tables.missing
        self._rows: MessageRows = rows.take(np.argsort(rows.times, kind="stable"))
        return channels

    def _without_tables(self, names: Collection[str]) -> str:
        """Return the error on a database that lacks the tables of a bag."""
        listed = ", ".join(sorted(names)[:10])
        if self._damaged:
            found = f"the tables {listed}" if listed else "no table"
            return (
                f"{self.name}: is a damaged SQLite database, of which {found} can be read; without "
                "its table of topics nothing says what its messages are"
            )
        found = f"of the tables {listed}" if listed else "without tables"
        return (
            f"{self.name}: is a SQLite database {found}, expected topics and messages, as ROS 2 "
            "bags have"
        )

    def _missing_size(self) -> int:
        """Return how many bytes the file is shorter than its header says.

        The header holds the size of a page (1 means 65536), the number of pages, and two counters
        of changes. Where the counters differ, the last writer did not update the number of pages
        (https://www.sqlite.org/fileformat.html).
        """
        with self._opened() as file:
            head = file.read(_HEADER_SIZE)
            self._size = file.seek(0, 2)
        if not head.startswith(MAGIC) or len(head) < _HEADER_SIZE:
            found = f"holds {len(head)} bytes, beginning with {head[:16]!r}" if head else "is empty"
            raise InputError(f"{self.name}: {found}, expected a SQLite database")
        page = int.from_bytes(head[16:18], "big")
        pages = int.from_bytes(head[28:32], "big") if head[24:28] == head[92:96] else 0
        return max((65536 if page == 1 else page) * pages - self._size, 0)

    @contextmanager
    def _tables(self) -> Iterator[Tables]:
        """Open the tables for reading.

        A recorder that broke off leaves a part of the content in a log beside the file. SQLite
        merges the log by writing, so both are first copied into a temporary folder.
        """
        if self._damaged:
            try:
                with open_input(self.path) as file:
                    yield Salvage(Pages(file))
            except (DamagedError, OSError) as error:
                raise InputError(f"{self.name}: cannot be read: {error}") from error
            return
        with temporary_folder(None, "bag") as folder:
            path, mode = self.path, "mode=ro&immutable=1"
            if self._has_log():
                path, mode = folder / "bag.db3", "mode=rw"
                self._copy_with_logs(path)
            try:
                connection = sqlite3.connect(f"{path.resolve().as_uri()}?{mode}", uri=True)
            except sqlite3.Error as error:
                raise InputError(f"{self.name}: cannot be opened: {error}") from error
            # No value is longer than the file; one that SQLite computes would be.
            connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, max(path.stat().st_size, _LONGEST))
            try:
                yield Database(connection)
            finally:
                connection.close()

    def _copy_with_logs(self, target: Path) -> None:
        try:
            for ending in ("", *_LOGS):
                if (source := _beside(self.path, ending)).exists():
                    shutil.copyfile(source, _beside(target, ending))
        except OSError as error:
            raise InputError(
                f"{self.name}: cannot be copied to {target.parent}, to bring in the log beside it: "
                f"{error.strerror or error}"
            ) from error

    def _has_log(self) -> bool:
        logs = (_beside(self.path, ending) for ending in _LOGS)
        return any(log.is_file() and log.stat().st_size for log in logs)


def _beside(path: Path, ending: str) -> Path:
    return path.with_name(path.name + ending)
