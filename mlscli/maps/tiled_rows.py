"""Rows kept in tiles: what an access costs depends on its cells, not on how many rows there are.

Points and patches are kept alike, as rows of 8-byte words; the first is the packed key of the cell.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import reduce

import numpy as np

from mlscli.maps.cells import CellSet
from mlscli.maps.patches import runs
from mlscli.maps.row_tile import TILE_STRIPS, RowTile, summed, tile_of
from mlscli.maps.rows import merged, starts
from mlscli.maps.strips import STRIP_BITS, STRIP_CELLS, Strips
from mlscli.runtime.arrays import Int64, UInt64
from mlscli.runtime.kernels import kernel

# From this many tiles on, strips are divided among them, and their rows sorted instead of merged.
_MANY_TILES = 8


class TiledRows:
    """Rows by cell; the rows of one cell keep their order.

    A call touches only the tiles in which its cells lie.

    Parameters
    ----------
    words : int
        How many words a row has.
    """

    def __init__(self, words: int) -> None:
        self._words = words
        self._tiles: dict[int, RowTile] = {}
        # How many strips the tiles list.
        self._there = 0

    def extract(self, cells: CellSet) -> UInt64:
        """Return the rows in `cells`, uint64 (N, words), ascending by cell."""
        return self._rows(self._strips(cells))

    def put(self, cells: CellSet, new: UInt64) -> None:
        """Replace the rows in `cells` by those of `new` that lie in them; see `update`."""
        self._replace(cells, new, compare=False)

    def update(self, cells: CellSet, new: UInt64) -> tuple[UInt64, UInt64]:
        """Replace the rows in `cells` by those of `new` that lie in them; return what differs.

        Each new row of a cell is compared with all its old ones: cells should have few.

        Parameters
        ----------
        cells : CellSet
        new : uint64 (N, words)
            Ascending by cell.

        Returns
        -------
        removed, added : uint64 (., words)
            Rows that a cell had only before, and rows that it has only now; ascending by cell.
        """
        return self._replace(cells, new, compare=True)

    def _replace(self, cells: CellSet, new: UInt64, compare: bool) -> tuple[UInt64, UInt64]:
        strips = self._strips(cells, new)
        start = starts(new, strips.number)
        removed, added = [], []
        for number, own in _by_tile(strips):
            tile = self._tiles.get(number) or RowTile(number, self._words)
            mine, its_new = _take(strips, own), start if own is None else start[own]
            unlisted, to_come = tile.to_come(mine, its_new)
            if tile.empty and not to_come:
                continue
            self._tiles[number] = tile
            self._there -= tile.listed
            tile.make_room(unlisted, to_come)
            gone, came = tile.replace(mine, new, its_new, to_come, compare)
            removed.append(gone)
            added.append(came)
            if tile.empty:
                del self._tiles[number]
            else:
                self._there += tile.listed
        return self._together(removed), self._together(added)

    def whole(self) -> UInt64:
        """Return all rows, uint64 (N, words), ascending by cell."""
        numbers = self._listed()
        return self._rows(Strips(numbers, np.full_like(numbers, 2**STRIP_CELLS - 1)))

    def _rows(self, strips: Strips) -> UInt64:
        """Return the rows in a set of cells, ascending by cell."""
        there = [(self._tiles[n], own) for n, own in _by_tile(strips) if n in self._tiles]
        if len(there) < _MANY_TILES:
            return self._fetched([tile for tile, _ in there], strips)
        return self._together([self._fetched([tile], _take(strips, own)) for tile, own in there])

    def _fetched(self, tiles: list[RowTile], strips: Strips) -> UInt64:
        start = np.zeros(len(strips.number) + 1, dtype=np.int64)
        for tile in tiles:
            tile.count(strips, start)
        rows = np.empty((summed(start), self._words), dtype=np.uint64)
        for tile in tiles:
            tile.fetch(strips, start, rows)
        return rows

    def _strips(self, cells: CellSet, new: UInt64 | None = None) -> Strips:
        """Return a set as strips; where it has too many, only those with old or new rows."""
        # To choose among the strips with rows costs more: each of their cells is looked up.
        strips = cells.strips(most=STRIP_CELLS * self._there)
        if strips is None:
            listed = [self._listed()]
            if new is not None:
                listed.append(new[:, 0] >> np.uint64(STRIP_BITS))
            strips = cells.strips_among(np.unique(np.concatenate(listed)))
        return strips

    def _listed(self) -> UInt64:
        """Return the numbers of all strips that tiles list, ascending."""
        numbers = [np.empty(0, dtype=np.uint64)]
        numbers += [tile.strips() for tile in self._tiles.values()]
        return np.sort(np.concatenate(numbers))

    def _together(self, parts: list[UInt64]) -> UInt64:
        if len(parts) < _MANY_TILES:
            return reduce(merged, parts) if parts else np.empty((0, self._words), dtype=np.uint64)
        rows = np.concatenate(parts)
        return rows[np.argsort(rows[:, 0], kind="stable")]


def _take(strips: Strips, own: Int64 | None) -> Strips:
    return strips if own is None else Strips(strips.number[own], strips.bits[own])


def _by_tile(strips: Strips) -> Iterator[tuple[int, Int64 | None]]:
    """Yield the number of each tile in which strips lie, and the indices of its strips.

    Where tiles are few the indices are None: each tile is given all strips, as it costs less to
    pass over those of others.
    """
    numbers = dict.fromkeys(_tiles_of(strips.number).tolist())
    if len(numbers) < _MANY_TILES:
        yield from numbers.items()
        return
    tiles = tile_of(strips.number)
    order = np.argsort(tiles, kind="stable")
    start = runs(tiles[order])
    yield from zip(tiles[order[start[:-1]]].tolist(), np.split(order, start[1:-1]), strict=True)


@kernel
def _tiles_of(strips: UInt64) -> UInt64:
    numbers = np.empty_like(strips)
    size = 0
    for strip in strips:
        number = tile_of(strip)
        # Most strips lie in a recent tile; the caller removes the duplicates that are left.
        known = False
        for other in numbers[max(0, size - TILE_STRIPS - 2) : size]:
            known |= other == number
        if not known:
            numbers[size] = number
            size += 1
    return numbers[:size]
