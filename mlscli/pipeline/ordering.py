"""Points in the order of their cells: a radix sort of packed keys, then the heights in each cell.

A key holds both cell indices, counted from the least, in as few bits as they need: cells that lie
close together, as those of most recordings do, are sorted in two passes over the points.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mlscli.kernels import kernel
from mlscli.threads import LIGHT, in_ranges
from mlscli.typing import Array, Float64, Int32, Int64, UInt64

# Bits that a pass sorts by: more buckets would not stay in the nearest cache.
_BITS = 9
# Least bits by which heights are sorted before.
_ROUGHLY = 8
# Sorting by insertion pays where a height moves by so many places on the average.
_PATIENCE = 16


class Ordered(NamedTuple):
    """Points ordered by (ix, iy, z).

    Attributes
    ----------
    order : uint32 (N,)
        The number of the point that comes at each place.
    start : int64 (C + 1,)
        The points of occupied cell c are at the places ``start[c]`` to ``start[c + 1]``.
    z : float64 (N,)
        Their heights.
    """

    order: Array
    start: Int64
    z: Float64


def cells_of(xyz: Float64, size: float) -> tuple[Int32, Int32]:
    """Return the cell indices of points (N, 3), which int32 can hold: ``floor(x / size)``."""
    ix, iy = np.empty((2, len(xyz)), dtype=np.int32)
    in_ranges(
        len(xyz),
        lambda begin, end: _locate(xyz[begin:end], size, ix[begin:end], iy[begin:end]),
        weight=LIGHT,
    )
    return ix, iy


def order_by_cell(ix: Int32, iy: Int32, z: Float64) -> Ordered:
    """Order points by cell and by height in each cell."""
    # No point needs more than 4 bytes for its number but in clouds that fill 100 GB.
    order = np.arange(len(ix), dtype=np.uint32 if len(ix) < 2**32 else np.int64)
    order, start = _by_cell(ix, iy, z, order)
    heights = np.empty(len(order))
    in_ranges(
        len(start) - 1,
        lambda begin, end: _ascend(start[begin : end + 1], order, z, heights),
        weight=LIGHT,
    )
    return Ordered(order, start, heights)


@kernel
def _locate(xyz: Float64, size: float, ix: Int32, iy: Int32) -> None:
    for i in range(len(xyz)):
        ix[i] = np.int32(np.floor(xyz[i, 0] / size))
        iy[i] = np.int32(np.floor(xyz[i, 1] / size))


@kernel
def _by_cell(ix: Int32, iy: Int32, z: Float64, order: Array) -> tuple[Array, Int64]:
    """Order points by cell and roughly by height; return where those of each cell begin, too."""
    keys, shift = _packed(ix, iy, z)
    keys, order = _sorted(keys, order)
    return order, _starts(keys, shift)


@kernel
def _packed(ix: Int32, iy: Int32, z: Float64) -> tuple[UInt64, int]:
    """Return keys that ascend with (ix, iy), and by how many bits a cell is shifted in them.

    Below the cell a height is told roughly, in `_ROUGHLY` bits and those that would be left over of
    the last pass: sorted by them, few points of a cell are out of order.
    """
    keys = np.empty(len(ix), dtype=np.uint64)
    if len(ix) == 0:
        return keys, 0
    least_x, least_y, lowest = int(ix.min()), int(iy.min()), z.min()
    width_y = _bits(int(iy.max()) - least_y)
    width = width_y + _bits(int(ix.max()) - least_x)
    shift = min(64, -(-(width + _ROUGHLY) // _BITS) * _BITS) - width
    extent = z.max() - lowest
    steps = (2.0**shift - 1) / extent if 1e-200 < extent < 1e200 else 0.0
    for i in range(len(ix)):
        cell = (np.int64(ix[i]) - least_x) << width_y | (np.int64(iy[i]) - least_y)
        rough = (z[i] - lowest) * steps if steps > 0 else 0.0
        keys[i] = np.uint64(cell) << np.uint64(shift) | np.uint64(rough)
    return keys, shift


@kernel
def _bits(value: int) -> int:
    """Return how many bits a number needs."""
    bits = 0
    while value >> bits:
        bits += 1
    return bits


@kernel
def _sorted(keys: UInt64, order: Array) -> tuple[UInt64, Array]:
    """Return keys in ascending order and the numbers that go with them; equal keys keep theirs.

    Both arrays given are used up. Each pass puts the keys into buckets by some of their bits, the
    lowest first.
    """
    highest = np.uint64(0)
    for key in keys:
        highest |= key
    bits = 0
    while bits < 64 and highest >> np.uint64(bits):
        bits += 1
    passes = (bits + _BITS - 1) // _BITS
    other_keys, other_order = np.empty_like(keys), np.empty_like(order)
    for turn in range(passes):
        low, high = bits * turn // passes, bits * (turn + 1) // passes
        shift, mask = np.uint64(low), np.uint64((1 << (high - low)) - 1)
        place = np.zeros((1 << (high - low)) + 1, dtype=np.int64)
        for key in keys:
            place[(key >> shift & mask) + np.uint64(1)] += 1
        for smaller in range(1 << (high - low)):
            place[smaller + 1] += place[smaller]
        for i in range(len(keys)):
            bucket = keys[i] >> shift & mask
            there = place[bucket]
            place[bucket] = there + 1
            other_keys[there], other_order[there] = keys[i], order[i]
        keys, other_keys = other_keys, keys
        order, other_order = other_order, order
    return keys, order


@kernel
def _starts(keys: UInt64, shift: int) -> Int64:
    """Return where runs of equal keys begin, and the end of the last."""
    below = np.uint64(shift)
    runs = min(len(keys), 1)
    for i in range(1, len(keys)):
        runs += keys[i] >> below != keys[i - 1] >> below
    start = np.empty(runs + 1, dtype=np.int64)
    start[0], start[runs] = 0, len(keys)
    run = 0
    for i in range(1, len(keys)):
        if keys[i] >> below != keys[i - 1] >> below:
            run += 1
            start[run] = i
    return start


@kernel
def _ascend(start: Int64, order: Array, z: Float64, heights: Float64) -> None:
    """Order the points of some runs by height, and note the heights."""
    for i in range(start[0], start[-1]):
        heights[i] = z[order[i]]
    for run in range(len(start) - 1):
        begin, end = start[run], start[run + 1]
        patience = _PATIENCE * (end - begin)
        for i in range(begin + 1, end):
            height, point = heights[i], order[i]
            j = i
            while j > begin and heights[j - 1] > height:
                heights[j], order[j] = heights[j - 1], order[j - 1]
                j -= 1
            heights[j], order[j] = height, point
            patience -= i - j
            if patience < 0:
                rank = np.argsort(heights[begin:end])
                heights[begin:end] = heights[begin:end][rank]
                order[begin:end] = order[begin:end][rank]
                break
