"""The rows of a damaged SQLite database, page by page (https://www.sqlite.org/fileformat.html).

SQLite refuses a database whose end is missing, and loses all that is below a damaged page. Here
every page that holds rows is read, whether another page refers to it or not. This suits a
recording, which only adds rows: no page holds deleted ones.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import BinaryIO, NamedTuple, TypeAlias

from mlscli.io.containers.losses import DamagedError

Value: TypeAlias = int | float | bytes | None
"""A value in a row; text is returned as bytes."""

_HEADER_SIZE = 100
_INTERIOR, _LEAF = 5, 13
_INTEGER_SIZES = (0, 1, 2, 3, 4, 6, 8)
_PIECE_BYTES = 1 << 20


class TableRow(NamedTuple):
    """Where a row lies.

    Attributes
    ----------
    number : int
        The rowid.
    page : int
        Number of its page, from 1.
    offset : int
        Offset of its cell in the page, in bytes.
    """

    number: int
    page: int
    offset: int


class Pages:
    """The whole pages of a database, numbered from 1.

    Parameters
    ----------
    file : binary file
        Must stay open as long as the pages are used.

    Raises
    ------
    DamagedError
        The header is cut, or states an impossible size of pages.
    """

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self._size = file.seek(0, 2)
        file.seek(0)
        header = file.read(_HEADER_SIZE)
        if len(header) < _HEADER_SIZE:
            raise DamagedError("it breaks off in its header")
        size = int.from_bytes(header[16:18], "big")
        self._page_size = 65536 if size == 1 else size
        if self._page_size < 512 or self._page_size & (self._page_size - 1):
            raise DamagedError(f"its header says pages have {size} bytes")
        # Some bytes at the end of each page may be reserved.
        self._usable = self._page_size - header[20]
        self._count = self._size // self._page_size
        self._held = (0, b"")

    def tables(self) -> dict[str, int]:
        """Return the root page of each table by name; that of the schema itself is page 1."""
        tables: dict[str, int] = {}
        for row in self.rows(1):
            try:
                kind, name, _, page = self.values(row, 4)
            except (DamagedError, ValueError):
                continue
            if kind == b"table" and isinstance(name, bytes) and isinstance(page, int):
                tables[name.decode(errors="replace")] = page
        return tables

    def rows(self, page: int) -> Iterator[TableRow]:
        """Find the rows of the table with this root page, as far as its pages can be read."""
        waiting, seen = [page], set()
        while waiting:
            number = waiting.pop()
            if number in seen or not 0 < number <= self._count:
                continue
            seen.add(number)
            content = self._page(number)
            kind, cells = self._cells(number, content)
            if kind == _LEAF:
                yield from self._leaf_rows(number, content, cells)
            elif kind == _INTERIOR:
                start = _HEADER_SIZE if number == 1 else 0
                last = _number(content, start + 8)
                waiting += [last, *(_number(content, at) for at in reversed(cells))]

    def all_rows(self) -> Iterator[TableRow]:
        """Find the rows of all tables, in the order of the file."""
        for number in range(1, self._count + 1):
            content = self._page(number)
            kind, cells = self._cells(number, content)
            if kind == _LEAF:
                yield from self._leaf_rows(number, content, cells)

    def values(self, row: TableRow, count: int) -> list[Value]:
        """Return the first `count` values of a row.

        Raises
        ------
        DamagedError
            The row has fewer values, or a part of them is missing.
        """
        types, starts = self._layout(row, count)
        payload = self._payload(row, starts[count])
        return [
            _value(type_, payload[start:stop])
            for type_, start, stop in zip(types, starts, starts[1:], strict=False)
        ][:count]

    def types(self, row: TableRow) -> list[int]:
        """Return the serial types of a row's values, as SQLite defines them.

        Raises
        ------
        DamagedError
            There is no sound row.
        """
        return self._layout(row, 0)[0]

    def _page(self, number: int) -> bytes:
        if self._held[0] != number:
            self._file.seek((number - 1) * self._page_size)
            self._held = (number, self._file.read(self._page_size))
        return self._held[1]

    def _cells(self, number: int, content: bytes) -> tuple[int, list[int]]:
        """Return the kind of a page, and the offsets of its cells in bytes."""
        start = _HEADER_SIZE if number == 1 else 0
        kind = content[start]
        if kind not in (_INTERIOR, _LEAF):
            return kind, []
        count = int.from_bytes(content[start + 3 : start + 5], "big")
        first = start + (12 if kind == _INTERIOR else 8)
        if first + 2 * count > self._usable:
            return 0, []
        last = first + 2 * count
        cells = (int.from_bytes(content[at : at + 2], "big") for at in range(first, last, 2))
        return kind, [at for at in cells if last <= at <= self._usable - 4]

    def _leaf_rows(self, page: int, content: bytes, cells: list[int]) -> Iterator[TableRow]:
        for at in cells:
            _, after = _varint(content, at)
            number, _ = _varint(content, after)
            yield TableRow(number, page, at)

    def _layout(self, row: TableRow, count: int) -> tuple[list[int], list[int]]:
        """Return the serial types of a row's values, and their bounds in its payload in bytes."""
        head = self._payload(row, 9)
        header, at = _varint(head, 0)
        if not at <= header <= 1 << 10:
            raise DamagedError("it has no header")
        head = self._payload(row, header)
        types, starts = [], [header]
        while at < header:
            type_, at = _varint(head, at)
            types.append(type_)
            starts.append(starts[-1] + _length(type_))
        if len(types) < count or starts[-1] != self._length_of(row):
            raise DamagedError("its values do not fill it")
        return types, starts

    def _length_of(self, row: TableRow) -> int:
        return _varint(self._page(row.page), row.offset)[0]

    def _payload(self, row: TableRow, wanted: int) -> bytes:
        """Return the first `wanted` bytes of a row's payload, from overflow pages, too."""
        content = self._page(row.page)
        length, at = _varint(content, row.offset)
        _, at = _varint(content, at)
        if length > self._size:
            raise DamagedError(f"it claims {length:,} bytes")
        here = self._local(length)
        if at + here > self._usable:
            raise DamagedError("it leaves its page")
        pieces = [content[at : at + here]]
        have = here
        page = _number(content, at + here) if here < length else 0
        wanted = min(wanted, length)
        while have < wanted:
            if not 0 < page <= self._count:
                raise DamagedError("a part of it is missing")
            content = self._page(page)
            pieces.append(content[4 : self._usable])
            have += self._usable - 4
            page = _number(content, 0)
        return b"".join(pieces)[:wanted]

    def _local(self, length: int) -> int:
        """Return how many bytes of a row's payload are on its own page."""
        if length <= self._usable - 35:
            return length
        least = (self._usable - 12) * 32 // 255 - 23
        fitting = least + (length - least) % (self._usable - 4)
        return fitting if fitting <= self._usable - 35 else least


def _number(content: bytes, at: int) -> int:
    return int.from_bytes(content[at : at + 4], "big")


def _varint(content: bytes, at: int) -> tuple[int, int]:
    """Return a number of 1 to 9 bytes (7 bits each, 8 of the ninth), and the offset after it."""
    value = 0
    for byte in content[at : at + 8]:
        at += 1
        value = value << 7 | byte & 0x7F
        if byte < 0x80:
            return value, at
    value = value << 8 | int.from_bytes(content[at : at + 1], "big")
    return (value - (1 << 64) if value >> 63 else value), at + 1


def _length(type_: int) -> int:
    """Return the size of a value of a serial type, in bytes."""
    if type_ >= 12:
        return (type_ - 12) // 2
    return _INTEGER_SIZES[type_] if 0 <= type_ <= 6 else 8 * (type_ == 7)


def _value(type_: int, content: bytes) -> Value:
    if type_ >= 12:
        return content
    if 0 < type_ <= 6:
        return int.from_bytes(content, "big", signed=True)
    return {8: 0, 9: 1}.get(type_)
