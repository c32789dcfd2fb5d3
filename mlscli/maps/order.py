"""The file's order of patches: ascending by cell, then by height, depth, origin and count."""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np

from mlscli.runtime.arrays import Array, Float64, Int32, Int64, UInt8, UInt32, frozen
from mlscli.runtime.kernels import inner, kernel

# Arrays of one type, the columns of a map that hold values of one size.
Columns: TypeAlias = tuple[Array, ...]


class Keys(NamedTuple):
    """The columns by which patches are sorted: the first that differs decides.

    Attributes
    ----------
    ix, iy : int32 (P,)
    height, depth : float64 (P,)
    origin : uint8 (P,)
        As in `SurfaceMap`.
    points : uint32 (P,)
        The column `count` of `SurfaceMap`.
    """

    ix: Int32
    iy: Int32
    height: Float64
    depth: Float64
    origin: UInt8
    points: UInt32


class OccupiedCells(NamedTuple):
    """The cells that hold patches, in the file's order, and where their patches begin.

    Attributes
    ----------
    ix, iy : int32 (C,)
        Cell indices, ascending by (ix, iy).
    start : int64 (C + 1,)
        The patches of cell c lie at ``start[c]:start[c + 1]``.
    """

    ix: Int32
    iy: Int32
    start: Int64

    @classmethod
    def of(cls, ix: Int32, iy: Int32) -> OccupiedCells:
        """Return the cells of patches that ascend by (ix, iy)."""
        return cls(*_occupied(frozen(ix), frozen(iy)))


@kernel
def _occupied(ix: Int32, iy: Int32) -> tuple[Int32, Int32, Int64]:
    cells = 0
    for i in range(len(ix)):
        cells += i == 0 or ix[i] != ix[i - 1] or iy[i] != iy[i - 1]
    x, y = np.empty(cells, dtype=np.int32), np.empty(cells, dtype=np.int32)
    start = np.empty(cells + 1, dtype=np.int64)
    start[cells], cell = len(ix), 0
    for i in range(len(ix)):
        if i == 0 or ix[i] != ix[i - 1] or iy[i] != iy[i - 1]:
            x[cell], y[cell], start[cell] = ix[i], iy[i], i
            cell += 1
    return x, y, start


@kernel
def ascend(keys: Keys) -> bool:
    """Return whether patches are in the file's order."""
    i = 1
    while i < len(keys.ix) and not _later(keys, i - 1, keys, i):
        i += 1
    return i >= len(keys.ix)


@kernel
def come_before(keys: Keys, others: Keys) -> Int64:
    """Return for each of `others` how many of `keys` precede or equal it, int64 (Q,).

    Both are in the file's order.
    """
    before = np.empty(len(others.ix), dtype=np.int64)
    i = 0
    for j in range(len(others.ix)):
        while i < len(keys.ix) and not _later(keys, i, others, j):
            i += 1
        before[j] = i
    return before


@kernel
def pick(begin: int, end: int, columns: Columns, which: Int64, picked: Columns) -> None:
    """Write rows `begin` to `end` of `picked`: row i is row ``which[i]`` of some columns."""
    # An index that begins at 0 is known to be none from the end, which would be looked for.
    chosen = which[begin:end]
    for c in range(len(columns)):
        column, target = columns[c], picked[c][begin:end]
        for i in range(len(target)):
            target[i] = column[chosen[i]]


@kernel
def interleave(
    begin: int, end: int, columns: Columns, others: Columns, before: Int64, both: Columns
) -> None:
    """Write rows `begin` to `end` of columns that hold the rows of two, interleaved.

    Parameters
    ----------
    begin, end : int
        Range of rows to write.
    columns, others : tuples of arrays (M,), and (N,)
        Columns of one size of an item.
    before : int64 (N,)
        How many rows of `columns` precede each row of `others`.
    both : tuple of arrays (M + N,)
        Receives the rows.
    """
    first, beyond = 0, len(before)
    while first < beyond:
        middle = (first + beyond) // 2
        if before[middle] + middle < begin:
            first = middle + 1
        else:
            beyond = middle
    for c in range(len(columns)):
        column, other, target = columns[c], others[c], both[c]
        k, i = first, begin - first
        while i + k < end:
            stop = min(before[k], end - k) if k < len(before) else end - k
            for j in range(i, stop):
                target[j + k] = column[j]
            i = stop
            if i + k < end:
                target[i + k] = other[k]
                k += 1


@inner
def _later(keys: Keys, i: int, others: Keys, j: int) -> bool:
    """Return whether patch i comes after patch j of the others."""
    if keys.ix[i] != others.ix[j]:
        return bool(keys.ix[i] > others.ix[j])
    if keys.iy[i] != others.iy[j]:
        return bool(keys.iy[i] > others.iy[j])
    return comes_later(
        keys.height[i], keys.depth[i], keys.origin[i], keys.points[i],
        others.height[j], others.depth[j], others.origin[j], others.points[j],
    )  # fmt: skip


@inner
def comes_later(
    height: float, depth: float, origin: int, count: int,
    other_height: float, other_depth: float, other_origin: int, other_count: int,
) -> bool:  # fmt: skip
    """Return whether a patch comes after another of its cell: the first key that differs decides.

    Parameters
    ----------
    height, depth : float
    origin, count : int
        Of the patch, as in `SurfaceMap`.
    other_height, other_depth : float
    other_origin, other_count : int
        Of the other patch.
    """
    if height != other_height:
        return bool(height > other_height)
    if depth != other_depth:
        return bool(depth > other_depth)
    if origin != other_origin:
        return bool(origin > other_origin)
    return bool(count > other_count)
