"""Rows of 8-byte words: all that is known of a point or a patch, its cell's packed key first.

Code that moves rows need not know what the other words hold. Unless said otherwise, rows ascend by
cell. Indices and sizes are int64 throughout: for any other type, kernels would be compiled anew.
"""

from __future__ import annotations

import numpy as np

from mlscli.maps.cells import CellSet
from mlscli.maps.strips import STRIP_BITS, STRIP_CELLS, Strips, holds
from mlscli.runtime.arrays import ONE, ZERO, UInt64
from mlscli.runtime.kernels import inner, kernel


def part(rows: UInt64, cells: CellSet) -> UInt64:
    """Return the rows that lie in `cells`."""
    inside: UInt64 = _part(rows, *_strips(cells, rows))
    return inside


def with_part(rows: UInt64, cells: CellSet, others: UInt64) -> UInt64:
    """Return rows with those in `cells` replaced by those of `others` that lie in them."""
    both: UInt64 = _with_part(rows, others, *_strips(cells, rows, others))
    return both


def merged(rows: UInt64, others: UInt64) -> UInt64:
    """Return the rows of both, ascending by cell; in a cell the others come last."""
    both = np.concatenate((rows, others))
    # A stable sort of two runs that ascend is a merge.
    return both[np.argsort(both[:, 0], kind="stable")]


def missing(rows: UInt64, others: UInt64) -> UInt64:
    """Return the rows that are not among others, compared bit for bit."""
    whole = np.dtype((np.void, rows.itemsize * rows.shape[1]))
    return rows[~np.isin(rows.view(whole).ravel(), others.view(whole).ravel())]


def _strips(cells: CellSet, *rows: UInt64) -> Strips:
    """Return a set as strips; where it has too many, only those with rows."""
    strips = cells.strips(most=STRIP_CELLS * sum(map(len, rows)))
    if strips is None:
        numbers = np.concatenate([each[:, 0] for each in rows]) >> np.uint64(STRIP_BITS)
        strips = cells.strips_among(np.unique(numbers))
    return strips


@kernel
def _part(rows: UInt64, number: UInt64, bits: UInt64) -> UInt64:
    inside = np.empty_like(rows)
    size = i = ZERO
    for s in range(len(number)):
        while i < len(rows) and rows[i, 0] >> np.uint64(STRIP_BITS) < number[s]:
            i += 1
        # Many rows at once are copied in half the time.
        first = i
        while i < len(rows) and rows[i, 0] >> np.uint64(STRIP_BITS) == number[s]:
            if not holds(bits[s], rows[i, 0]):
                size = copied(rows, first, i - first, inside, size)
                first = i + 1
            i += 1
        size = copied(rows, first, i - first, inside, size)
    return inside[:size]


@kernel
def _with_part(rows: UInt64, others: UInt64, number: UInt64, bits: UInt64) -> UInt64:
    both = np.empty((len(rows) + len(others), rows.shape[1]), dtype=np.uint64)
    size = i = j = ZERO
    for s in range(len(number)):
        first = i
        while i < len(rows) and rows[i, 0] >> np.uint64(STRIP_BITS) < number[s]:
            i += 1
        size = copied(rows, first, i - first, both, size)
        while j < len(others) and others[j, 0] >> np.uint64(STRIP_BITS) < number[s]:
            j += 1
        # In a cell either the ones stay or the others.
        while True:
            one = i < len(rows) and rows[i, 0] >> np.uint64(STRIP_BITS) == number[s]
            other = j < len(others) and others[j, 0] >> np.uint64(STRIP_BITS) == number[s]
            if one and not (other and others[j, 0] < rows[i, 0]):
                if not holds(bits[s], rows[i, 0]):
                    size = copied(rows, i, ONE, both, size)
                i += 1
            elif other:
                if holds(bits[s], others[j, 0]):
                    size = copied(others, j, ONE, both, size)
                j += 1
            else:
                break
    size = copied(rows, i, len(rows) - i, both, size)
    return both[:size]


@inner
def copied(rows: UInt64, begin: int, size: int, target: UInt64, to: int) -> int:
    """Copy `size` rows, from `begin` on, to row `to` of `target`; return the row after them."""
    for row in range(size):
        for word in range(rows.shape[1]):
            target[to + row, word] = rows[begin + row, word]
    return to + size


@inner
def alike(rows: UInt64, begin: int, size: int, others: UInt64, first: int, more: int) -> bool:
    """Return whether some rows are the same as some others, in number, order and every bit.

    Parameters
    ----------
    rows, others : uint64 (., words)
    begin, size : int
        The first of the rows to compare, and their number.
    first, more : int
        The same of the others.
    """
    if size != more:
        return False
    same = True
    for i in range(size):
        same &= _same(rows, begin + i, others, first + i)
    return same


@inner
def _same(rows: UInt64, row: int, others: UInt64, other: int) -> bool:
    same = True
    for word in range(rows.shape[1]):
        same &= rows[row, word] == others[other, word]
    return same


@inner
def note_missing(
    rows: UInt64, begin: int, size: int, others: UInt64, first: int, more: int,
    missing: UInt64, noted: int,
) -> int:  # fmt: skip
    """Note the rows that are not among some others; return how many are noted in all.

    Parameters
    ----------
    rows, others : uint64 (., words)
    begin, size : int
        The first of the rows to look for, and their number.
    first, more : int
        The first of the others to look through, and their number.
    missing : uint64 (., words)
        Receives the rows that are not found.
    noted : int
        How many rows it holds already.
    """
    for i in range(size):
        there = False
        for j in range(more):
            if _same(rows, begin + i, others, first + j):
                there = True
                break
        if not there:
            noted = copied(rows, begin + i, ONE, missing, noted)
    return noted
