"""`cell_size: auto` of a cloud that is larger than memory: the same number, to the digit.

The points lie on disk in blocks, and the distances to their neighbours are found tile by tile. What
lies beyond a tile's margin is farther away than the margin is wide: distances up to that are
certain, the others no shorter than it. So the median is certain where it is no longer.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from mlscli.cell_size import auto_cell_size, cell_size_for, neighbour_distances, require_enough
from mlscli.errors import InputError
from mlscli.keyframes import FARTHEST, Points
from mlscli.pipeline.blocks import SHIFT, PointBlocks
from mlscli.pipeline.memory import Memory
from mlscli.pipeline.ordering import cells_of
from mlscli.pipeline.pipeline import Progress
from mlscli.pipeline.tilewise import Tile
from mlscli.scratch import Scratch, Stored
from mlscli.typing import Float64

# Bytes of memory that it takes at most to find the distances of a point.
FOUND = 200

# Margins in cells, mostly some ten times as wide as the median: at first, and how much wider then.
REACH, WIDER = 8, 8

# So many points tell about how large cells are.
SAMPLE = 20_000

# The smallest cells of which the grid holds every point.
_FINEST = FARTHEST / 2**30

# Bits of a distance that are settled at a time.
_BITS = 16


def put_in_blocks(clouds: Iterable[Float64], memory: Memory, disk: Scratch) -> PointBlocks:
    """Put the points of clouds (N, 3) on disk, in blocks of about as many as there would be."""
    clouds = iter(clouds)
    first = _taken(clouds, SAMPLE)
    blocks = _blocks_for(first, disk)
    load = first
    while len(load):
        blocks.add(Points(load, np.zeros(len(load), dtype=np.int32)))
        load = _taken(clouds, memory.sortable(blocks))
    return blocks


def large_cell_size(
    blocks: PointBlocks, memory: Memory, disk: Scratch, progress: Progress | None = None
) -> float:
    """Return what `auto_cell_size` does for all points of the blocks.

    Parameters
    ----------
    blocks : PointBlocks
        From `put_in_blocks`.
    memory : Memory
        For the points of a tile.
    disk : Scratch
        For a distance of each point.
    progress : callable, optional
        Called with ``cell size``, how many points are done, and how many there are.

    Raises
    ------
    InputError
        As `auto_cell_size`.
    UsageError
        There is too little memory.
    """
    number = int(blocks.occupied().points.sum())
    require_enough(number)
    reach = REACH
    while True:
        tiles = memory.tiles(blocks, reach, FOUND)
        parts, done = [], 0
        for tile in tiles:
            distances = _distances(blocks, tile, reach)
            parts.append(_Part(disk.put(distances), len(distances)))
            done += len(distances)
            if progress is not None:
                progress("cell size", done, number)
        median = (_ranked(parts, (number - 1) // 2) + _ranked(parts, number // 2)) / 2
        # A cell less: which cell a point is in is rounded. One tile has nothing beyond it.
        if median <= (reach - 1) * blocks.cell_size or len(tiles) == 1:
            return cell_size_for(median)
        reach *= WIDER


class _Part(NamedTuple):
    """Some of the distances, on disk."""

    distances: Stored
    number: int


def _taken(clouds: Iterator[Float64], most: int) -> Float64:
    """Return the points of the next clouds, until they are so many."""
    taken, number = [np.empty((0, 3))], 0
    for xyz in clouds:
        taken.append(xyz)
        number += len(xyz)
        if number >= most:
            break
    return np.concatenate(taken)


def _blocks_for(xyz: Float64, disk: Scratch) -> PointBlocks:
    """Return blocks about as wide as those of the map, as far as some of its points tell."""
    try:
        size = auto_cell_size(xyz[:: len(xyz) // SAMPLE + 1])
    except InputError:
        # Any will do, if not as well.
        size = 1.0
    cell = max(size, _FINEST)
    return PointBlocks(cell, disk.put, max(0, SHIFT + round(math.log2(size / cell))))


def _distances(blocks: PointBlocks, tile: Tile, reach: int) -> Float64:
    """Return the distances of a tile's points to their neighbours, in the tile or its margin."""
    xyz = blocks.extract(tile.limits.widened(reach)).xyz
    return neighbour_distances(xyz, tile.limits.contain(*cells_of(xyz, blocks.cell_size)))


def _ranked(parts: Sequence[_Part], rank: int) -> float:
    """Return the distance that so many others come before in order of size."""
    # Numbers that are not negative sort as their bits do.
    known = 0
    for shift in range(64 - _BITS, -1, -_BITS):
        counts = np.zeros(2**_BITS, dtype=np.int64)
        for part in parts:
            bits = part.distances[0 : part.number].view(np.uint64) >> np.uint64(shift)
            bits = bits[bits >> np.uint64(_BITS) == known] & np.uint64(2**_BITS - 1)
            counts += np.bincount(bits.astype(np.int64), minlength=2**_BITS)
        below = np.cumsum(counts)
        digit = int(np.searchsorted(below, rank, side="right"))
        rank -= int(below[digit] - counts[digit])
        known = known << _BITS | digit
    return float(np.uint64(known).view(np.float64))
