"""Cells of the grid: their indices, packed keys, and sets of them.

A packed key holds both indices of a cell in 64 bits, so that keys sort as (ix, iy).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mlscli.typing import Array, Bool, Float64, Int32, Int64, UInt64

LEAST, GREATEST = -(2**31), 2**31 - 1


def cell_indices(coordinates: Float64, cell_size: float) -> Float64:
    """Return ``floor(coordinate / cell_size)``, as floats: they may lie beyond int32."""
    return np.floor(coordinates / cell_size)


def on_grid(xyz: Float64, cell_size: float) -> Bool:
    """Tell which points (N, 3) lie in a cell whose indices int32 can hold."""
    index = cell_indices(xyz[:, :2], cell_size)
    return np.asarray(((index >= LEAST) & (index <= GREATEST)).all(axis=1))


def pack(ix: Array, iy: Array) -> UInt64:
    """Return the packed keys of cells; `ix` and `iy` are within int32."""
    high = (ix.astype(np.int64) - LEAST).astype(np.uint64)
    low = (iy.astype(np.int64) - LEAST).astype(np.uint64)
    return (high << np.uint64(32)) | low


def unpack(keys: UInt64) -> tuple[Int32, Int32]:
    """Return the indices (ix, iy) of packed keys."""
    ix = (keys >> np.uint64(32)).astype(np.int64) + LEAST
    iy = (keys & np.uint64(0xFFFFFFFF)).astype(np.int64) + LEAST
    return ix.astype(np.int32), iy.astype(np.int32)


class Limits(NamedTuple):
    """A rectangle of cells by its least and greatest indices, inclusive; None: no limit."""

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
        """Tell which of the cells lie inside."""
        inside = np.ones(len(ix), dtype=np.bool_)
        for index, least, greatest in ((ix, self.min_x, self.max_x), (iy, self.min_y, self.max_y)):
            if least is not None:
                inside &= index >= least
            if greatest is not None:
                inside &= index <= greatest
        return inside


@dataclass(frozen=True, eq=False)
class CellSet:
    """A set of cells.

    Attributes
    ----------
    keys : uint64 (C,)
        Packed keys, ascending, each once.
    """

    keys: UInt64

    @classmethod
    def of(cls, ix: Array, iy: Array) -> CellSet:
        """Return the set of the cells given, which may repeat."""
        return cls(np.unique(pack(ix, iy)))

    @property
    def size(self) -> int:
        """How many cells these are."""
        return len(self.keys)

    def widened(self, reach: int) -> CellSet:
        """Return the cells within `reach` of one of these, in x and in y."""
        ix, iy = (index.astype(np.int64) for index in unpack(self.keys))
        # One axis after the other: each cell is repeated 2 (2 reach + 1) times, not its square.
        ix, iy = _spread(ix, iy, reach)
        iy, ix = _spread(iy, ix, reach)
        return CellSet.of(ix, iy)

    def contains(self, ix: Array, iy: Array) -> Bool:
        """Tell which of the cells given are in the set."""
        if self.size == 0:
            return np.zeros(len(ix), dtype=np.bool_)
        keys = pack(ix, iy)
        found = np.searchsorted(self.keys, keys)
        inside: Bool = self.keys[np.minimum(found, self.size - 1)] == keys
        return inside


def _spread(along: Int64, across: Int64, reach: int) -> tuple[Int64, Int64]:
    """Repeat each cell `reach` times to both sides, each result once, staying on the grid."""
    steps = np.arange(-reach, reach + 1)
    along = (along[:, None] + steps).ravel()
    across = np.repeat(across, len(steps))
    inside = (along >= LEAST) & (along <= GREATEST)
    cells = unpack(np.unique(pack(along[inside], across[inside])))
    return cells[0].astype(np.int64), cells[1].astype(np.int64)
