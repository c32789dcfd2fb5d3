"""Space under decks and behind windows that nobody looked into, column by column.

A **column** is the space between two successive levels of a cell, or that below a cell's lowest
level, as far down as the space beside it is known to go. It is found from the sides: where the
space of a cell reaches under the lowest level of the cell beside it by `RUN` voxels or more, it
goes on there, from cell to cell, until a wall ends it. To begin with, space above a ground counts
only where so many of its voxels were looked through: a cliff that nobody saw is no roof.

A column was **never looked into** where through `RUN` of its voxels in a row, three cells of
height, fewer lines than `least` passed; voxels within `EXPLAINED` of a level do not count, as lines
end a cell before their points. That is one of the rules by which a clearance calls space never
seen, see `mlscli.queries.looked`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mlscli.maps.cells import cell_of, key_of, unpack
from mlscli.maps.surface_map import SurfaceMap
from mlscli.queries.looked import RUN
from mlscli.queries.obstacles import Obstacles
from mlscli.queries.voxels import Voxels, column_from
from mlscli.runtime.arrays import Float64, Int32, Int64, UInt64
from mlscli.runtime.kernels import inner, kernel
from mlscli.runtime.sorting import place_of

EXPLAINED = 2
# The upper end of space above which there is no level.
_ABOVE = 2**62


class Unseen(NamedTuple):
    """Parts of columns that were never looked into.

    Attributes
    ----------
    ix, iy : int32 (N,)
        Their cells, ascending.
    low, high : float64 (N,)
        From where to where the longest run of unseen voxels reaches.
    """

    ix: Int32
    iy: Int32
    low: Float64
    high: Float64


def never_looked_into(surface: SurfaceMap, least: int = 2) -> Unseen:
    """Return the columns of a map, with free space, that nobody looked into.

    Parameters
    ----------
    surface : SurfaceMap
    least : int
        So many sight lines show that a voxel is free.
    """
    if not surface.size or surface.free is None:
        none = np.empty(0, dtype=np.int32)
        return Unseen(none, none, np.empty(0), np.empty(0))
    ends = int(surface.ix[0]), int(surface.ix[-1])
    obstacles = Obstacles.of(surface, *ends)
    half = surface.cell_size / 2
    low = np.floor(surface.low_end / half).astype(np.int64)
    high = np.floor(surface.height / half).astype(np.int64)
    space = Voxels.of(surface.free, *ends)
    cell = np.repeat(np.arange(len(obstacles.key)), np.diff(obstacles.start))
    bottom, top = high + 1, np.full(len(high), _ABOVE)
    shared = np.flatnonzero(cell[1:] == cell[:-1])
    top[shared] = low[shared + 1] - 1
    tall = np.flatnonzero(top - bottom + 1 >= RUN)
    # From the highest ground: what lies below it may be the ground itself.
    tall = tall[np.argsort(-bottom[tall], kind="stable")]
    below, floor = _below(obstacles, low, cell[tall], bottom[tall], top[tall], space, least)
    between = tall[top[tall] != _ABOVE]
    cell = np.concatenate((cell[between], below))
    bottom = np.concatenate((bottom[between], floor))
    top = np.concatenate((top[between], low[obstacles.start[below]] - 1))
    order = np.lexsort((bottom, cell))
    cell, bottom, top = cell[order], bottom[order], top[order]
    first, length = _longest(obstacles.key[cell], bottom + EXPLAINED, top - EXPLAINED, space, least)
    found = np.flatnonzero(length >= RUN)
    ix, iy = unpack(obstacles.key[cell[found]])
    run: Int64 = np.stack((first[found], first[found] + length[found]))
    low_end, high_end = run.astype(np.float64) * half
    return Unseen(ix, iy, low_end, high_end)


@kernel
def _below(
    obstacles: Obstacles,
    low: Int64,
    source: Int64,
    bottom: Int64,
    top: Int64,
    space: Voxels,
    least: int,
) -> tuple[Int64, Int64]:
    """Return the cells below whose lowest level there is a column, and its lowest voxel.

    Parameters
    ----------
    obstacles : Obstacles
        The map's patches by cells.
    low : int64 (P,)
        The lowest voxel that each patch reaches into.
    source, bottom, top : int64 (S,)
        Cells with space above a level, from their lowest to their highest voxel, in the order in
        which they spread: of several that reach under a level, the first counts.
    space : Voxels
    least : int
        So many lines make a voxel open.
    """
    cells = len(obstacles.key)
    reached = np.zeros(cells, dtype=np.bool_)
    waiting, ends = np.empty(cells + 1, dtype=np.int64), np.empty(cells + 1, dtype=np.int64)
    found, floor = np.empty(cells, dtype=np.int64), np.empty(cells, dtype=np.int64)
    known = 0
    for n in range(len(source)):
        held = 1
        waiting[0], ends[0] = source[n], top[n]
        while held > 0:
            held -= 1
            cell, end = waiting[held], ends[held]
            ix, iy = cell_of(obstacles.key[cell])
            for side in range(4):
                key = key_of(ix + (side == 0) - (side == 1), iy + (side == 2) - (side == 3))
                other = place_of(obstacles.key, key)
                if other == cells or obstacles.key[other] != key or reached[other]:
                    continue
                last = min(end, low[obstacles.start[other]] - 1)
                if last - bottom[n] + 1 < RUN:
                    continue
                if end == _ABOVE and not _is_open(ix, iy, bottom[n], last, space, least):
                    continue
                reached[other] = True
                found[known], floor[known] = other, bottom[n]
                known += 1
                waiting[held], ends[held] = other, low[obstacles.start[other]] - 1
                held += 1
    return found[:known], floor[:known]


@inner
def _is_open(ix: int, iy: int, low: int, high: int, space: Voxels, least: int) -> bool:
    """Return whether `RUN` voxels of a cell are open.

    Parameters
    ----------
    ix, iy : int
        The cell.
    low, high : int
        The lowest and the highest voxel that counts.
    space : Voxels
    least : int
        So many lines make a voxel open.
    """
    voxel, end = column_from(space, key_of(ix, iy), low)
    count = 0
    while voxel < end and space.iz[voxel] <= high:
        count += space.lines[voxel] >= least
        voxel += 1
    return count >= RUN


@kernel
def _longest(
    key: UInt64, bottom: Int64, top: Int64, space: Voxels, least: int
) -> tuple[Int64, Int64]:
    """Return the first voxel and the length of the longest run that is not open, of each column.

    Parameters
    ----------
    key : uint64 (N,)
        Packed keys of the cells.
    bottom, top : int64 (N,)
        The lowest and the highest voxel.
    space : Voxels
    least : int
    """
    first, length = np.zeros((2, len(key)), dtype=np.int64)
    for n in range(len(key)):
        voxel, end = column_from(space, key[n], bottom[n])
        begin = bottom[n]
        while begin <= top[n]:
            while voxel < end and space.lines[voxel] < least:
                voxel += 1
            stop = top[n] + 1
            if voxel < end:
                stop = min(stop, np.int64(space.iz[voxel]))
            if stop - begin > length[n]:
                first[n], length[n] = begin, stop - begin
            begin = stop + 1
            voxel += 1
    return first, length
