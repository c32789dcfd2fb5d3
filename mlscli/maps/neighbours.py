"""Cells that share an edge or a line of the grid."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mlscli.runtime.arrays import Int32, Int64
from mlscli.runtime.kernels import inner, kernel

Index = int | np.int64

# Up to this many rows per cell, and some, a table of all rows is worth its memory.
_DENSE, _FEW_ROWS = 4, 256


@kernel
def shifted(ix: Int32, iy: Int32, dx: int, dy: int) -> Int64:
    """Return for each cell the number of the cell at (ix + dx, iy + dy), int64 (C,); -1: none.

    Cells ascend by (ix, iy), and so do those looked for: one pass over both finds them.
    """
    found = np.full(len(ix), -1, dtype=np.int64)
    there = 0
    for cell in range(len(ix)):
        x, y = np.int64(ix[cell]) + dx, np.int64(iy[cell]) + dy
        there = onward(ix, iy, there, x, y)
        if is_at(ix, iy, there, x, y):
            found[cell] = there
    return found


@inner
def is_at(ix: Int32, iy: Int32, cell: int, x: Index, y: Index) -> bool:
    """Return whether the cell with a number, which need not exist, is the one at (x, y)."""
    # Each `and` between comparisons would be a branch.
    return bool((cell >= 0) & (cell < len(ix)) and (ix[cell] == x) & (iy[cell] == y))


@inner
def onward(ix: Int32, iy: Int32, cell: int, x: Index, y: Index) -> int:
    """Return the first cell from `cell` on that does not come before (x, y); cells may repeat."""
    while cell < len(ix) and (ix[cell] < x or (ix[cell] == x and iy[cell] < y)):
        cell += 1
    return cell


@inner
def sought(ix: Int32, iy: Int32, cell: int, x: Index, y: Index) -> int:
    """Return the first cell that does not come before (x, y), from `cell` on; -1: of all."""
    if cell >= 0:
        return onward(ix, iy, cell, x, y)
    begin, end = 0, len(ix)
    while begin < end:
        middle = (begin + end) // 2
        if ix[middle] < x or (ix[middle] == x and iy[middle] < y):
            begin = middle + 1
        else:
            end = middle
    return begin


@inner
def beside(ix: Int32, iy: Int32) -> Int64:
    """Return the numbers of the cells at -x, +x, -y, +y of each, int64 (C, 4); -1: none."""
    four = np.empty((len(ix), 4), dtype=np.int64)
    for side in range(4):
        found = shifted(ix, iy, (side == 1) - (side == 0), (side == 3) - (side == 2))
        for cell in range(len(ix)):
            four[cell, side] = found[cell]
    return four


def links(ix: Int32, iy: Int32) -> Sequence[Int32]:
    """Return for each cell the next of its column, the one before, and both of its row; -1: none.

    Parameters
    ----------
    ix, iy : int32 (C,)
        The cells, ascending by (ix, iy).

    Returns
    -------
    four int32 (C,)
        The numbers of the cells at greater and at less iy, at greater and at less ix.
    """
    found: Sequence[Int32] = _links(ix, iy)
    if len(found[0]) < len(ix):
        # Far apart: only the rows that hold cells are numbered.
        found = _links(ix, np.unique(iy, return_inverse=True)[1].astype(np.int32))
    return found


@kernel
def _links(ix: Int32, iy: Int32) -> tuple[Int32, Int32, Int32, Int32]:
    """Return what `links` does; nothing where rows lie too far apart for a table of all."""
    least = greatest = iy[0] if len(iy) else np.int32(0)
    for row in iy:
        least, greatest = min(least, row), max(greatest, row)
    rows = np.int64(greatest) - least + 1
    size = len(ix) if rows <= _DENSE * len(ix) + _FEW_ROWS else 0
    # Only in maps of 100 GB does the number of a cell need more than 4 bytes.
    last = np.full(rows if size else 0, -1, dtype=np.int32)
    after, before = np.full(size, -1, dtype=np.int32), np.full(size, -1, dtype=np.int32)
    after_in_row, before_in_row = np.full(size, -1, dtype=np.int32), np.empty(size, dtype=np.int32)
    for cell in range(size):
        if cell > 0 and ix[cell] == ix[cell - 1]:
            before[cell], after[cell - 1] = cell - 1, cell
        row = np.int64(iy[cell]) - least
        before_in_row[cell] = last[row]
        if last[row] >= 0:
            after_in_row[last[row]] = cell
        last[row] = cell
    return after, before, after_in_row, before_in_row
