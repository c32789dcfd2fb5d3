"""A tile of rows: those of a square of cells.

It knows where the rows of each of its cells lie, so that rows are found without a search, and
replaced without moving others.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from mlscli.maps.rows import alike, copied, note_missing
from mlscli.maps.strips import IY_BITS, STRIP_BITS, STRIP_CELLS, Strips
from mlscli.runtime.arrays import ZERO, Array, Int64, UInt64
from mlscli.runtime.kernels import inner, kernel

Number = np.uint64

# A tile is 2**TILE_BITS cells wide, and TILE_STRIPS strips high: it is so small that to enlarge or
# to compact one costs little.
TILE_BITS = 6
TILE_STRIPS = 2 ** (TILE_BITS - STRIP_BITS)


class RowTile:
    """The rows of a square of cells.

    Attributes
    ----------
    number : int
        Number of the tile, from `tile_of`.
    place : int32 (2**TILE_BITS * TILE_STRIPS,)
        For each strip of the tile, by (ix, iy), its index in `runs`; -1: not listed.
    runs : int32 (., STRIP_CELLS, 2)
        For each cell of each listed strip, where its rows begin in `rows`, and their number.
    rows : uint64 (., words)
        The rows, and others that are no longer in use.
    used : int64 (3,)
        How many strips are listed; how many rows are filled; how many of these are in use.
    """

    def __init__(self, number: int, words: int) -> None:
        self.number = number
        self.place = np.full(2**TILE_BITS * TILE_STRIPS, -1, dtype=np.int32)
        self.runs = np.zeros((1, STRIP_CELLS, 2), dtype=np.int32)
        self.rows = np.empty((4, words), dtype=np.uint64)
        self.used = np.zeros(3, dtype=np.int64)

    @property
    def listed(self) -> int:
        """How many strips are listed."""
        return int(self.used[0])

    @property
    def empty(self) -> bool:
        """Whether no cell has a row."""
        return not self.used[2]

    def strips(self) -> UInt64:
        """Return the numbers of the strips that are listed."""
        numbers: UInt64 = _strips_in(self.number, self.place)
        return numbers

    def count(self, strips: Strips, counts: Int64) -> None:
        """Add the number of rows in each strip s of a set of cells to ``counts[s + 1]``."""
        _count(self.number, self.place, self.runs, *strips, counts)

    def fetch(self, strips: Strips, start: Int64, fetched: UInt64) -> None:
        """Copy the rows in a set of cells; those of strip s to ``fetched[start[s]:]``."""
        _fetch(self.number, self.place, self.runs, self.rows, *strips, start, fetched)

    def to_come(self, strips: Strips, start: Int64) -> tuple[int, int]:
        """Return how many strips and how many rows it may gain; arguments as for `replace`."""
        more: tuple[int, int] = _to_come(self.number, self.place, strips.number, start)
        return more

    def make_room(self, strips: int, rows: int) -> None:
        """Make room for `strips` more strips and `rows` more rows."""
        listed, filled, kept = self.used.tolist()
        if listed + strips > len(self.runs):
            runs = np.zeros((2 * (listed + strips), STRIP_CELLS, 2), dtype=np.int32)
            runs[:listed] = self.runs[:listed]
            self.runs = runs
        if filled + rows > len(self.rows):
            tidy = np.empty((2 * kept + rows, self.rows.shape[1]), dtype=np.uint64)
            _tidy_up(self.place, self.runs, self.rows, tidy)
            self.rows = tidy
            self.used[1] = kept

    def replace(
        self, strips: Strips, new: UInt64, start: Int64, to_come: int, compare: bool
    ) -> tuple[UInt64, UInt64]:
        """Replace the rows in a set of cells.

        Parameters
        ----------
        strips : Strips
            The cells; those of other tiles are passed over.
        new : uint64 (N, words)
            The new rows, ascending by cell; those in no cell of the set are passed over.
        start : int64 (S, 2)
            Where the new rows of each strip begin and end.
        to_come : int
            How many rows it may gain, from `RowTile.to_come`; `make_room` has made room for them.
        compare : bool
            Whether old and new rows are compared. If not, the results are empty.

        Returns
        -------
        removed, added : uint64 (., words)
            Rows that a cell had only before, and rows that it has only now; ascending by cell.
        """
        differing: tuple[UInt64, UInt64] = _update(
            self.number, self.place, self.runs, self.rows, self.used,
            *strips, new, start, to_come, compare,
        )  # fmt: skip
        return differing


@inner
def _run(runs: Array, strip: int, cell: int) -> tuple[int, int]:
    """Return where the rows of a cell begin, and their number."""
    return np.int64(runs[strip, cell, 0]), np.int64(runs[strip, cell, 1])  # type: ignore[return-value]


@inner
def tile_of(strip: Any) -> Any:
    """Return the number of the tile in which a strip lies: x in the upper 32 bits, y below."""
    x, y = strip >> np.uint64(IY_BITS), strip & np.uint64(2**IY_BITS - 1)
    return x >> np.uint64(TILE_BITS) << np.uint64(32) | y >> np.uint64(TILE_BITS - STRIP_BITS)


@inner
def _place_of(strip: Number) -> Any:
    """Return the index of a strip in `RowTile.place`."""
    x, y = strip >> np.uint64(IY_BITS), strip & np.uint64(2**IY_BITS - 1)
    return np.int64(
        (x & np.uint64(2**TILE_BITS - 1)) * np.uint64(TILE_STRIPS)
        + (y & np.uint64(TILE_STRIPS - 1))
    )


@kernel
def _strips_in(number: int, place: Array) -> UInt64:
    """Return the numbers of the strips that a tile lists."""
    numbers = np.empty(len(place), dtype=np.uint64)
    size = 0
    for at in range(len(place)):
        if place[at] >= 0:
            x = (number >> 32 << TILE_BITS) + at // TILE_STRIPS
            y = ((number & 0xFFFFFFFF) << (TILE_BITS - STRIP_BITS)) + at % TILE_STRIPS
            numbers[size] = np.uint64(x) << np.uint64(IY_BITS) | np.uint64(y)
            size += 1
    return numbers[:size]


@inner
def _has(bits: Number, cell: int) -> bool:
    return bool(bits >> np.uint64(cell) & np.uint64(1) == 1)


@kernel
def _count(
    number: int, place: Array, runs: Array, strips: UInt64, bits: UInt64, counts: Int64
) -> None:
    """Add the number of rows that a tile has in each strip s of a set to ``counts[s + 1]``.

    Parameters
    ----------
    number : int
    place, runs : int32
        As in `RowTile`.
    strips, bits : uint64 (S,)
        The set, as in `Strips`; strips of other tiles are passed over.
    counts : int64 (S + 1,)
    """
    for s in range(len(strips)):
        if tile_of(strips[s]) == np.uint64(number):
            at = place[_place_of(strips[s])]
            if at >= 0:
                for cell in range(STRIP_CELLS):
                    if _has(bits[s], cell):
                        counts[s + 1] += runs[at, cell, 1]


@kernel
def summed(counts: Int64) -> Any:
    """Replace counts by their cumulative sums, and return the total."""
    for i in range(1, len(counts)):
        counts[i] += counts[i - 1]
    return counts[-1]


@kernel
def _fetch(
    number: int,
    place: Array,
    runs: Array,
    rows: UInt64,
    strips: UInt64,
    bits: UInt64,
    start: Int64,
    fetched: UInt64,
) -> None:
    """Copy the rows that a tile has in a set of cells.

    Parameters
    ----------
    number : int
    place, runs : int32
    rows : uint64 (., words)
        As in `RowTile`.
    strips, bits : uint64 (S,)
        The set, as in `Strips`; strips of other tiles are passed over.
    start : int64 (S + 1,)
        Where in `fetched` the rows of each strip begin, and the end of the last.
    fetched : uint64 (N, words)
        Receives the rows.
    """
    for s in range(len(strips)):
        if start[s] < start[s + 1] and tile_of(strips[s]) == np.uint64(number):
            at, to = place[_place_of(strips[s])], start[s]
            for cell in range(STRIP_CELLS):
                if _has(bits[s], cell):
                    begin, size = _run(runs, at, cell)
                    to = copied(rows, begin, size, fetched, to)


@kernel
def _tidy_up(place: Array, runs: Array, rows: UInt64, tidy: UInt64) -> None:
    """Copy the rows of a tile that are in use into `tidy`, in the order of their cells."""
    to = ZERO
    for at in place:
        if at >= 0:
            for cell in range(STRIP_CELLS):
                begin, size = _run(runs, at, cell)
                runs[at, cell, 0] = to
                to = copied(rows, begin, size, tidy, to)


@kernel
def _to_come(number: int, place: Array, strips: UInt64, start: Int64) -> tuple[int, int]:
    """Return how many strips and how many rows a tile may gain; see `RowTile.to_come`."""
    unlisted = rows = 0
    for s in range(len(strips)):
        if start[s, 0] < start[s, 1] and tile_of(strips[s]) == np.uint64(number):
            unlisted += place[_place_of(strips[s])] < 0
            rows += start[s, 1] - start[s, 0]
    return unlisted, rows


@kernel
def _update(
    number: int,
    place: Array,
    runs: Array,
    rows: UInt64,
    used: Int64,
    strips: UInt64,
    bits: UInt64,
    new: UInt64,
    start: Int64,
    to_come: int,
    compare: bool,
) -> tuple[UInt64, UInt64]:
    """Replace the rows that a tile has in a set of cells; see `RowTile.replace`.

    Parameters
    ----------
    number : int
    place, runs : int32
    rows : uint64 (., words)
    used : int64 (3,)
        As in `RowTile`.
    strips, bits : uint64 (S,)
        The set, as in `Strips`; strips of other tiles are passed over.
    new : uint64 (N, words)
    start : int64 (S, 2)
    to_come : int
    compare : bool
        As for `RowTile.replace`.

    Returns
    -------
    removed, added : uint64 (., words)
    """
    counts = np.zeros(len(strips) + 1, dtype=np.int64)
    if compare:
        _count(number, place, runs, strips, bits, counts)
    removed = np.empty((summed(counts), rows.shape[1]), dtype=np.uint64)
    added = np.empty((to_come if compare else 0, rows.shape[1]), dtype=np.uint64)
    gone = came = ZERO
    for s in range(len(strips)):
        if tile_of(strips[s]) != np.uint64(number):
            continue
        at, first, last = place[_place_of(strips[s])], start[s, 0], start[s, 1]
        if at < 0:
            if first == last:
                continue
            at = used[0]
            place[_place_of(strips[s])] = at
            used[0] += 1
        for cell in range(STRIP_CELLS):
            begin = first
            while first < last and new[first, 0] & np.uint64(STRIP_CELLS - 1) == np.uint64(cell):
                first += 1
            if not _has(bits[s], cell):
                continue
            old, size = _run(runs, at, cell)
            more = first - begin
            if alike(rows, old, size, new, begin, more):
                continue
            if compare:
                gone = note_missing(rows, old, size, new, begin, more, removed, gone)
                came = note_missing(new, begin, more, rows, old, size, added, came)
            if more > size:
                old = used[1]
                used[1] += more
            copied(new, begin, more, rows, old)
            runs[at, cell, 0], runs[at, cell, 1] = old, more
            used[2] += more - size
    # Copies: they do not keep the room for all that could have differed.
    return removed[:gone].copy(), added[:came].copy()
