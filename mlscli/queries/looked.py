"""Whether the space through which a craft flies was looked through, or never seen.

Sight lines are sparse. Between those that cross the space of a craft there are voxels through which
none passed, and to ask for one through each would call all space unseen. What is never seen as a
whole is larger than what lies between lines: inside of things, behind them, and where nobody
looked. So a voxel is **open** where enough lines passed through it; it is **explained** where a
measured patch reaches into it or into one beside it (a cell away, or two voxels above or below):
lines end a cell before their points. What is neither is **blank**. The space of a craft on a piece
of its way is never seen

- where `RUN` voxels above one another, three cells, are blank, and one of them lies in it: however
  thin what stands there is, no line crosses it;
- where a plate of 3 by 3 cells and `PLATE` voxels, one cell thick, is blank, and a part of it lies
  in it: what hangs or lies there level hides no more than that;
- where less than `SHARE` of its voxels are open: small hollows that nobody looked into are all
  explained by their walls.

It has those voxels that the craft's cylinder reaches into in the cells that it reaches into, at any
place of the piece.
"""

from __future__ import annotations

import math

import numpy as np

from mlscli.maps.cells import GREATEST_INDEX, LEAST_INDEX, cell_of, key_of
from mlscli.maps.surface_map import MEASURED
from mlscli.queries.obstacles import Held, Obstacles
from mlscli.queries.planes import to_square
from mlscli.queries.voxels import Voxels, first_from
from mlscli.runtime.arrays import Bool, Float32, Float64, UInt64
from mlscli.runtime.kernels import inner, kernel
from mlscli.runtime.sorting import place_of

RUN, PLATE, SHARE = 6, 2, 0.5

# Columns of voxels are held as bits, 64 of them at a time: so many of the craft's, and around them
# as many as the rules need.
_CORE, _MARGIN = 48, 8
# Columns around those of the craft: plates reach out two, and a patch beside them explains them.
_AROUND = 3


@kernel
def look(begin: int, end: int, place: Float64, held: Held, share: Float32, blank: Bool) -> None:
    """Find out whether the space of a craft along pieces ``begin:end`` was seen.

    Parameters
    ----------
    begin, end, place, held
        As for `mlscli.queries.obstacles.meet`.
    share : float32 (N,)
        Is given the share of the voxels that are open.
    blank : bool (N,)
        Is given whether the space is never seen.
    """
    craft, side, space, least = held.craft, held.side, held.space, held.least
    for n in range(begin, end):
        ax, ay, az = place[n, 0], place[n, 1], place[n, 2]
        bx, by, bz = place[n + 1, 0], place[n + 1, 1], place[n + 1, 2]
        first_x = math.floor((min(ax, bx) - craft.radius) / side) - _AROUND
        first_y = math.floor((min(ay, by) - craft.radius) / side) - _AROUND
        rows = math.floor((max(ax, bx) + craft.radius) / side) + _AROUND - first_x + 1
        columns = math.floor((max(ay, by) + craft.radius) / side) + _AROUND - first_y + 1
        inside = np.zeros((rows, columns), dtype=np.bool_)
        reached = 0
        for i in range(_AROUND, rows - _AROUND):
            for j in range(_AROUND, columns - _AROUND):
                x, y = (first_x + i) * side, (first_y + j) * side
                gap = to_square(ax, ay, bx, by, x, y, side) - craft.radius
                inside[i, j] = gap < -craft.rounding
                reached += inside[i, j]
        lowest = math.floor((min(az, bz) - craft.half + craft.rounding) / (side / 2))
        highest = math.ceil((max(az, bz) + craft.half - craft.rounding) / (side / 2)) - 1
        highest = max(lowest, highest)
        opened = 0
        blank[n] = False
        for core in range(lowest, highest + 1, _CORE):
            last = min(core + _CORE - 1, highest)
            open_ = np.zeros((rows, columns), dtype=np.uint64)
            patches = np.zeros((rows, columns), dtype=np.uint64)
            bottom = core - _MARGIN
            _mark_open(open_, first_x, first_y, bottom, last + _MARGIN, space, least)
            _mark_patches(patches, first_x, first_y, bottom, side / 2, held.obstacles)
            blank[n] |= _is_blank(open_, patches, inside, last - core)
            of_craft = _from_to(_MARGIN, _MARGIN + last - core)
            for i in range(rows):
                for j in range(columns):
                    if inside[i, j]:
                        opened += _ones(open_[i, j] & of_craft)
        voxels = reached * (highest - lowest + 1)
        share[n] = opened / max(voxels, 1)
        blank[n] |= opened < SHARE * voxels or voxels == 0


@inner
def _from_to(low: int, high: int) -> np.uint64:
    """Return a word with the bits from `low` up to `high` set, of those from 0 to 63."""
    low, high = max(low, 0), min(high, 63)
    if low > high:
        return np.uint64(0)
    return (np.uint64(0xFFFFFFFFFFFFFFFF) >> np.uint64(63 - high + low)) << np.uint64(low)


@inner
def _ones(word: np.uint64) -> int:
    """Return how many bits of a word are set."""
    count = 0
    while word != np.uint64(0):
        word &= word - np.uint64(1)
        count += 1
    return count


@inner
def _mark_open(
    open_: UInt64, first_x: int, first_y: int, bottom: int, top: int, space: Voxels, least: int
) -> None:
    """Set the bits of open voxels up to one: bit b of a column is the voxel ``bottom + b``.

    The outermost columns are left out: nothing asks for them.

    Parameters
    ----------
    open_ : uint64 (I, J)
        The columns, from cell (`first_x`, `first_y`) on.
    first_x, first_y, bottom, top : int
        The first cell, and the lowest and the highest voxel that is asked for.
    space, least
        As for `look`.
    """
    rows, columns = open_.shape
    for i in range(1, rows - 1):
        ix = first_x + i
        if ix < LEAST_INDEX or ix > GREATEST_INDEX:
            continue
        cell = place_of(space.key, key_of(ix, max(first_y + 1, LEAST_INDEX)))
        last = key_of(ix, min(first_y + columns - 2, GREATEST_INDEX))
        while cell < len(space.key) and space.key[cell] <= last:
            j = cell_of(space.key[cell])[1] - first_y
            stop = space.start[cell + 1]
            voxel = first_from(space.iz, space.start[cell], stop, bottom)
            word = np.uint64(0)
            while voxel < stop and space.iz[voxel] <= top:
                if space.lines[voxel] >= least:
                    word |= np.uint64(1) << np.uint64(space.iz[voxel] - bottom)
                voxel += 1
            open_[i, j] = word
            cell += 1


@inner
def _mark_patches(
    patches: UInt64, first_x: int, first_y: int, bottom: int, height: float, obstacles: Obstacles
) -> None:
    """Set the bits of voxels into which measured patches reach.

    Parameters
    ----------
    patches : uint64 (I, J)
    first_x, first_y, bottom : int
        As in `_mark_open`.
    height : float
        Of a voxel.
    obstacles
        As for `look`.
    """
    rows, columns = patches.shape
    for i in range(rows):
        ix = first_x + i
        if ix < LEAST_INDEX or ix > GREATEST_INDEX:
            continue
        cell = place_of(obstacles.key, key_of(ix, max(first_y, LEAST_INDEX)))
        last = key_of(ix, min(first_y + columns - 1, GREATEST_INDEX))
        while cell < len(obstacles.key) and obstacles.key[cell] <= last:
            j = cell_of(obstacles.key[cell])[1] - first_y
            for patch in range(obstacles.start[cell], obstacles.start[cell + 1]):
                if obstacles.origin[patch] == MEASURED:
                    low = math.floor(obstacles.low[patch] / height) - bottom
                    high = math.floor(obstacles.high[patch] / height) - bottom
                    patches[i, j] |= _from_to(low, high)
            cell += 1


@inner
def _is_blank(open_: UInt64, patches: UInt64, inside: Bool, top: int) -> bool:
    """Return whether a run or a plate of blank voxels reaches into the craft's.

    Parameters
    ----------
    open_, patches : uint64 (I, J)
        Open voxels, and such as patches reach into, as bits.
    inside : bool (I, J)
        The columns of the craft.
    top : int
        The craft's voxels are bits `_MARGIN` to ``_MARGIN + top``.
    """
    rows, columns = open_.shape
    # Bits at which a run, or a plate, begins that reaches into the craft.
    of_runs = _from_to(_MARGIN - RUN + 1, _MARGIN + top)
    of_plates = _from_to(_MARGIN - PLATE + 1, _MARGIN + top)
    blank = np.zeros((rows, columns), dtype=np.uint64)
    flat = np.zeros((rows, columns), dtype=np.uint64)
    for i in range(rows):
        for j in range(columns):
            word = patches[i, j]
            word |= word << np.uint64(1) | word >> np.uint64(1)
            patches[i, j] = word | word << np.uint64(1) | word >> np.uint64(1)
    for i in range(1, rows - 1):
        for j in range(1, columns - 1):
            word = np.uint64(0)
            for k in range(i - 1, i + 2):
                word |= patches[k, j - 1] | patches[k, j] | patches[k, j + 1]
            blank[i, j] = ~(word | open_[i, j])
            flat[i, j] = _runs(blank[i, j], PLATE) & of_plates
            if inside[i, j] and _runs(blank[i, j], RUN) & of_runs:
                return True
    for i in range(2, rows - 2):
        for j in range(2, columns - 2):
            word, near = of_plates, False
            for k in range(i - 1, i + 2):
                for m in range(j - 1, j + 2):
                    word &= flat[k, m]
                    near |= inside[k, m]
            if near and word != np.uint64(0):
                return True
    return False


@inner
def _runs(word: np.uint64, length: int) -> np.uint64:
    """Return the bits at which so many bits in a row that are set begin."""
    begun = word
    for step in range(1, length):
        begun &= word >> np.uint64(step)
    return begun
