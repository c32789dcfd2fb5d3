"""Points in the order of their cells: a radix sort of packed keys, then the heights in each cell.

Points are first divided into bands of columns, so many that each band can be sorted in the cache,
by one thread. A key holds both cell indices, counted from the least of the band, in as few bits as
they need: cells that lie close together, as in most recordings, are sorted in two passes.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from mlscli.maps.order import OccupiedCells
from mlscli.runtime.arrays import Array, Float64, Int32, Int64, UInt32, UInt64
from mlscli.runtime.kernels import inner, kernel
from mlscli.runtime.sorting import sort_along
from mlscli.runtime.threads import LIGHT, in_ranges

# About so many points make a band: they can be sorted in the cache.
_IN_BAND = 4096
# Bits that a pass sorts by: more buckets would not stay in the nearest cache.
_BITS = 9
# The fewest bits of a key that hold a rough height.
_ROUGHLY = 8
# Insertion sort pays while a height moves by at most so many places on average.
_PATIENCE_PLACES = 16


class Ordered(NamedTuple):
    """Points ordered by (ix, iy, z).

    Attributes
    ----------
    order : uint32 (N,)
        The number of the point that comes at each place; int64 for 2^32 points or more.
    cells : OccupiedCells
        The occupied cells, and the places at which their points begin.
    z : float64 (N,)
        The height of the point at each place.
    """

    order: Array
    cells: OccupiedCells
    z: Float64


def cells_of(xyz: Float64, size: float) -> tuple[Int32, Int32]:
    """Return cell indices (ix, iy) of points, ``floor(x / size)``, int32 (N,); they must fit.

    Parameters
    ----------
    xyz : float64 (N, 3)
        Coordinates.
    size : float
        Side of a cell, in the same unit.
    """
    ix, iy = np.empty((2, len(xyz)), dtype=np.int32)
    in_ranges(
        len(xyz),
        lambda begin, end: _locate(xyz[begin:end], size, ix[begin:end], iy[begin:end]),
        weight=LIGHT,
    )
    return ix, iy


def order_by_cell(ix: Int32, iy: Int32, z: Float64) -> Ordered:
    """Return points ordered by cell, and by height in each cell.

    Parameters
    ----------
    ix, iy : int32 (N,)
        Cell indices of the points.
    z : float64 (N,)
        Heights of the points.
    """
    # Contiguous heights: fewer cache lines are fetched, and the kernel is compiled for one type.
    z = np.ascontiguousarray(z)
    # Only in clouds of 100 GB does the number of a point need more than 4 bytes.
    order = np.arange(len(ix), dtype=np.uint32 if len(ix) < 2**32 else np.int64)
    bands, heights = np.array([0, len(ix)]), np.empty(len(ix))
    if len(ix) >= 2 * _IN_BAND:
        bands = _put_into_bands(ix, len(ix) // _IN_BAND, order)

    def order_bands(begin: int, end: int) -> tuple[Int32, Int32, Int64]:
        found: tuple[Int32, Int32, Int64] = _order_bands(
            bands[begin : end + 1], order, ix, iy, z, heights
        )
        return found

    several = len(bands) - 1
    parts = in_ranges(several, order_bands, weight=LIGHT * len(ix) / several)
    if len(parts) == 1:
        return Ordered(order, OccupiedCells(*parts[0]), heights)
    # Each part begins where the one before ends.
    x, y, start = zip(*((*part[:2], part[2][:-1]) for part in parts), strict=True)
    starts = np.concatenate((*start, [len(ix)]))
    return Ordered(order, OccupiedCells(np.concatenate(x), np.concatenate(y), starts), heights)


@kernel
def _locate(xyz: Float64, size: float, ix: Int32, iy: Int32) -> None:
    for i in range(len(xyz)):
        ix[i] = np.int32(np.floor(xyz[i, 0] / size))
        iy[i] = np.int32(np.floor(xyz[i, 1] / size))


@kernel
def _put_into_bands(ix: Int32, most: int, order: Array) -> Int64:
    """Write the numbers of points into `order`, band by band; return where the bands begin and end.

    There are at most `most` bands, which are several. The number of columns of a band is a power of
    2. The points of a band keep their order.
    """
    least, greatest = _ends(ix)
    width, shift = int(greatest) - int(least), 0
    while width >> shift >= most:
        shift += 1
    bands = (width >> shift) + 1
    start = np.zeros(bands + 1, dtype=np.int64)
    for i in range(len(ix)):
        start[((ix[i] - least) >> shift) + 1] += 1
    for band in range(bands):
        start[band + 1] += start[band]
    place = start.copy()
    for i in range(len(ix)):
        band = (ix[i] - least) >> shift
        order[place[band]] = i
        place[band] += 1
    return start


@kernel
def _order_bands(
    bands: Int64, order: Array, ix: Int32, iy: Int32, z: Float64, heights: Float64
) -> tuple[Int32, Int32, Int64]:
    """Order the points of some bands.

    Parameters
    ----------
    bands : int64 (B + 1,)
        Where the bands begin in `order`, and the end of the last.
    order : uint32 or int64 (N,)
        The numbers of points by bands; ordered in place.
    ix, iy : int32 (N,)
        Cell indices of the points, by number.
    z : float64 (N,)
        Heights of the points, by number.
    heights : float64 (N,)
        Receives the height at each place of these bands.

    Returns
    -------
    ix, iy : int32 (C,)
        The cells of the bands, ascending.
    start : int64 (C + 1,)
        The places at which the points of each cell begin, and the end of the last.
    """
    most = bands[-1] - bands[0]
    cell_x, cell_y = np.empty(most, dtype=np.int32), np.empty(most, dtype=np.int32)
    starts, cells = np.empty(most + 1, dtype=np.int64), 0
    for band in range(len(bands) - 1):
        begin, end = bands[band], bands[band + 1]
        # Values that lie far apart in memory are fetched once only.
        numbers = order[begin:end].copy()
        x, y = np.empty(end - begin, dtype=np.int32), np.empty(end - begin, dtype=np.int32)
        fetched = np.empty(end - begin)
        for i in range(end - begin):
            number = numbers[i]
            x[i], y[i], fetched[i] = ix[number], iy[number], z[number]
        keys, shift = _packed(x, y, fetched)
        keys, places = _sorted(keys, _numbers(end - begin))
        for i in range(end - begin):
            order[begin + i], heights[begin + i] = numbers[places[i]], fetched[places[i]]
        start = _starts(keys, np.uint64(shift), begin)
        for run in range(len(start) - 1):
            place = places[start[run] - begin]
            cell_x[cells], cell_y[cells], starts[cells] = x[place], y[place], start[run]
            cells += 1
        _ascend(start, order, heights)
    starts[cells] = bands[-1]
    return cell_x[:cells].copy(), cell_y[:cells].copy(), starts[: cells + 1].copy()


@inner
def _packed(x: Int32, y: Int32, z: Float64) -> tuple[UInt64, int]:
    """Return keys that ascend with (x, y), and by how many bits a cell is shifted in them.

    The bits below the cell, `_ROUGHLY` and those left over in the last pass, hold a rough height:
    sorted by it, few points of a cell are out of order.
    """
    keys = np.empty(len(x), dtype=np.uint64)
    if len(x) == 0:
        return keys, 0
    (west, east), (south, north), (lowest, highest) = _ends(x), _ends(y), _ends(z)
    width_y = _bits(int(north) - int(south))
    width = width_y + _bits(int(east) - int(west))
    shift = min(64, -(-(width + _ROUGHLY) // _BITS) * _BITS) - width
    extent = highest - lowest
    steps = (2.0**shift - 1) / extent if 1e-200 < extent < 1e200 else 0.0
    for i in range(len(keys)):
        cell = (np.int64(x[i]) - west) << width_y | (np.int64(y[i]) - south)
        rough = (z[i] - lowest) * steps if steps > 0 else 0.0
        keys[i] = np.uint64(cell) << np.uint64(shift) | np.uint64(rough)
    return keys, shift


@inner
def _ends(values: Array) -> tuple[Any, Any]:
    """Return the least and the greatest value."""
    least, greatest = values[0], values[0]
    for value in values:
        least, greatest = min(least, value), max(greatest, value)
    return least, greatest


@inner
def _numbers(size: int) -> UInt32:
    """Return the numbers from 0 on, uint32 (size,)."""
    numbers = np.empty(size, dtype=np.uint32)
    for i in range(size):
        numbers[i] = i
    return numbers


@inner
def _bits(value: int) -> int:
    """Return how many bits a number needs."""
    bits = 0
    while value >> bits:
        bits += 1
    return bits


@inner
def _sorted(keys: UInt64, order: Array) -> tuple[UInt64, Array]:
    """Return keys in ascending order, and the numbers that go with them (a stable radix sort).

    The arrays given are overwritten. Each pass puts the keys into buckets by some of their bits,
    the lowest first.
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


@inner
def _starts(keys: UInt64, below: np.uint64, begin: int) -> Int64:
    """Return where runs of keys begin that are equal above their lowest `below` bits, and the end.

    Places are counted from `begin`.
    """
    start = np.empty(len(keys) + 1, dtype=np.int64)
    runs = 0
    for i in range(len(keys)):
        if i == 0 or keys[i] >> below != keys[i - 1] >> below:
            start[runs] = begin + i
            runs += 1
    start[runs] = begin + len(keys)
    return start[: runs + 1]


@inner
def _ascend(start: Int64, order: Array, heights: Float64) -> None:
    """Order the points of each run by height, in place; `start` is as `_starts` returns it."""
    for run in range(len(start) - 1):
        begin, end = start[run], start[run + 1]
        patience = _PATIENCE_PLACES * (end - begin)
        for i in range(begin + 1, end):
            height, point = heights[i], order[i]
            j = i
            while j > begin and heights[j - 1] > height:
                heights[j], order[j] = heights[j - 1], order[j - 1]
                j -= 1
            heights[j], order[j] = height, point
            patience -= i - j
            if patience < 0:
                sort_along(heights[begin:end], order[begin:end])
                break
