"""Sets of cells as strips: a strip is STRIP_CELLS successive cells of a column, a bit for each.

Strips ascend as their cells do, by (ix, iy). All kernels take and return the ascending numbers of
strips and the bits of their cells, as in `Strips`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from mlscli.runtime.arrays import ONE, ZERO, UInt64
from mlscli.runtime.kernels import inner, kernel

# A strip has 2**5 cells: a few more than a batch of a sparse cloud touches in a column.
STRIP_BITS = 5
STRIP_CELLS = 2**STRIP_BITS

# A strip's number is the packed key of its cells without the last bits: 32 bits for ix, the others
# for iy.
IY_BITS = 32 - STRIP_BITS


class Strips(NamedTuple):
    """A set of cells.

    Attributes
    ----------
    number : uint64 (S,)
        Packed keys of the strips' cells, shifted by `STRIP_BITS`; ascending, each once.
    bits : uint64 (S,)
        The cells of each strip that are in the set: bit ``c % STRIP_CELLS`` for packed key c.
    """

    number: UInt64
    bits: UInt64


@inner
def holds(bits: Any, cell: Any) -> bool:
    """Return whether a cell, given by its packed key or its place, is among those of its strip."""
    return bool(bits >> (cell & np.uint64(STRIP_CELLS - 1)) & np.uint64(1) == 1)


@kernel
def strips_of(cells: UInt64) -> tuple[UInt64, UInt64]:
    """Return the strips of cells, whose packed keys ascend and may repeat."""
    number, bits = np.empty_like(cells), np.zeros_like(cells)
    size = 0
    for cell in cells:
        strip = cell >> np.uint64(STRIP_BITS)
        if size == 0 or number[size - 1] != strip:
            number[size] = strip
            size += 1
        bits[size - 1] |= np.uint64(1) << (cell & np.uint64(STRIP_CELLS - 1))
    return number[:size], bits[:size]


@kernel
def widened(number: UInt64, bits: UInt64, covered: int, reach: int) -> tuple[UInt64, UInt64]:
    """Return the strips of all cells within `reach` of a set, in x and in y.

    Given are those within `covered` of it, which is less. The set is widened in steps: each adds
    copies of it, moved to both sides. A step is at most one cell longer than the set was widened
    before: a longer one would leave a hole at an edge of the grid, where one copy may be lost.
    Along columns first, which makes few strips more.
    """
    for across in (ZERO, ONE):
        done = covered
        while done < reach:
            step = min(done + 1, reach - done)
            number, bits = _spread(number, bits, step * across, step * (1 - across))
            done += step
    return number, bits


@inner
def _spread(number: UInt64, bits: UInt64, dx: int, dy: int) -> tuple[UInt64, UInt64]:
    """Return the union of a set and its copies moved by (dx, dy) and by (-dx, -dy)."""
    there = _moved(number, bits, dx, dy)
    back = _moved(number, bits, -dx, -dy)
    both = _united(there[0], there[1], back[0], back[1])
    return _united(number, bits, both[0], both[1])


@inner
def _moved(number: UInt64, bits: UInt64, dx: int, dy: int) -> tuple[UInt64, UInt64]:
    """Return a set moved by dx and dy cells, without what leaves the grid."""
    by = np.uint64(dy & (STRIP_CELLS - 1))
    # Bits that are moved out of a strip go to the next one.
    one = _shifted(number, bits << by & np.uint64(2**STRIP_CELLS - 1), dx, dy >> STRIP_BITS)
    if by == 0:
        return one
    next_one = _shifted(number, bits >> (np.uint64(STRIP_CELLS) - by), dx, (dy >> STRIP_BITS) + 1)
    return _united(one[0], one[1], next_one[0], next_one[1])


@inner
def _shifted(number: UInt64, bits: UInt64, dx: int, dy: int) -> tuple[UInt64, UInt64]:
    """Return strips moved by dx columns and dy strips, without empty ones and any off the grid."""
    moved, kept = np.empty_like(number), np.empty_like(bits)
    size = 0
    for i in range(len(number)):
        x = np.int64(number[i] >> np.uint64(IY_BITS)) + dx
        y = np.int64(number[i] & np.uint64(2**IY_BITS - 1)) + dy
        if bits[i] and 0 <= x < 2**32 and 0 <= y < 2**IY_BITS:
            moved[size] = np.uint64(x) << np.uint64(IY_BITS) | np.uint64(y)
            kept[size] = bits[i]
            size += 1
    return moved[:size], kept[:size]


@inner
def _united(
    number: UInt64, bits: UInt64, other_number: UInt64, other_bits: UInt64
) -> tuple[UInt64, UInt64]:
    """Return the union of two sets."""
    both = np.empty(len(number) + len(other_number), dtype=np.uint64)
    cells = np.empty_like(both)
    size = i = j = 0
    while i < len(number) or j < len(other_number):
        if j == len(other_number) or (i < len(number) and number[i] <= other_number[j]):
            strip, inside = number[i], bits[i]
            i += 1
        else:
            strip, inside = other_number[j], other_bits[j]
            j += 1
        if size and both[size - 1] == strip:
            cells[size - 1] |= inside
        else:
            both[size], cells[size] = strip, inside
            size += 1
    return both[:size], cells[:size]
