"""What grows, kept in tiles, so that an area costs what the area costs.

Points and patches are kept alike: as rows of 8-byte words, of which the first is the packed key of
the cell. A tile knows where the rows of each of its cells lie, so that they are found without a
search, and replaced without moving others. It has 64 x 64 cells, and no more: what a tile costs
that has to grow, or is tidied up, is a small and bounded part of what a map costs.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import reduce
from typing import Any

import numpy as np

from mlscli.cells import CellSet
from mlscli.kernels import inner, kernel
from mlscli.patches import runs
from mlscli.rows import alike, copied, merged, note_missing, starts
from mlscli.strips import SHIFT, SIDE, WIDTH, Strips
from mlscli.typing import ZERO, Array, Int64, UInt64

Number = np.uint64

# A tile is 2**6 cells wide, and so many strips high.
TILE = 6
_HIGH = 2 ** (TILE - SHIFT)

# What so many tiles hold is sorted, not merged one by one.
_MANY = 8


class Tile:
    """The rows of a square of cells.

    Attributes
    ----------
    number : int
        Which square.
    place : int32 (strips,)
        By (ix, iy): where in `runs` the cells of a strip are listed; -1: nowhere.
    runs : int32 (., SIDE, 2)
        Where the rows of each cell begin, and how many they are.
    rows : uint64 (., words)
    used : int64 (3,)
        How many strips are listed; how far `rows` is filled; how much of that is in use.
    """

    def __init__(self, number: int, words: int) -> None:
        self.number = number
        self.place = np.full(2**TILE * _HIGH, -1, dtype=np.int32)
        self.runs = np.zeros((1, SIDE, 2), dtype=np.int32)
        self.rows = np.empty((4, words), dtype=np.uint64)
        self.used = np.zeros(3, dtype=np.int64)

    @property
    def listed(self) -> int:
        """How many strips are listed."""
        return int(self.used[0])

    def make_room(self, strips: int, rows: int) -> None:
        """See that there is room for more strips and rows."""
        listed, filled, kept = self.used.tolist()
        if listed + strips > len(self.runs):
            runs = np.zeros((2 * (listed + strips), SIDE, 2), dtype=np.int32)
            runs[:listed] = self.runs[:listed]
            self.runs = runs
        if filled + rows > len(self.rows):
            tidy = np.empty((2 * kept + rows, self.rows.shape[1]), dtype=np.uint64)
            _tidy_up(self.place, self.runs, self.rows, tidy)
            self.rows = tidy
            self.used[1] = kept


class Tiles:
    """Rows by cell; those of one cell stay in their order.

    No call touches more tiles than it names cells in.

    Parameters
    ----------
    words : int
        The length of a row.
    """

    def __init__(self, words: int) -> None:
        self._words = words
        self._tiles: dict[int, Tile] = {}
        # How many strips these list.
        self._there = 0

    def extract(self, cells: CellSet) -> UInt64:
        """Return the rows in `cells`, ascending by cell."""
        return self._rows(self._strips(cells))

    def put(self, cells: CellSet, new: UInt64) -> None:
        """Replace the rows in `cells` by those of `new` that lie in them; see `update`."""
        self._replace(cells, new, told=False)

    def update(self, cells: CellSet, new: UInt64) -> tuple[UInt64, UInt64]:
        """Replace the rows in `cells` by those of `new` that lie in them, and tell what differs.

        Each row of a cell is compared with all that it had: cells should have few.

        Parameters
        ----------
        cells : CellSet
        new : uint64 (N, words)
            Ascending by cell.

        Returns
        -------
        removed, added : uint64 (., words)
            Rows that a cell had and has no more, and rows that it has only now; ascending by cell.
        """
        return self._replace(cells, new, told=True)

    def _replace(self, cells: CellSet, new: UInt64, told: bool) -> tuple[UInt64, UInt64]:
        strips = self._strips(cells, new)
        start = starts(new, strips.number)
        removed, added = [], []
        for number, own in _by_tile(strips):
            there = number in self._tiles
            tile = self._tiles[number] if there else Tile(number, self._words)
            mine, bits, its_new = strips.number[own], strips.bits[own], start[own]
            unlisted, to_come = _to_come(number, tile.place, mine, its_new)
            if not there and not to_come:
                continue
            self._tiles[number] = tile
            self._there -= tile.listed
            tile.make_room(unlisted, to_come)
            gone, came = _update(
                number, tile.place, tile.runs, tile.rows, tile.used,
                mine, bits, new, its_new, to_come, told,
            )  # fmt: skip
            removed.append(gone)
            added.append(came)
            if tile.used[2]:
                self._there += tile.listed
            else:
                del self._tiles[number]
        return self._together(removed), self._together(added)

    def tiles(self) -> Iterable[Tile]:
        """Return the tiles in which there are rows."""
        return self._tiles.values()

    def whole(self) -> UInt64:
        """Return all rows, ascending by cell."""
        numbers = self._listed()
        return self._rows(Strips(numbers, np.full_like(numbers, 2**SIDE - 1)))

    def _rows(self, strips: Strips) -> UInt64:
        """Return the rows in a set of cells, ascending by cell."""
        there = [(self._tiles[n], own) for n, own in _by_tile(strips) if n in self._tiles]
        if len(there) < _MANY:
            return self._fetched([tile for tile, _ in there], strips)
        parts = (Strips(strips.number[own], strips.bits[own]) for _, own in there)
        tiles = ([tile] for tile, _ in there)
        return self._together([*map(self._fetched, tiles, parts)])

    def _fetched(self, tiles: list[Tile], strips: Strips) -> UInt64:
        start = np.zeros(len(strips.number) + 1, dtype=np.int64)
        for tile in tiles:
            _count(tile.number, tile.place, tile.runs, *strips, start)
        rows = np.empty((_summed(start), self._words), dtype=np.uint64)
        for tile in tiles:
            _fetch(tile.number, tile.place, tile.runs, tile.rows, *strips, start, rows)
        return rows

    def _strips(self, cells: CellSet, new: UInt64 | None = None) -> Strips:
        """Return a set by strips, if only by those that there are where these are the fewer."""
        # To go through those that there are costs more, cell by cell.
        strips = cells.strips(most=SIDE * self._there)
        if strips is None:
            listed = [self._listed()]
            if new is not None:
                listed.append(new[:, 0] >> np.uint64(SHIFT))
            strips = cells.strips_among(np.unique(np.concatenate(listed)))
        return strips

    def _listed(self) -> UInt64:
        """Return the numbers of all strips in which there can be rows, ascending."""
        numbers = [np.empty(0, dtype=np.uint64)]
        numbers += [_strips_in(tile.number, tile.place) for tile in self._tiles.values()]
        return np.sort(np.concatenate(numbers))

    def _together(self, parts: list[UInt64]) -> UInt64:
        if len(parts) < _MANY:
            return reduce(merged, parts) if parts else np.empty((0, self._words), dtype=np.uint64)
        rows = np.concatenate(parts)
        return rows[np.argsort(rows[:, 0], kind="stable")]


def _by_tile(strips: Strips) -> Iterator[tuple[int, slice | Int64]]:
    """Yield the numbers of the tiles in which strips lie, and where theirs are among these.

    Where tiles are few they are told of all: it costs them less to pass over those of others.
    """
    numbers = dict.fromkeys(_tiles_of(strips.number).tolist())
    if len(numbers) < _MANY:
        yield from dict.fromkeys(numbers, slice(None)).items()
        return
    tiles = strips.number >> np.uint64(WIDTH + TILE) << np.uint64(32)
    tiles |= (strips.number & np.uint64(2**WIDTH - 1)) >> np.uint64(TILE - SHIFT)
    order = np.argsort(tiles, kind="stable")
    start = runs(tiles[order])
    yield from zip(tiles[order[start[:-1]]].tolist(), np.split(order, start[1:-1]), strict=True)


@inner
def _run(runs: Array, strip: int, cell: int) -> tuple[int, int]:
    """Return where the rows of a cell begin, and how many they are."""
    return np.int64(runs[strip, cell, 0]), np.int64(runs[strip, cell, 1])  # type: ignore[return-value]


@inner
def _tile_of(strip: Number) -> Number:
    """Return the number of the tile in which a strip lies: 32 bits for x, the others for y."""
    x, y = strip >> np.uint64(WIDTH), strip & np.uint64(2**WIDTH - 1)
    return x >> np.uint64(TILE) << np.uint64(32) | y >> np.uint64(TILE - SHIFT)


@inner
def _place_of(strip: Number) -> Any:
    """Return which of its tile's strips a strip is."""
    x, y = strip >> np.uint64(WIDTH), strip & np.uint64(2**WIDTH - 1)
    return np.int64((x & np.uint64(2**TILE - 1)) * np.uint64(_HIGH) + (y & np.uint64(_HIGH - 1)))


@kernel
def _tiles_of(strips: UInt64) -> UInt64:
    numbers = np.empty_like(strips)
    size = 0
    for strip in strips:
        number = _tile_of(strip)
        # Most strips lie in a tile of one of those before.
        known = False
        for other in numbers[max(0, size - _HIGH - 2) : size]:
            known |= other == number
        if not known:
            numbers[size] = number
            size += 1
    return numbers[:size]


@kernel
def _strips_in(number: int, place: Array) -> UInt64:
    """Return the numbers of the strips that a tile lists."""
    numbers = np.empty(len(place), dtype=np.uint64)
    size = 0
    for at in range(len(place)):
        if place[at] >= 0:
            x = (number >> 32 << TILE) + at // _HIGH
            y = ((number & 0xFFFFFFFF) << (TILE - SHIFT)) + at % _HIGH
            numbers[size] = np.uint64(x) << np.uint64(WIDTH) | np.uint64(y)
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
        if _tile_of(strips[s]) == np.uint64(number):
            at = place[_place_of(strips[s])]
            if at >= 0:
                for cell in range(SIDE):
                    if _has(bits[s], cell):
                        counts[s + 1] += runs[at, cell, 1]


@kernel
def _summed(counts: Int64) -> Any:
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
        if start[s] < start[s + 1] and _tile_of(strips[s]) == np.uint64(number):
            at, to = place[_place_of(strips[s])], start[s]
            for cell in range(SIDE):
                if _has(bits[s], cell):
                    begin, size = _run(runs, at, cell)
                    to = copied(rows, begin, size, fetched, to)


@kernel
def _tidy_up(place: Array, runs: Array, rows: UInt64, tidy: UInt64) -> None:
    """Move the rows of a tile to where there is room for more, in the order of their cells."""
    to = ZERO
    for at in place:
        if at >= 0:
            for cell in range(SIDE):
                begin, size = _run(runs, at, cell)
                runs[at, cell, 0] = to
                to = copied(rows, begin, size, tidy, to)


@kernel
def _to_come(number: int, place: Array, strips: UInt64, start: Int64) -> tuple[int, int]:
    """Return how many strips that it does not list, and how many rows, a tile may be given."""
    unlisted = rows = 0
    for s in range(len(strips)):
        if start[s, 0] < start[s, 1] and _tile_of(strips[s]) == np.uint64(number):
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
    told: bool,
) -> tuple[UInt64, UInt64]:
    """Replace the rows that a tile has in the cells of a set; tell which went and which came."""
    counts = np.zeros(len(strips) + 1, dtype=np.int64)
    if told:
        _count(number, place, runs, strips, bits, counts)
    removed = np.empty((_summed(counts), rows.shape[1]), dtype=np.uint64)
    added = np.empty((to_come if told else 0, rows.shape[1]), dtype=np.uint64)
    gone = came = ZERO
    for s in range(len(strips)):
        if _tile_of(strips[s]) != np.uint64(number):
            continue
        at, first, last = place[_place_of(strips[s])], start[s, 0], start[s, 1]
        if at < 0:
            if first == last:
                continue
            at = used[0]
            place[_place_of(strips[s])] = at
            used[0] += 1
        for cell in range(SIDE):
            begin = first
            while first < last and new[first, 0] & np.uint64(SIDE - 1) == np.uint64(cell):
                first += 1
            if not _has(bits[s], cell):
                continue
            old, size = _run(runs, at, cell)
            more = first - begin
            if alike(rows, old, size, new, begin, more):
                continue
            if told:
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
