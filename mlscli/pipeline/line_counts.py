"""Through which voxels sight lines pass, counted.

A sight line runs from where the craft was, if that is known, to a point as the stages on points
left it. As points have errors, it ends the side of a cell before its point. It passes through a
voxel (see `mlscli.maps.free_space`) if part of it lies inside: along the sides of voxels, and
through their edges and corners, it passes through none.

Both ends are rounded to 1/65,536 of a voxel's sides. All else is done in whole numbers: exact, and
the same from every side. Voxels are visited in their order along the line (J. Amanatides and
A. Woo, *A Fast Voxel Traversal Algorithm for Ray Tracing*, Eurographics 1987,
doi:10.2312/egtp.19871000); where a line leaves through an edge or a corner, it steps along two or
three axes at once.

Counts add and stop at 255, so neither the order of points nor how they are divided matters. They
are kept in blocks of 8 x 8 x 8 voxels, of which only those exist that a line passed through.
"""

from __future__ import annotations

import os
from typing import Any

import numpy as np

from mlscli.errors import UsageError
from mlscli.keyframes.batches import Points
from mlscli.maps.free_space import FREE_COLUMNS, MOST_LINES, FreeSpace
from mlscli.maps.order import OccupiedCells
from mlscli.maps.patches import runs
from mlscli.runtime.arrays import ZERO, Float64, Int32, Int64, UInt8
from mlscli.runtime.kernels import inner, kernel

# Parts of a voxel's side, to which the ends of lines are rounded: 2 to this power.
_BITS = 16
_SIDE = 1 << _BITS
# A line through more voxels along one axis is left out: products of its lengths fit into int64.
LONGEST = 2**15
# Where indices of voxels end, as those of cells do.
_FARTHEST = 2.0**31

# A block is so wide, 2 to this power; and the voxels in it.
_BLOCK = 3
_WITHIN = 7
_IN_BLOCK = 512

# Bytes of a block with its key and its places in the table; of a voxel that is listed, of a cell.
_PER_BLOCK, _PER_VOXEL, _PER_CELL = _IN_BLOCK + 12 + 32, 5, 16

# Lines are followed so many at a time: in between, an interrupt is heard.
_AT_A_TIME = 2**16


class NoRoomError(UsageError):
    """Free space takes more memory than there is for it.

    Parameters
    ----------
    least : int
        Bytes that it takes at least.
    most : int
        Bytes that it may take.
    """

    def __init__(self, least: int, most: int) -> None:
        super().__init__(
            f"`free_space`: takes more than {least // 2**20:,}M of memory, and there is room for "
            f"{most // 2**20:,}M; a larger map.cell_size takes less, and so does a crop"
        )
        self.least = least


class LineCounts:
    """Counts how many sight lines pass through each voxel.

    Parameters
    ----------
    cell_size : float
        Side of a cell, in the unit of the recording.
    most : int, optional
        Bytes of memory that it may take; by default half of what the machine has.

    Attributes
    ----------
    left_out : int
        Lines that were not followed: longer than `LONGEST` voxels, or from beyond all cells.
    """

    def __init__(self, cell_size: float, most: int | None = None) -> None:
        self.left_out = 0
        self._cell_size = cell_size
        self._most = _half_of_memory() if most is None else most
        self._size = 0
        self._blocks = np.zeros((0, 3), dtype=np.int32)
        self._lines = np.zeros((0, _IN_BLOCK), dtype=np.uint8)
        self._table = np.full(1, -1, dtype=np.int64)

    def add(self, points: Points, route: Float64) -> None:
        """Follow the lines to points.

        Parameters
        ----------
        points : Points
            As the stages on points left them.
        route : float64 (K, 4)
            Time, x, y, z of the craft for each keyframe; NaN where not known: no line.

        Raises
        ------
        NoRoomError
            Where the memory does not suffice.
        """
        craft = np.ascontiguousarray(route[:, 1:])
        done = 0
        while done < points.size:
            part = slice(done, done + _AT_A_TIME)
            followed, self._size, left_out, needed = _follow(
                points.xyz[part], points.keyframe[part], craft, self._cell_size,
                self._table, self._blocks, self._lines, self._size,
            )  # fmt: skip
            self.left_out += left_out
            done += followed
            if needed:
                self._make_room(self._size + needed)

    def _make_room(self, least: int) -> None:
        """Make room for so many blocks, and for more if the memory allows."""
        if least * _PER_BLOCK > self._most:
            raise NoRoomError(least * _PER_BLOCK, self._most)
        room = min(max(least, 64, 3 * len(self._blocks) // 2), self._most // _PER_BLOCK)
        room = max(room, least)
        # In place: nothing else holds these arrays.
        self._blocks.resize((room, 3), refcheck=False)
        self._lines.resize((room, _IN_BLOCK), refcheck=False)
        self._table = np.full(1 << (2 * room - 1).bit_length(), -1, dtype=np.int64)
        _enter(self._table, self._blocks, self._size)

    def free_space(self) -> FreeSpace:
        """Return the counts, listed.

        Raises
        ------
        NoRoomError
            Where the memory does not suffice.
        """
        blocks, lines = self._blocks[: self._size], self._lines[: self._size]
        order = np.lexsort(blocks.T[::-1])
        columns = OccupiedCells.of(blocks[order, 0], blocks[order, 1])
        there = blocks, lines, order, columns, runs(columns.ix)
        cells, voxels = _list(*there, *_room_for(0, 0), False)
        least = self._size * _PER_BLOCK + voxels * _PER_VOXEL + cells * _PER_CELL
        if least > self._most:
            raise NoRoomError(least, self._most)
        made = _room_for(cells, voxels)
        _list(*there, *made, True)
        return FreeSpace(*made)


def _room_for(cells: int, voxels: int) -> tuple[Int32, Int32, Int64, Int32, UInt8]:
    """Return the arrays of `FreeSpace`, not yet filled."""
    made: Any = {
        name: np.zeros({"iz": voxels, "lines": voxels, "start": cells + 1}.get(name, cells), dtype)
        for name, dtype in FREE_COLUMNS.items()
    }
    return made["ix"], made["iy"], made["start"], made["iz"], made["lines"]


def _half_of_memory() -> int:
    """Return half of the machine's memory in bytes; 2 GiB where it does not say."""
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") // 2
    except (ValueError, OSError):
        return 2**31


@kernel
def _follow(
    xyz: Float64,
    keyframe: Int32,
    craft: Float64,
    cell_size: float,
    table: Int64,
    blocks: Int32,
    lines: UInt8,
    size: int,
) -> tuple[int, int, int, int]:
    """Follow the lines to points, as far as there is room.

    Parameters
    ----------
    xyz : float64 (N, 3)
    keyframe : int32 (N,)
        Of the points.
    craft : float64 (K, 3)
        Where the craft was in each keyframe; NaN where not known.
    cell_size : float
    table : int64 (H,)
        The number of a block, at or after the place that its indices give; -1: none. H is a power
        of 2.
    blocks : int32 (B, 3)
        The indices of the blocks.
    lines : uint8 (B, 512)
        The counts of their voxels.
    size : int
        How many blocks there are.

    Returns
    -------
    followed : int
        How many points were done with.
    size : int
        How many blocks there are now.
    left_out : int
        How many lines were left out.
    needed : int
        For how many more blocks there must be room to go on; 0: all is done.
    """
    left_out = ZERO
    first, last = np.empty(3, dtype=np.int64), np.empty(3, dtype=np.int64)
    for i in range(len(xyz)):
        at = craft[keyframe[i]]
        dx, dy, dz = xyz[i, 0] - at[0], xyz[i, 1] - at[1], xyz[i, 2] - at[2]
        length = np.sqrt(dx * dx + dy * dy + dz * dz)
        # Not where the position is not known, either.
        if not length > cell_size:
            continue
        share, inside = cell_size / length, True
        for axis in range(3):
            side = cell_size / 2 if axis == 2 else cell_size
            begin = at[axis] / side
            end = (xyz[i, axis] - (xyz[i, axis] - at[axis]) * share) / side
            inside &= abs(begin) < _FARTHEST - 1 and abs(end) < _FARTHEST - 1
            inside &= abs(end - begin) < LONGEST
            if inside:
                first[axis], last[axis] = np.rint(begin * _SIDE), np.rint(end * _SIDE)
        if not inside:
            left_out += 1
            continue
        needed = _blocks_between(first, last)
        if size + needed > len(blocks):
            return i, size, left_out, needed
        size = _pass(first, last, table, blocks, lines, size)
    return len(xyz), size, left_out, ZERO


@inner
def _blocks_between(first: Int64, last: Int64) -> int:
    """Return through how many blocks a line passes at most."""
    blocks = 1
    for axis in range(3):
        blocks += abs((first[axis] >> _BITS + _BLOCK) - (last[axis] >> _BITS + _BLOCK)) + 1
    return blocks


@inner
def _ends(begin: int, end: int) -> tuple[int, int, int, int]:
    """Return how a line goes along one axis.

    Parameters
    ----------
    begin, end : int
        In parts of a voxel's side.

    Returns
    -------
    voxel : int
        The index of its first voxel.
    step : int
        1 or -1.
    borders : int
        How many borders of voxels it crosses; -1: it runs along one.
    before : int
        How far the first border is, in parts of a side.
    """
    if end > begin:
        voxel = begin >> _BITS
        return voxel, 1, ((end - 1) >> _BITS) - voxel, ((voxel + 1) << _BITS) - begin
    if end < begin:
        voxel = (begin - 1) >> _BITS
        return voxel, -1, voxel - (end >> _BITS), begin - (voxel << _BITS)
    return begin >> _BITS, 1, -1 if begin & (_SIDE - 1) == 0 else 0, _SIDE


@inner
def _pass(first: Int64, last: Int64, table: Int64, blocks: Int32, lines: UInt8, size: int) -> int:
    """Count a line in the voxels that it passes through; return how many blocks there are then.

    Parameters
    ----------
    first, last : int64 (3,)
        Its ends, in parts of the sides of voxels.
    table, blocks, lines, size
        As in `_follow`; there is room for the blocks.
    """
    x, step_x, borders_x, before_x = _ends(first[0], last[0])
    y, step_y, borders_y, before_y = _ends(first[1], last[1])
    z, step_z, borders_z, before_z = _ends(first[2], last[2])
    long_x, long_y, long_z = (
        abs(last[0] - first[0]), abs(last[1] - first[1]), abs(last[2] - first[2])
    )  # fmt: skip
    if min(borders_x, borders_y, borders_z) < 0 or long_x + long_y + long_z == 0:
        return size
    left = borders_x + borders_y + borders_z
    # Which of two axes has its next border first: below 0 the one named first, 0 both at once.
    xy = before_x * long_y - before_y * long_x
    xz = before_x * long_z - before_z * long_x
    yz = before_y * long_z - before_z * long_y
    long_x, long_y, long_z = long_x << _BITS, long_y << _BITS, long_z << _BITS
    block, number = (x >> _BLOCK, y >> _BLOCK, z >> _BLOCK), -1
    while True:
        here = (x >> _BLOCK, y >> _BLOCK, z >> _BLOCK)
        if number < 0 or here != block:
            block = here
            number = _number_of(block, table, blocks, size)
            size = max(size, number + 1)
        voxel = (((x & _WITHIN) << _BLOCK | (y & _WITHIN)) << _BLOCK) | (z & _WITHIN)
        lines[number, voxel] += lines[number, voxel] < MOST_LINES
        if left == 0:
            return size
        on_x, on_y, on_z = xy <= 0 and xz <= 0, xy >= 0 and yz <= 0, xz >= 0 and yz >= 0
        if on_x:
            x, left, xy, xz = x + step_x, left - 1, xy + long_y, xz + long_z
        if on_y:
            y, left, xy, yz = y + step_y, left - 1, xy - long_x, yz + long_z
        if on_z:
            z, left, xz, yz = z + step_z, left - 1, xz - long_x, yz - long_y


@inner
def _number_of(block: tuple[int, int, int], table: Int64, blocks: Int32, size: int) -> int:
    """Return the number of a block; where there is none yet, it gets the next: `size`."""
    x, y, z = block
    place = _place(x, y, z, len(table))
    while table[place] >= 0:
        number = table[place]
        if blocks[number, 0] == x and blocks[number, 1] == y and blocks[number, 2] == z:
            return int(number)
        place = (place + 1) & (len(table) - 1)
    table[place] = size
    blocks[size, 0], blocks[size, 1], blocks[size, 2] = x, y, z
    return size


@inner
def _place(x: int, y: int, z: int, size: int) -> int:
    """Return where in a table of a size, a power of 2, a block belongs."""
    mixed = np.uint64(x) * np.uint64(0x9E3779B97F4A7C15)
    mixed = (mixed ^ np.uint64(y)) * np.uint64(0xC2B2AE3D27D4EB4F)
    mixed = (mixed ^ np.uint64(z)) * np.uint64(0x165667B19E3779F9)
    return np.int64(mixed >> np.uint64(20)) & (size - 1)  # type: ignore[return-value]


@kernel
def _enter(table: Int64, blocks: Int32, size: int) -> None:
    """Enter the first `size` blocks into an empty table."""
    for number in range(size):
        place = _place(blocks[number, 0], blocks[number, 1], blocks[number, 2], len(table))
        while table[place] >= 0:
            place = (place + 1) & (len(table) - 1)
        table[place] = number


@kernel
def _list(
    blocks: Int32,
    lines: UInt8,
    order: Int64,
    columns: OccupiedCells,
    bands: Int64,
    ix: Int32,
    iy: Int32,
    start: Int64,
    iz: Int32,
    count: UInt8,
    fill: bool,
) -> tuple[int, int]:
    """List the voxels that lines passed through, by cell, and return how many cells and voxels.

    Parameters
    ----------
    blocks, lines
        As in `_follow`.
    order : int64 (B,)
        The numbers of the blocks, ascending by their indices.
    columns : OccupiedCells
        The blocks that lie above each other, in this order.
    bands : int64 (X + 1,)
        Where the columns of each index along x begin.
    ix, iy, start, iz, count
        Receive what `FreeSpace` holds, if `fill` is True.
    fill : bool
    """
    cells = voxels = ZERO
    for band in range(len(bands) - 1):
        for x in range(_WITHIN + 1):
            for column in range(bands[band], bands[band + 1]):
                for y in range(_WITHIN + 1):
                    begin, row = voxels, ((x << _BLOCK) | y) << _BLOCK
                    for n in range(columns.start[column], columns.start[column + 1]):
                        block = order[n]
                        for z in range(_WITHIN + 1):
                            if lines[block, row + z] == 0:
                                continue
                            if fill:
                                iz[voxels] = (np.int64(blocks[block, 2]) << _BLOCK) + z
                                count[voxels] = lines[block, row + z]
                            voxels += 1
                    if voxels == begin:
                        continue
                    if fill:
                        ix[cells] = (np.int64(columns.ix[column]) << _BLOCK) + x
                        iy[cells] = (np.int64(columns.iy[column]) << _BLOCK) + y
                        start[cells + 1] = voxels
                    cells += 1
    return cells, voxels
