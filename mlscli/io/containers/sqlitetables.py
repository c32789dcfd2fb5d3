"""The tables of a ROS 2 bag in SQLite, read by SQLite, or page by page where damaged.

`topics` names the channels, `messages` holds their messages in the order of recording, and,
since ROS 2 Iron, `message_definitions` defines the types.
"""

from __future__ import annotations

import sqlite3
from array import array
from collections.abc import Iterable, Iterator, Sequence
from itertools import islice
from typing import NamedTuple, Protocol

import numpy as np

from mlscli.io.containers.container import Channel
from mlscli.io.containers.losses import DamagedError
from mlscli.io.containers.messagetypes import ros2_name
from mlscli.io.containers.sqlitepages import Pages, TableRow
from mlscli.runtime.arrays import Int64

_BLOCK_ROWS = 1 << 12


class MessageRows(NamedTuple):
    """Where the messages are.

    Attributes
    ----------
    rows : int64 (N,)
        The row of each message: its rowid, or its page and offset, packed, in a damaged database.
    topics : int64 (N,)
        Number of its topic.
    times : int64 (N,)
        Log time in nanoseconds.
    """

    rows: Int64
    topics: Int64
    times: Int64

    @classmethod
    def of(cls, blocks: Iterable[Sequence[tuple[int, int, int]]]) -> MessageRows:
        """Gather tuples (row, topic, time) from blocks of them, in 24 bytes each."""
        tables = [np.array(block, dtype=np.int64).reshape(-1, 3) for block in blocks]
        rows, topics, times = np.concatenate([np.empty((0, 3), dtype=np.int64), *tables]).T
        return cls(rows, topics, times)

    def take(self, chosen: Int64) -> MessageRows:
        """Return the messages at these indices, in this order."""
        return MessageRows(*(column[chosen] for column in self))


def values(column: Int64) -> Iterator[int]:
    """Yield the values of a column one by one, without a list of them all."""
    for at in range(0, len(column), _BLOCK_ROWS):
        yield from column[at : at + _BLOCK_ROWS].tolist()


class Tables(Protocol):
    """The tables of a bag.

    Attributes
    ----------
    missing : int
        Number of messages that must have been there but were not found by `messages`.
    """

    missing: int

    def names(self) -> set[str]:
        """Return the names of all tables."""

    def channels(self) -> dict[int, Channel]:
        """Return the channels by topic number, without counts."""

    def messages(self) -> MessageRows:
        """Return where the messages are, in the order of recording."""

    def data(self, wanted: MessageRows) -> Iterator[bytes | DamagedError]:
        """Read the data of messages, in this order; yield the error where one cannot be read."""


class Database:
    """The tables as SQLite reads them; its errors are passed on as `sqlite3.Error`."""

    def __init__(self, connection: sqlite3.Connection) -> None:
        self.missing = 0
        connection.text_factory = lambda text: text.decode(errors="replace")
        self._connection = connection

    def names(self) -> set[str]:
        """Return the names of all tables."""
        found = self._connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")
        return {str(name) for (name,) in found}

    def channels(self) -> dict[int, Channel]:
        """Return the channels by topic number, without counts."""
        definitions: list[tuple[object, ...]] = []
        if "message_definitions" in self.names():
            definitions = self._connection.execute(
                "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
            ).fetchall()
        topics = self._connection.execute("SELECT id, name, type, serialization_format FROM topics")
        return _channels(topics, definitions)

    def messages(self) -> MessageRows:
        """Return where the messages are, in the order of recording."""
        cursor = self._connection.execute(
            "SELECT rowid, topic_id, timestamp FROM messages NOT INDEXED "
            "WHERE typeof(topic_id) = 'integer' AND typeof(timestamp) = 'integer' ORDER BY rowid"
        )
        found = MessageRows.of(iter(lambda: cursor.fetchmany(_BLOCK_ROWS), []))
        ((count,),) = self._connection.execute("SELECT count(*) FROM messages NOT INDEXED")
        self.missing = count - len(found.rows)
        return found

    def data(self, wanted: MessageRows) -> Iterator[bytes | DamagedError]:
        """Read the data of messages, in this order; yield the error where one cannot be read."""
        came = 0
        if np.all(wanted.rows[1:] > wanted.rows[:-1]):
            # In the order of rows, one query for all is several times as fast for small messages.
            for data in self._in_turn(wanted):
                yield data
                came += 1
        for row in values(wanted.rows[came:]):
            yield self._one(row)

    def _in_turn(self, wanted: MessageRows) -> Iterator[bytes | DamagedError]:
        """Read messages of ascending rows in one query, up to the first damage."""
        topics = ", ".join(map(str, np.unique(wanted.topics)))
        expected = values(wanted.rows)
        due = next(expected, None)
        try:
            for row, data in self._connection.execute(
                f"SELECT rowid, data FROM messages NOT INDEXED WHERE topic_id IN ({topics}) "
                "ORDER BY rowid"
            ):
                if row == due:
                    yield _checked(data)
                    due = next(expected, None)
        except sqlite3.DatabaseError:
            return

    def _one(self, row: int) -> bytes | DamagedError:
        try:
            found = self._connection.execute(
                "SELECT data FROM messages WHERE rowid = ?", (row,)
            ).fetchone()
        except sqlite3.DatabaseError as error:
            return DamagedError(str(error))
        return _checked(found[0] if found else None)


class Salvage:
    """The tables of a damaged database, as far as its pages can be read.

    Rows of messages are recognised by their values, as the pages that refer to them may be lost:
    a null in place of the row's number, two numbers, and data.
    """

    def __init__(self, pages: Pages) -> None:
        self._pages = pages
        self.missing = 0

    def names(self) -> set[str]:
        """Return the names of all tables."""
        return set(self._pages.tables())

    def channels(self) -> dict[int, Channel]:
        """Return the channels by topic number, without counts."""
        definitions = [row[1:] for row in self._rows("message_definitions")]
        return _channels(self._rows("topics"), definitions)

    def messages(self) -> MessageRows:
        """Return where the messages are, in the order of recording."""
        numbers = array("q")
        messages = self._messages(numbers)
        found = MessageRows.of(iter(lambda: list(islice(messages, _BLOCK_ROWS)), []))
        _, order = np.unique(np.frombuffer(numbers, dtype=np.int64), return_index=True)
        # Rows are numbered from 1.
        self.missing = max(numbers, default=0) - len(order)
        return found.take(order)

    def data(self, wanted: MessageRows) -> Iterator[bytes | DamagedError]:
        """Read the data of messages, in this order; yield the error where one cannot be read."""
        for row in values(wanted.rows):
            try:
                yield _checked(self._pages.values(_unpacked(row), 4)[3])
            except DamagedError as fault:
                yield fault

    def _rows(self, table: str) -> Iterator[tuple[object, ...]]:
        """Read the first four values of each row of a table; the first is the row's number."""
        first = self._pages.tables().get(table)
        for row in self._pages.rows(first) if first else ():
            try:
                _, *values = self._pages.values(row, 4)
            except DamagedError:
                continue
            yield row.number, *(_text(v) for v in values)

    def _messages(self, numbers: array[int]) -> Iterator[tuple[int, int, int]]:
        for row in self._pages.all_rows():
            try:
                types = self._pages.types(row)
                if len(types) != 4 or types[0] != 0 or types[3] < 12 or types[3] % 2:
                    continue
                _, topic, time = self._pages.values(row, 3)
            except DamagedError:
                continue
            if isinstance(topic, int) and isinstance(time, int) and row.number > 0:
                numbers.append(row.number)
                yield _packed(row), topic, time


def _checked(data: object) -> bytes | DamagedError:
    return data if isinstance(data, bytes) else DamagedError("it holds no data")


def _packed(row: TableRow) -> int:
    """Return the page and offset of a row in one number; pages have at most 65536 bytes."""
    return row.page << 16 | row.offset


def _unpacked(place: int) -> TableRow:
    return TableRow(0, place >> 16, place & 0xFFFF)


def _channels(
    topics: Iterable[tuple[object, ...]], definitions: Iterable[tuple[object, ...]]
) -> dict[int, Channel]:
    schemas: dict[str, tuple[str, str]] = {}
    for type_, encoding, text in definitions:
        schemas.setdefault(str(type_), (str(encoding), str(text or "")))
    channels = {}
    for number, topic, type_, encoding in topics:
        schema_encoding, schema = schemas.get(str(type_), ("", ""))
        if isinstance(number, int):
            channels[number] = Channel(
                topic=str(topic),
                type=ros2_name(str(type_)),
                encoding=str(encoding),
                schema=schema.encode(),
                schema_encoding=schema_encoding if schema else "",
                count=None,
            )
    return channels


def _text(value: object) -> object:
    return value.decode(errors="replace") if isinstance(value, bytes) else value
