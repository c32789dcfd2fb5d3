"""Rows of 8-byte words: all that is known of a point or a patch, its cell's packed key first.

Code that moves rows need not know what the other words hold. Unless said otherwise, rows ascend by
cell. Indices and sizes are int64 throughout: for any other type, kernels would be compiled anew.
"""

from __future__ import annotations

import numpy as np

from mlscli.runtime.arrays import ONE, ZERO, UInt64
from mlscli.runtime.kernels import inner, kernel


@inner
def copied(rows: UInt64, begin: int, size: int, target: UInt64, to: int) -> int:
    """Copy `size` rows, from `begin` on, to row `to` of `target`; return the row after them."""
    for row in range(size):
        for word in range(rows.shape[1]):
            target[to + row, word] = rows[begin + row, word]
    return to + size


@kernel
def merged(rows: UInt64, others: UInt64) -> UInt64:
    """Return the rows of both, ascending by cell; in a cell the others come last."""
    both = np.empty((len(rows) + len(others), rows.shape[1]), dtype=np.uint64)
    i = j = n = ZERO
    while n < len(both):
        if j == len(others) or (i < len(rows) and rows[i, 0] <= others[j, 0]):
            n = copied(rows, i, ONE, both, n)
            i += 1
        else:
            n = copied(others, j, ONE, both, n)
            j += 1
    return both


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


@kernel
def missing(rows: UInt64, others: UInt64) -> UInt64:
    """Return the rows that are not among others, compared bit for bit; both ascend by cell."""
    apart = np.empty_like(rows)
    noted = first = ZERO
    for i in range(len(rows)):
        while first < len(others) and others[first, 0] < rows[i, 0]:
            first += 1
        last = first
        while last < len(others) and others[last, 0] == rows[i, 0]:
            last += 1
        noted = note_missing(rows, i, ONE, others, first, last - first, apart, noted)
    return apart[:noted]
