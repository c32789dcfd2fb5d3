"""Free space: through which parts of space sight lines passed, and how many.

Space is divided into voxels: a cell of the map wide, half a cell high, and aligned as cells are.
Each holds how many lines from the craft to a point passed through it; what holds none was never
seen, unless a patch lies there. That space which was looked through is free is from H. Moravec and
A. Elfes, *High Resolution Maps from Wide Angle Sonar*, ICRA 1985
(doi:10.1109/ROBOT.1985.1087316).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from mlscli.errors import InputError, expect
from mlscli.maps.cells import Limits, pack, unpack
from mlscli.runtime.arrays import Array, Bool, Float64, Int32, Int64, UInt8, UInt64, frozen
from mlscli.runtime.kernels import kernel
from mlscli.runtime.sorting import place_of

# Counts stop here.
MOST_LINES = 255

FREE_COLUMNS = {
    "ix": np.dtype(np.int32),
    "iy": np.dtype(np.int32),
    "start": np.dtype(np.int64),
    "iz": np.dtype(np.int32),
    "lines": np.dtype(np.uint8),
}


@dataclass(frozen=True, eq=False, repr=False)
class FreeSpace:
    """How many sight lines passed through each voxel, column by column; arrays are read-only.

    A voxel (ix, iy, iz) is the part of cell (ix, iy) from ``iz * cell_size / 2`` up to
    ``(iz + 1) * cell_size / 2``. Those that no line passed through are not listed.

    Attributes
    ----------
    ix, iy : int32 (C,)
        The cells over which voxels are listed, ascending by (ix, iy).
    start : int64 (C + 1,)
        The voxels over cell c lie at ``start[c]:start[c + 1]``.
    iz : int32 (V,)
        Their indices, ascending in each cell.
    lines : uint8 (V,)
        How many lines passed through: 1 to 255, which also stands for more.
    """

    ix: Int32
    iy: Int32
    start: Int64
    iz: Int32
    lines: UInt8

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        for name, array in self.columns.items():
            expect(array, np.ndarray, name, "an array")
            object.__setattr__(self, name, frozen(array))

    @classmethod
    def of_none(cls) -> FreeSpace:
        """Return the free space of no sight line."""
        columns: Any = {name: np.zeros(0, dtype) for name, dtype in FREE_COLUMNS.items()}
        return cls(**columns | {"start": np.zeros(1, dtype=np.int64)})

    @property
    def size(self) -> int:
        """How many voxels are listed."""
        return len(self.iz)

    @property
    def columns(self) -> dict[str, Array]:
        """The arrays by name, as `FREE_COLUMNS` lists them."""
        return {name: getattr(self, name) for name in FREE_COLUMNS}

    @property
    def voxels(self) -> Int32:
        """The indices (ix, iy, iz) of all voxels listed, int32 (V, 3)."""
        repeated = np.diff(self.start)
        columns = np.repeat(self.ix, repeated), np.repeat(self.iy, repeated), self.iz
        return np.column_stack(columns)

    def lines_through(self, ix: Array, iy: Array, iz: Array) -> UInt8:
        """Return how many lines passed through voxels, uint8 (N,).

        Parameters
        ----------
        ix, iy, iz : int (N,)
            Their indices, of any integer type; see `voxels_at`.
        """
        inside = np.ones(len(ix), dtype=np.bool_)
        for index in (ix, iy, iz):
            expect(index, np.ndarray, "ix, iy, iz", "arrays of whole numbers")
            inside &= (index >= -(2**31)) & (index < 2**31)
        found = np.zeros(len(ix), dtype=np.uint8)
        columns = [index[inside].astype(np.int32) for index in (ix, iy, iz)]
        keys = pack(columns[0], columns[1])
        found[inside] = _found(
            keys, columns[2], pack(self.ix, self.iy), self.start, self.iz, self.lines
        )
        return found

    def union(self, other: FreeSpace) -> FreeSpace:
        """Return the free space of the lines of both: counts add."""
        expect(other, FreeSpace, "other", "free space (FreeSpace)")
        keys, start, iz, lines = _added(
            pack(self.ix, self.iy), self.start, self.iz, self.lines,
            pack(other.ix, other.iy), other.start, other.iz, other.lines,
        )  # fmt: skip
        return FreeSpace(*unpack(keys), start, iz, lines)

    def crop(self, limits: Limits) -> FreeSpace:
        """Return the voxels over the cells within limits."""
        chosen = limits.contain(self.ix, self.iy)
        if chosen.all():
            return self
        sizes = np.diff(self.start)
        voxels = np.repeat(chosen, sizes)
        start = np.concatenate(([0], np.cumsum(sizes[chosen])))
        return FreeSpace(
            self.ix[chosen], self.iy[chosen], start, self.iz[voxels], self.lines[voxels]
        )

    def __eq__(self, other: object) -> bool:
        """Return whether all is the same."""
        if not isinstance(other, FreeSpace):
            return NotImplemented
        return all(
            np.array_equal(mine, others)
            for mine, others in zip(self.columns.values(), other.columns.values(), strict=True)
        )

    def __repr__(self) -> str:
        """Return a summary."""
        return f"FreeSpace(voxels={self.size}, cells={len(self.ix)})"

    __hash__ = None  # type: ignore[assignment]

    def check(self) -> None:
        """Check every invariant.

        Raises
        ------
        InputError
            Naming the first array at fault, and what is wrong with it.
        """
        for fault in self.faults():
            raise InputError(fault)

    def faults(self) -> Iterator[str]:
        """Yield what is wrong, each led by the array's name in a file: ``free_ix``."""
        for name, dtype in FREE_COLUMNS.items():
            column = getattr(self, name)
            if column.dtype != dtype:
                yield f"free_{name}: has dtype {column.dtype}; it must be {dtype}"
            size = {"ix": len(self.ix), "iy": len(self.ix), "start": len(self.ix) + 1}.get(
                name, len(self.iz)
            )
            if column.shape != (size,):
                yield f"free_{name}: has shape {column.shape}; it must be ({size},)"
        ascends: Bool = self.start[1:] > self.start[:-1]
        if self.start[0] != 0 or self.start[-1] != self.size or not ascends.all():
            yield f"free_start: must ascend from 0 to {self.size}, each more than the last"
        keys = pack(self.ix, self.iy)
        if np.any(keys[1:] <= keys[:-1]):
            yield "free_ix, free_iy: cells are not sorted by (ix, iy), each once"
        ascends = self.iz[1:] > self.iz[:-1]
        ascends[self.start[1:-1] - 1] = True
        if not ascends.all():
            yield "free_iz: does not ascend in each cell"
        if np.any(self.lines == 0):
            yield "free_lines: holds 0; it must be 1 or more"


def voxels_at(xyz: Float64, cell_size: float) -> tuple[Int64, Int64, Int64]:
    """Return the voxels in which places (N, 3) lie, as indices ix, iy, iz, int64 (N,).

    Places beyond all indices, and such as are not finite, are given the least int64.
    """
    sides = cell_size, cell_size, cell_size / 2
    indices = [np.floor(xyz[:, axis] / side) for axis, side in enumerate(sides)]
    far = np.iinfo(np.int64).min
    x, y, z = (np.where(np.abs(index) < 2.0**53, index, far).astype(np.int64) for index in indices)
    return x, y, z


@kernel
def _found(
    keys: UInt64, iz: Int32, cells: UInt64, start: Int64, height: Int32, lines: UInt8
) -> UInt8:
    """Return the counts of voxels, uint8 (N,).

    Parameters
    ----------
    keys : uint64 (N,)
        Packed keys of their cells.
    iz : int32 (N,)
    cells : uint64 (C,)
        Packed keys of the cells of the free space.
    start, height, lines
        Its voxels: `start`, `iz` and `lines` of `FreeSpace`.
    """
    found = np.zeros(len(keys), dtype=np.uint8)
    for n in range(len(keys)):
        cell = place_of(cells, keys[n])
        if cell == len(cells) or cells[cell] != keys[n]:
            continue
        begin, end = start[cell], start[cell + 1]
        while begin < end:
            middle = (begin + end) // 2
            if height[middle] < iz[n]:
                begin = middle + 1
            else:
                end = middle
        if begin < start[cell + 1] and height[begin] == iz[n]:
            found[n] = lines[begin]
    return found


@kernel
def _added(
    keys: UInt64,
    start: Int64,
    iz: Int32,
    lines: UInt8,
    other_keys: UInt64,
    other_start: Int64,
    other_iz: Int32,
    other_lines: UInt8,
) -> tuple[UInt64, Int64, Int32, UInt8]:
    """Return the sum of two free spaces, its cells as packed keys.

    Parameters
    ----------
    keys : uint64 (C,)
        Packed keys of the cells of the one.
    start, iz, lines
        As in `FreeSpace`.
    other_keys, other_start, other_iz, other_lines
        The same of the other.
    """
    cells = np.empty(len(keys) + len(other_keys), dtype=np.uint64)
    begins = np.zeros(len(cells) + 1, dtype=np.int64)
    both_iz = np.empty(len(iz) + len(other_iz), dtype=np.int32)
    both_lines = np.empty(len(both_iz), dtype=np.uint8)
    size = one = other = i = j = 0
    voxel = 0
    while one < len(keys) or other < len(other_keys):
        mine = one < len(keys) and (other == len(other_keys) or keys[one] <= other_keys[other])
        its = other < len(other_keys) and (one == len(keys) or other_keys[other] <= keys[one])
        cells[size] = keys[one] if mine else other_keys[other]
        end = start[one + 1] if mine else i
        other_end = other_start[other + 1] if its else j
        while i < end or j < other_end:
            first = i < end and (j == other_end or iz[i] <= other_iz[j])
            second = j < other_end and (i == end or other_iz[j] <= iz[i])
            both_iz[voxel] = iz[i] if first else other_iz[j]
            count = (int(lines[i]) if first else 0) + (int(other_lines[j]) if second else 0)
            both_lines[voxel] = min(count, MOST_LINES)
            i, j = i + first, j + second
            voxel += 1
        one, other = one + mine, other + its
        size += 1
        begins[size] = voxel
    return cells[:size], begins[: size + 1], both_iz[:voxel], both_lines[:voxel]
