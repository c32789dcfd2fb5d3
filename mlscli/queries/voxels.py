"""The free space of a part of a map, for kernels that look voxels up."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mlscli.maps.cells import key_of, pack
from mlscli.maps.free_space import FreeSpace
from mlscli.runtime.arrays import ZERO, Int32, Int64, UInt8, UInt64
from mlscli.runtime.kernels import inner
from mlscli.runtime.sorting import place_of


class Voxels(NamedTuple):
    """Free space over some columns of cells.

    Attributes
    ----------
    key : uint64 (C,)
        Packed keys of the cells, ascending.
    start : int64 (C + 1,)
    iz : int32 (V,)
    lines : uint8 (V,)
        As in `FreeSpace`.
    """

    key: UInt64
    start: Int64
    iz: Int32
    lines: UInt8

    @classmethod
    def of(cls, free: FreeSpace | None, least_x: int, greatest_x: int) -> Voxels:
        """Return the free space over the cells with ix in a range; of None: none at all."""
        free = FreeSpace.of_none() if free is None else free
        begin, end = np.searchsorted(free.ix, [least_x, greatest_x + 1])
        keys = pack(free.ix[begin:end], free.iy[begin:end])
        return cls(keys, free.start[begin : end + 1], free.iz, free.lines)


@inner
def first_from(iz: Int32, begin: int, end: int, least: int) -> int:
    """Return the first of ascending voxels ``begin:end`` that is not below one, or `end`."""
    while begin < end:
        middle = (begin + end) // 2
        if iz[middle] < least:
            begin = middle + 1
        else:
            end = middle
    return begin


@inner
def column_from(space: Voxels, key: np.uint64, low: int) -> tuple[int, int]:
    """Return the voxels of a cell, by its packed key, from the height `low` on: first and end."""
    column = place_of(space.key, key)
    if column == len(space.key) or space.key[column] != key:
        return ZERO, ZERO
    end = space.start[column + 1]
    return first_from(space.iz, space.start[column], end, low), end


@inner
def all_seen(space: Voxels, ix: int, iy: int, low: int, high: int, least: int) -> bool:
    """Return whether enough lines passed through each of some voxels above one another.

    Parameters
    ----------
    space : Voxels
    ix, iy : int
        Their cell.
    low, high : int
        The lowest and the highest of them.
    least : int
        How many lines are enough.
    """
    voxel, end = column_from(space, key_of(ix, iy), low)
    for wanted in range(low, high + 1):
        if voxel == end or space.iz[voxel] != wanted or space.lines[voxel] < least:
            return False
        voxel += 1
    return True
