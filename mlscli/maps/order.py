"""The file's order of patches: ascending by cell, then by height, depth, origin and count."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mlscli.runtime.arrays import Array, Float64, Int32, Int64, UInt8, UInt32, frozen
from mlscli.runtime.kernels import inner, kernel


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
        start = _starts(frozen(ix), frozen(iy))
        return cls(ix[start[:-1]], iy[start[:-1]], start)


@kernel
def _starts(ix: Int32, iy: Int32) -> Int64:
    start = np.empty(len(ix) + 1, dtype=np.int64)
    start[0] = cells = 0
    for i in range(len(ix)):
        start[cells + 1] = i + 1
        cells += i + 1 == len(ix) or ix[i + 1] != ix[i] or iy[i + 1] != iy[i]
    return start[: cells + 1].copy()


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


def bare(column: Array) -> Array:
    """Return a view of a column as unsigned integers: kernels are compiled for fewer types."""
    return column.view(f"u{column.itemsize}")


@kernel
def pick(column: Array, which: Int64, picked: Array) -> None:
    """Copy the elements of a column at some indices into `picked`."""
    for i in range(len(which)):
        picked[i] = column[which[i]]


@kernel
def interleave(column: Array, others: Array, before: Int64, both: Array) -> None:
    """Merge two columns into `both`; ``before[k]`` of the first precede the k-th of the others."""
    done = 0
    for k in range(len(others)):
        for i in range(done, before[k]):
            both[i + k] = column[i]
        done = before[k]
        both[done + k] = others[k]
    for i in range(done, len(column)):
        both[i + len(others)] = column[i]


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
