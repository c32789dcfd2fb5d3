"""A tile of what grows: the rows of a square of cells.

It knows where the rows of each of its cells lie, so that they are found without a search, and
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

# A tile is 2**6 cells wide, and so many strips high: what it costs to let one grow, or to tidy it
# up, is a small and bounded part of what a map costs.
TILE_BITS = 6
TILE_STRIPS = 2 ** (TILE_BITS - STRIP_BITS)


class RowTile:
    """The rows of a square of cells.

    Attributes
    ----------
    number : int
        Which square.
    place : int32 (strips,)
        By (ix, iy): where in `runs` the cells of a strip are listed; -1: nowhere.
    runs : int32 (., STRIP_CELLS, 2)
        Where the rows of each cell begin, and how many they are.
    rows : uint64 (., words)
    used : int64 (3,)
        How many strips are listed; how far `rows` is filled; how much of that is in use.
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
        """Count the rows that it has in each strip of a set, at the number of the next."""
        _count(self.number, self.place, self.runs, *strips, counts)

    def fetch(self, strips: Strips, start: Int64, fetched: UInt64) -> None:
        """Copy the rows that it has in the strips of a set to where those of each begin."""
        _fetch(self.number, self.place, self.runs, self.rows, *strips, start, fetched)

    def to_come(self, strips: Strips, start: Int64) -> tuple[int, int]:
        """Return how many strips that it does not list, and how many rows, it may be given."""
        more: tuple[int, int] = _to_come(self.number, self.place, strips.number, start)
        return more

    def make_room(self, strips: int, rows: int) -> None:
        """See that there is room for more strips and rows."""
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
        """Replace the rows in the cells of a set; tell which went and which came.

        Parameters
        ----------
        strips : Strips
        new : uint64 (N, words)
            Ascending by cell.
        start : int64 (S, 2)
            From where to where those of each strip lie among them.
        to_come : int
            How many of them can be its own; there is room for them.
        compare : bool
            Whether it is compare what differs.
        """
        differing: tuple[UInt64, UInt64] = _update(
            self.number, self.place, self.runs, self.rows, self.used,
            *strips, new, start, to_come, compare,
        )  # fmt: skip
        return differing


@inner
def _run(runs: Array, strip: int, cell: int) -> tuple[int, int]:
    """Return where the rows of a cell begin, and how many they are."""
    return np.int64(runs[strip, cell, 0]), np.int64(runs[strip, cell, 1])  # type: ignore[return-value]


@inner
def tile_of(strip: Any) -> Any:
    """Return the number of the tile in which a strip lies: 32 bits for x, the others for y."""
    x, y = strip >> np.uint64(IY_BITS), strip & np.uint64(2**IY_BITS - 1)
    return x >> np.uint64(TILE_BITS) << np.uint64(32) | y >> np.uint64(TILE_BITS - STRIP_BITS)


@inner
def _place_of(strip: Number) -> Any:
    """Return which of its tile's strips a strip is."""
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
    """Count the rows that a tile has in each strip of a set, at the number of the next."""
    for s in range(len(strips)):
        if tile_of(strips[s]) == np.uint64(number):
            at = place[_place_of(strips[s])]
            if at >= 0:
                for cell in range(STRIP_CELLS):
                    if _has(bits[s], cell):
                        counts[s + 1] += runs[at, cell, 1]


@kernel
def summed(counts: Int64) -> Any:
    """Sum up counts in place, and return the sum of all."""
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
    """Copy the rows that a tile has in the strips of a set to where those of each begin."""
    for s in range(len(strips)):
        if start[s] < start[s + 1] and tile_of(strips[s]) == np.uint64(number):
            at, to = place[_place_of(strips[s])], start[s]
            for cell in range(STRIP_CELLS):
                if _has(bits[s], cell):
                    begin, size = _run(runs, at, cell)
                    to = copied(rows, begin, size, fetched, to)


@kernel
def _tidy_up(place: Array, runs: Array, rows: UInt64, tidy: UInt64) -> None:
    """Move the rows of a tile to where there is room for more, in the order of their cells."""
    to = ZERO
    for at in place:
        if at >= 0:
            for cell in range(STRIP_CELLS):
                begin, size = _run(runs, at, cell)
                runs[at, cell, 0] = to
                to = copied(rows, begin, size, tidy, to)


@kernel
def _to_come(number: int, place: Array, strips: UInt64, start: Int64) -> tuple[int, int]:
    """Return how many strips that it does not list, and how many rows, a tile may be given."""
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
    """Replace the rows that a tile has in the cells of a set; tell which went and which came."""
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
    # Whoever keeps what differs keeps no room for what could have.
    return removed[:gone].copy(), added[:came].copy()
