"""Cells that share an edge or a line of the grid."""

from __future__ import annotations

import numpy as np

from mlscli.runtime.arrays import ZERO, Int32, Int64
from mlscli.runtime.kernels import inner, kernel

Index = int | np.int64

# Up to this many lines per cell, a table of all lines is worth its memory.
_DENSE = 4


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


def links(line: Int32) -> tuple[Int32, Int32]:
    """Return for each cell the next one of its line and the one before, int32 (C,); -1: none.

    Parameters
    ----------
    line : int32 (C,)
        The line of the grid in which each cell lies: its `ix` or its `iy`. The cells of a line are
        in order.
    """
    least, greatest = _ends(line)
    if greatest - least > _DENSE * len(line):
        # Far apart: only the lines that hold cells are numbered.
        line = np.unique(line, return_inverse=True)[1].astype(np.int32)
        least, greatest = 0, len(line)
    after, before = _links(line, least, greatest - least + 1)
    return after, before


@kernel
def _ends(line: Int32) -> tuple[int, int]:
    """Return the least and the greatest line, or 0 where that is less or more."""
    least = greatest = ZERO
    for number in line:
        least, greatest = min(least, number), max(greatest, number)
    return least, greatest


@kernel
def _links(line: Int32, least: int, lines: int) -> tuple[Int32, Int32]:
    # Only in maps of 100 GB does the number of a cell need more than 4 bytes.
    after, before = np.empty(len(line), dtype=np.int32), np.empty(len(line), dtype=np.int32)
    last = np.full(lines, -1, dtype=np.int32)
    for cell in range(len(line)):
        number = line[cell] - least
        before[cell], after[cell] = last[number], -1
        if last[number] >= 0:
            after[last[number]] = cell
        last[number] = cell
    return after, before
