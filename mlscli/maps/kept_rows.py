"""Rows kept by cell: what an access costs depends on its cells, not on how many rows there are.

Points and patches are kept alike, as rows of 8-byte words; the first is the packed key of the cell.
A hash table tells where the strips stand that hold cells, and a strip where the rows of its cells
lie. The rows of a cell lie together, in a room for 1, 2, 4, 8, ... rows; a room that is left goes
to the next cell that needs one like it. So rows are found without a search, and replaced without
moving others.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from mlscli.maps.cells import CellSet
from mlscli.maps.rows import alike, copied, note_missing
from mlscli.maps.strips import IY_BITS, STRIP_BITS, STRIP_CELLS, Strips, holds
from mlscli.runtime.arrays import ZERO, Array, Int32, Int64, UInt64
from mlscli.runtime.kernels import inner, kernel

# An array that is too short becomes longer by this share: memory that was never used costs time.
_MORE = 8


class Kept(NamedTuple):
    """Rows by cell, with space for more.

    Attributes
    ----------
    table : int32 (2**k,)
        Which strip stands at each slot of the hash table; -1: none. At most half of them are taken.
    number : uint64 (S,)
        The numbers of the strips, as in `Strips`, in the order in which they came.
    runs : int32 (S, STRIP_CELLS, 2)
        Where the rows of each cell of each strip begin, and how many there are.
    rows : uint64 (R, words)
        All rows. The first word of a room that is vacant tells which one is the next like it.
    vacant : int64 (32,)
        The first vacant room for 2**k rows; -1: none.
    used : int64 (2,)
        How many of the strips, and of the rows, are in use or were.
    """

    table: Int32
    number: UInt64
    runs: Int32
    rows: UInt64
    vacant: Int64
    used: Int64


class KeptRows:
    """Rows by cell; the rows of one cell keep their order.

    Parameters
    ----------
    words : int
        How many words a row has.
    """

    def __init__(self, words: int) -> None:
        self._kept = Kept(
            np.full(2, -1, dtype=np.int32),
            np.empty(0, dtype=np.uint64),
            np.zeros((0, STRIP_CELLS, 2), dtype=np.int32),
            np.empty((0, words), dtype=np.uint64),
            np.full(32, -1, dtype=np.int64),
            np.zeros(2, dtype=np.int64),
        )

    def extract(self, cells: CellSet) -> UInt64:
        """Return the rows in `cells`, uint64 (N, words), ascending by cell."""
        rows: UInt64 = _extract(self._kept, *self._strips(cells))
        return rows

    def whole(self) -> UInt64:
        """Return all rows, uint64 (N, words), ascending by cell."""
        numbers = np.sort(self._listed)
        rows: UInt64 = _extract(self._kept, numbers, np.full_like(numbers, 2**STRIP_CELLS - 1))
        return rows

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
        self._make_room(*_to_come(new))
        differing: tuple[UInt64, UInt64] = _replace(self._kept, *strips, new, compare)
        return differing

    def _make_room(self, strips: int, rows: int) -> None:
        """Make room for so many more strips and rows."""
        table, number, runs, all_rows, _, used = self._kept
        listed, filled = used.tolist()
        if listed + strips > len(number):
            _lengthen(number, listed + strips)
            _lengthen(runs, listed + strips)
        if 2 * len(number) > len(table):
            table.resize(1 << (2 * len(number) - 1).bit_length(), refcheck=False)
            table[:] = -1
            _list_all(self._kept)
        if filled + rows > len(all_rows):
            _lengthen(all_rows, filled + rows)

    @property
    def _listed(self) -> UInt64:
        """The numbers of all strips that hold or held rows."""
        return self._kept.number[: self._kept.used[0]]

    def _strips(self, cells: CellSet, new: UInt64 | None = None) -> Strips:
        """Return a set as strips; where it has too many, only those with old or new rows."""
        # To choose among the strips with rows costs more: each of their cells is looked up.
        strips = cells.strips(most=STRIP_CELLS * int(self._kept.used[0]))
        if strips is None:
            listed = [self._listed]
            if new is not None:
                listed.append(new[:, 0] >> np.uint64(STRIP_BITS))
            strips = cells.strips_among(np.unique(np.concatenate(listed)))
        return strips


def _lengthen(array: Array, least: int) -> None:
    """Make an array longer, in place; what it gains is 0.

    The system moves the pages of a large array, and copies none.
    """
    # Nobody else refers to it: kernels return copies.
    array.resize((least + least // _MORE, *array.shape[1:]), refcheck=False)


@inner
def _slot(kept: Kept, strip: Any) -> int:
    """Return the slot of the hash table in which a strip stands, or the one for it."""
    x, y = strip >> np.uint64(IY_BITS), strip & np.uint64(2**IY_BITS - 1)
    mixed = x * np.uint64(2654435761) ^ y * np.uint64(2246822519)
    last = len(kept.table) - 1
    slot = np.int64((mixed ^ mixed >> np.uint64(15)) & np.uint64(last))
    while kept.table[slot] >= 0 and kept.number[kept.table[slot]] != strip:
        slot = (slot + 1) & last
    return slot  # type: ignore[return-value]


@kernel
def _list_all(kept: Kept) -> None:
    """Enter all strips into a table that is empty."""
    for strip in range(kept.used[0]):
        kept.table[_slot(kept, kept.number[strip])] = strip


@inner
def _run(kept: Kept, strip: int, cell: int) -> tuple[int, int]:
    """Return where the rows of a cell begin, and their number."""
    begin, size = kept.runs[strip, cell]
    return np.int64(begin), np.int64(size)  # type: ignore[return-value]


@inner
def _count(kept: Kept, strips: UInt64, bits: UInt64) -> int:
    """Return how many rows there are in a set of cells."""
    size = ZERO
    for s in range(len(strips)):
        strip = kept.table[_slot(kept, strips[s])]
        for cell in range(STRIP_CELLS if strip >= 0 else 0):
            if holds(bits[s], np.uint64(cell)):
                size += kept.runs[strip, cell, 1]
    return size


@kernel
def _extract(kept: Kept, strips: UInt64, bits: UInt64) -> UInt64:
    """Return the rows in a set of cells, given as `Strips` are, ascending by cell."""
    rows = np.empty((_count(kept, strips, bits), kept.rows.shape[1]), dtype=np.uint64)
    to = ZERO
    for s in range(len(strips)):
        strip = kept.table[_slot(kept, strips[s])]
        for cell in range(STRIP_CELLS if strip >= 0 else 0):
            if holds(bits[s], np.uint64(cell)):
                begin, size = _run(kept, strip, cell)
                to = copied(kept.rows, begin, size, rows, to)
    return rows


@inner
def _fold(size: int) -> int:
    """Return k for a room of 2**k rows that holds so many."""
    k = ZERO
    while 1 << k < size:
        k += 1
    return k


@kernel
def _to_come(new: UInt64) -> tuple[int, int]:
    """Return how many strips rows lie in, and how many rows their rooms hold together."""
    strips = rooms = first = ZERO
    for i in range(len(new)):
        if i + 1 == len(new) or new[i + 1, 0] != new[i, 0]:
            rooms += 1 << _fold(i + 1 - first)
            first = i + 1
        strips += i == 0 or new[i, 0] >> np.uint64(STRIP_BITS) != new[i - 1, 0] >> np.uint64(
            STRIP_BITS
        )
    return strips, rooms


@inner
def _other_room(kept: Kept, begin: int, size: int, more: int) -> int:
    """Return where `more` rows have room, instead of the room of `size` rows at `begin`."""
    if size > 0 and more > 0 and _fold(size) == _fold(more):
        return begin
    if size > 0:
        kept.rows[begin, 0] = np.uint64(kept.vacant[_fold(size)] + 1)
        kept.vacant[_fold(size)] = begin
    if more == 0:
        return ZERO
    room = kept.vacant[_fold(more)]
    if room >= 0:
        kept.vacant[_fold(more)] = np.int64(kept.rows[room, 0]) - 1
    else:
        room = kept.used[1]
        kept.used[1] += 1 << _fold(more)
    return room  # type: ignore[no-any-return]


@kernel
def _replace(
    kept: Kept, strips: UInt64, bits: UInt64, new: UInt64, compare: bool
) -> tuple[UInt64, UInt64]:
    """Replace the rows in a set of cells; see `KeptRows.update`.

    Parameters
    ----------
    kept : Kept
        With room for the new rows.
    strips, bits : uint64 (S,)
        The set, as in `Strips`.
    new : uint64 (N, words)
    compare : bool
        Whether old and new rows are compared. If not, the results are empty.

    Returns
    -------
    removed, added : uint64 (., words)
    """
    words = kept.rows.shape[1]
    removed = np.empty((_count(kept, strips, bits) if compare else ZERO, words), dtype=np.uint64)
    added = np.empty((len(new) if compare else ZERO, words), dtype=np.uint64)
    gone = came = first = ZERO
    for s in range(len(strips)):
        while first < len(new) and new[first, 0] >> np.uint64(STRIP_BITS) < strips[s]:
            first += 1
        last = first
        while last < len(new) and new[last, 0] >> np.uint64(STRIP_BITS) == strips[s]:
            last += 1
        slot = _slot(kept, strips[s])
        strip = kept.table[slot]
        if strip < 0:
            if first == last:
                continue
            strip = kept.used[0]
            kept.table[slot], kept.number[strip] = strip, strips[s]
            kept.used[0] += 1
        for cell in range(STRIP_CELLS):
            begin = first
            while first < last and new[first, 0] & np.uint64(STRIP_CELLS - 1) == np.uint64(cell):
                first += 1
            if not holds(bits[s], np.uint64(cell)):
                continue
            old, size = _run(kept, strip, cell)
            more = first - begin
            if alike(kept.rows, old, size, new, begin, more):
                continue
            if compare:
                gone = note_missing(kept.rows, old, size, new, begin, more, removed, gone)
                came = note_missing(new, begin, more, kept.rows, old, size, added, came)
            room = _other_room(kept, old, size, more)
            copied(new, begin, more, kept.rows, room)
            kept.runs[strip, cell, 0], kept.runs[strip, cell, 1] = room, more
    # Copies: they do not keep the room for all that could have differed.
    return removed[:gone].copy(), added[:came].copy()
