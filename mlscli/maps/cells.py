"""Cells of the grid: their indices, packed keys, and sets of cells.

A packed key, uint64, holds both indices of a cell; keys sort as (ix, iy).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from mlscli.maps.patches import runs
from mlscli.maps.strips import STRIP_BITS, STRIP_CELLS, Strips, strips_of, widened
from mlscli.runtime.arrays import Array, Bool, Float64, Int32, Int64, UInt64
from mlscli.runtime.kernels import inner, kernel

LEAST_INDEX, GREATEST_INDEX = -(2**31), 2**31 - 1

# A widened set of up to this many strips is always listed.
_FEW_STRIPS = 2**14


def cell_indices(coordinates: Float64, cell_size: float) -> Float64:
    """Return ``floor(coordinate / cell_size)``, as float64: it may lie beyond int32."""
    return np.floor(coordinates / cell_size)


def on_grid(xyz: Float64, cell_size: float) -> Bool:
    """Return which points (N, 3) lie in a cell whose indices int32 can hold, bool (N,)."""
    inside: Bool = _on_grid(xyz, cell_size)
    return inside


@kernel
def _on_grid(xyz: Float64, cell_size: float) -> Bool:
    inside = np.ones(len(xyz), dtype=np.bool_)
    for i in range(len(xyz)):
        for axis in range(2):
            index = np.floor(xyz[i, axis] / cell_size)
            inside[i] &= LEAST_INDEX <= index <= GREATEST_INDEX
    return inside


@inner
def key_of(ix: int, iy: int) -> np.uint64:
    """Return the packed key of a cell."""
    return np.uint64(np.uint64(ix - LEAST_INDEX) << np.uint64(32) | np.uint64(iy - LEAST_INDEX))


@inner
def cell_of(key: np.uint64) -> tuple[int, int]:
    """Return the indices (ix, iy) of the cell with a packed key."""
    return (
        np.int64(key >> np.uint64(32)) + LEAST_INDEX,  # type: ignore[return-value]
        np.int64(key & np.uint64(0xFFFFFFFF)) + LEAST_INDEX,
    )


@kernel
def pack(ix: Array, iy: Array) -> UInt64:
    """Return the packed keys of cells, uint64 (C,); `ix` and `iy` must be within int32."""
    keys = np.empty(len(ix), dtype=np.uint64)
    for i in range(len(ix)):
        keys[i] = key_of(ix[i], iy[i])
    return keys


@kernel
def unpack(keys: UInt64) -> tuple[Int32, Int32]:
    """Return the cell indices (ix, iy) of packed keys, int32 (C,)."""
    ix, iy = np.empty(len(keys), dtype=np.int32), np.empty(len(keys), dtype=np.int32)
    for i in range(len(keys)):
        ix[i], iy[i] = cell_of(keys[i])
    return ix, iy


class Limits(NamedTuple):
    """A rectangle of cells.

    Attributes
    ----------
    min_x, max_x, min_y, max_y : int or None
        The least and the greatest ix and iy, inclusive; None: no limit.
    """

    min_x: int | None = None
    max_x: int | None = None
    min_y: int | None = None
    max_y: int | None = None

    def widened(self, reach: int) -> Limits:
        """Return the rectangle that holds all cells within `reach` of this one."""
        return Limits(
            None if self.min_x is None else self.min_x - reach,
            None if self.max_x is None else self.max_x + reach,
            None if self.min_y is None else self.min_y - reach,
            None if self.max_y is None else self.max_y + reach,
        )

    def contain(self, ix: Int32, iy: Int32) -> Bool:
        """Return which cells lie inside, bool (C,)."""
        inside = np.ones(len(ix), dtype=np.bool_)
        for index, least, greatest in ((ix, self.min_x, self.max_x), (iy, self.min_y, self.max_y)):
            if least is not None:
                inside &= index >= least
            if greatest is not None:
                inside &= index <= greatest
        return inside


@dataclass(frozen=True, eq=False)
class CellSet:
    """A set of cells: those listed, and all within a reach of one of them.

    A reach can be as wide as the grid: the cells within it are tested for, not listed.

    Attributes
    ----------
    keys : uint64 (C,)
        Packed keys of the listed cells, ascending, each once.
    reach : int
        How many cells away from a listed one, in x and in y, a cell can be.
    """

    keys: UInt64
    reach: int = 0

    @classmethod
    def of(cls, ix: Array, iy: Array) -> CellSet:
        """Return the set of the cells given, which may repeat."""
        return cls.of_keys(pack(ix, iy))

    @classmethod
    def of_keys(cls, keys: UInt64) -> CellSet:
        """Return the set of the cells with the packed keys given, which may repeat."""
        return cls(_each_once(np.sort(keys)))

    def widened(self, reach: int) -> CellSet:
        """Return the set of all cells within `reach` of this one, in x and in y."""
        wider = CellSet(self.keys, self.reach + reach)
        wider.__dict__["_known"] = self._known
        return wider

    def contains(self, ix: Array, iy: Array) -> Bool:
        """Return which cells are in the set, bool (C,); fastest where they ascend."""
        column, position = unpack(self.keys)
        start = runs(column)
        cells = (np.ascontiguousarray(index, dtype=np.int32) for index in (ix, iy))
        inside: Bool = _within(column[start[:-1]], start, position, self.reach, *cells)
        return inside

    def strips(self, most: int) -> Strips | None:
        """Return the set as strips, or None where it may have too many.

        Parameters
        ----------
        most : int
            How many strips are not too many. `_FEW_STRIPS` never are, nor those of a set that is
            not widened.
        """
        known = self._known
        if self.reach not in known:
            square = (2 * self.reach + 1) * ((2 * self.reach >> STRIP_BITS) + 2)
            if len(known[0].number) * square > max(_FEW_STRIPS, most):
                return None
            nearest = max(reach for reach in known if reach < self.reach)
            known[self.reach] = Strips(*widened(*known[nearest], nearest, self.reach))
        return known[self.reach]

    @cached_property
    def _known(self) -> dict[int, Strips]:
        """The strips of this set, narrower or wider, by their reach: a batch asks for many."""
        return {0: Strips(*strips_of(self.keys))}

    def strips_among(self, numbers: UInt64) -> Strips:
        """Return the cells of the set that lie in some strips, given by ascending numbers."""
        cells = numbers[:, None] << np.uint64(STRIP_BITS) | np.arange(STRIP_CELLS, dtype=np.uint64)
        keys = cells.ravel()
        return Strips(*strips_of(keys[self.contains(*unpack(keys))]))


@kernel
def _each_once(keys: UInt64) -> UInt64:
    """Return ascending keys, each once."""
    size = 0
    once = np.empty_like(keys)
    for key in keys:
        if size == 0 or once[size - 1] != key:
            once[size] = key
            size += 1
    return once[:size]


@kernel
def _within(column: Int32, start: Int64, position: Int32, reach: int, ix: Int32, iy: Int32) -> Bool:
    """Return which cells are within `reach` of a cell of a set, bool (N,).

    Parameters
    ----------
    column : int32 (K,)
        The ix of the columns in which the set has cells, ascending.
    start : int64 (K + 1,)
        The cells of column c are ``position[start[c]:start[c + 1]]``.
    position : int32 (C,)
        The iy of the cells of the set, ascending in each column.
    reach : int
        In cells, in x and in y.
    ix, iy : int32 (N,)
        The cells to look up. Where they ascend, the search only moves forward.
    """
    inside = np.zeros(len(ix), dtype=np.bool_)
    at = start.copy()
    first = last = 0
    for i in range(len(ix)):
        x, y = np.int64(ix[i]), np.int64(iy[i])
        if i > 0 and ix[i] == ix[i - 1] and iy[i] == iy[i - 1]:
            inside[i] = inside[i - 1]
            continue
        if i > 0 and ix[i] < ix[i - 1]:
            first = last = 0
        if i == 0 or ix[i] != ix[i - 1] or iy[i] < iy[i - 1]:
            while first < len(column) and column[first] < x - reach:
                first += 1
            while last < len(column) and column[last] <= x + reach:
                last += 1
            for c in range(first, last):
                at[c] = start[c]
        for c in range(first, last):
            while at[c] < start[c + 1] and position[at[c]] < y - reach:
                at[c] += 1
            if at[c] < start[c + 1] and position[at[c]] <= y + reach:
                inside[i] = True
                break
    return inside
