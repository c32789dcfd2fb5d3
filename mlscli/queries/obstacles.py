"""How far a craft that flies along a piece stays from the patches of a map.

The craft is an upright cylinder; a piece of its way is straight and at most a cell long. Where in
its cell a patch lies is not known, and where its ends lie only as well as they were measured. So
each patch is two obstacles:

- The **outer** one is all that it may be: its whole cell, from the lowest of its lower end and its
  points to the highest of its upper end and its points, and as far beyond as heights may be off,
  `bound`.
- The **core** is what it is at least: the middle of its cell, from its lower to its upper end, less
  the bound at each. Of a level patch it is its height, or what is within the bound of it.

Where a craft stays clear of all outer obstacles, no patch is in its way. Where it meets a core, one
is, unless enough sight lines passed through all the voxels in which it would meet the patch (and
through the one below, if it is level): then points and lines contradict each other. In between, the
map cannot tell. All distances are those of outer obstacles.

An artificial patch is a guess. Where lines passed through, as above, there is none; elsewhere
nobody saw what is there, so that it is space never seen, and neither a core nor an outer obstacle.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from mlscli.maps.cells import GREATEST_INDEX, LEAST_INDEX, cell_of, key_of, pack
from mlscli.maps.surface_map import ARTIFICIAL, SurfaceMap
from mlscli.queries.planes import clipped, to_square, within
from mlscli.queries.voxels import Voxels, all_seen
from mlscli.runtime.arrays import Bool, Float64, Int64, UInt8, UInt64
from mlscli.runtime.kernels import inner, kernel
from mlscli.runtime.sorting import place_of

# What a piece meets.
NOTHING, GUESSED, OUTER, CORE = 0, 1, 2, 3

# Heights are off by at most so many of their standard deviations, in 95 of 100 cases.
DEVIATIONS = 2.0
# Where it is not known how far they are off: so many cells.
UNKNOWN_BOUND = 0.5


class Obstacles(NamedTuple):
    """The patches of a part of a map as obstacles, by their cells.

    Attributes
    ----------
    key : uint64 (C,)
        Packed keys of their cells, ascending.
    start : int64 (C + 1,)
        The patches of cell c are ``start[c]:start[c + 1]``.
    low, high : float64 (P,)
        Ends of the outer obstacles.
    core_low, core_high : float64 (P,)
        Ends of the cores.
    origin : uint8 (P,)
    level : bool (P,)
        Whether the patch is horizontal.
    first : int
        The number of the first of these patches in the map.
    """

    key: UInt64
    start: Int64
    low: Float64
    high: Float64
    core_low: Float64
    core_high: Float64
    origin: UInt8
    level: Bool
    first: int

    @classmethod
    def of(cls, surface: SurfaceMap, least_x: int, greatest_x: int) -> Obstacles:
        """Return the patches in the cells with ix in a range."""
        begin, end = np.searchsorted(surface.ix, [least_x, greatest_x + 1]).tolist()
        columns = {name: column[begin:end] for name, column in surface.columns.items()}
        part = replace(surface, **columns)
        bound = bounds(part)
        cells = part.cells
        low, high = part.low_end, part.height
        middle = (low + high) / 2
        return cls(
            pack(cells.ix, cells.iy),
            cells.start,
            np.fmin(low, part.bottom) - bound,
            np.fmax(high, part.top) + bound,
            np.where(part.depth > 0, np.minimum(low + bound, middle), low + bound),
            np.where(part.depth > 0, np.maximum(high - bound, middle), high - bound),
            part.origin,
            part.depth == 0,
            begin,
        )


def bounds(surface: SurfaceMap) -> Float64:
    """Return how far off the ends of patches may be, float64 (P,), in the unit of the map.

    Of patches that a stage has moved, that is no part of it: an outer obstacle holds their points,
    too.
    """
    moved = surface.height - np.where(surface.depth > 0, surface.top, surface.mean)
    off = np.sqrt(np.maximum(surface.height_variance - moved * moved, 0.0))
    return np.where(np.isnan(off), UNKNOWN_BOUND * surface.cell_size, DEVIATIONS * off)


class Craft(NamedTuple):
    """An upright cylinder, and how exactly lengths are compared; in the unit of the map.

    Attributes
    ----------
    radius, half : float
        Half its diameter and half its height.
    rounding : float
        What meets by no more than this does not meet.
    """

    radius: float
    half: float
    rounding: float


class Held(NamedTuple):
    """What a craft is held against on its way.

    Attributes
    ----------
    craft : Craft
    side : float
        Side of a cell.
    obstacles : Obstacles
    space : Voxels
    least : int
        So many lines through a voxel show that it is free.
    """

    craft: Craft
    side: float
    obstacles: Obstacles
    space: Voxels
    least: int


class Met(NamedTuple):
    """What a craft meets on the pieces of its way.

    Attributes
    ----------
    met : uint8 (N,)
        What it meets at most: `NOTHING`, `GUESSED`, `OUTER` or `CORE`.
    distance : float64 (N,)
        How far it stays from outer obstacles, below 0 where it meets one: how far it would have to
        move to the side, or up or down; infinite where there is none in reach.
    nearest : int64 (N,)
        The number of that patch in the map; -1: none.
    """

    met: UInt8
    distance: Float64
    nearest: Int64


@kernel
def meet(begin: int, end: int, place: Float64, held: Held, reach: float, found: Met) -> None:
    """Find out what a craft meets along pieces ``begin:end``, and what it comes nearest to.

    Parameters
    ----------
    begin, end : int
    place : float64 (N + 1, 3)
        Ends of the pieces.
    held : Held
    reach : float
        How far beside the craft obstacles are looked for.
    found : Met
        Is given what is found.
    """
    distance, nearest = found.distance, found.nearest
    for n in range(begin, end):
        distance[n], nearest[n], found.met[n] = np.inf, -1, NOTHING
        # What the craft's own cells hold mostly shows that farther ones need no look.
        _search(n, place, held, 0.0, reach, found)
        around = min(reach, max(distance[n], 0.0))
        if around > 0.0:
            _search(n, place, held, around, reach, found)
        if distance[n] > reach:
            distance[n], nearest[n] = np.inf, -1


@inner
def _search(n: int, place: Float64, held: Held, reach: float, farthest: float, found: Met) -> None:
    """Hold a piece against the patches in the cells up to `reach` beside the craft.

    Parameters
    ----------
    n : int
        The piece.
    place, held, found
        As for `meet`.
    reach, farthest : float
        How far beside the craft cells are looked at, 0: only those that it reaches into, which
        otherwise are left out; and how far obstacles count.
    """
    craft, side, obstacles = held.craft, held.side, held.obstacles
    met, distance, nearest = found.met, found.distance, found.nearest
    ax, ay, az = place[n, 0], place[n, 1], place[n, 2]
    bx, by, bz = place[n + 1, 0], place[n + 1, 1], place[n + 1, 2]
    low, high = min(az, bz) - craft.half, max(az, bz) + craft.half
    beside = craft.radius + reach
    first_y = math.floor((min(ay, by) - beside) / side)
    last_y = math.floor((max(ay, by) + beside) / side)
    first_x = math.floor((min(ax, bx) - beside) / side)
    last_x = math.floor((max(ax, bx) + beside) / side)
    for ix in range(max(first_x, LEAST_INDEX), min(last_x, GREATEST_INDEX) + 1):
        last = key_of(ix, min(last_y, GREATEST_INDEX))
        cell = place_of(obstacles.key, key_of(ix, max(first_y, LEAST_INDEX)))
        while cell < len(obstacles.key) and obstacles.key[cell] <= last:
            _, iy = cell_of(obstacles.key[cell])
            gap = np.nan
            for patch in range(obstacles.start[cell], obstacles.start[cell + 1]):
                rise = max(obstacles.low[patch] - high, low - obstacles.high[patch])
                if rise >= min(max(distance[n], 0.0), farthest):
                    continue
                if gap != gap:
                    gap = to_square(ax, ay, bx, by, ix * side, iy * side, side) - craft.radius
                if gap < 0.0 < reach:
                    # Cells that the craft reaches into have been looked at.
                    break
                far = max(gap, rise)
                if gap > 0.0 and rise > 0.0:
                    far = math.sqrt(gap * gap + rise * rise)
                meets = far < -craft.rounding
                if far >= distance[n] and not meets:
                    continue
                what = OUTER
                through = _seen_through(patch, ix, iy, low, high, held)
                if obstacles.origin[patch] == ARTIFICIAL:
                    what = GUESSED
                    if through:
                        continue
                elif (
                    meets
                    and not through
                    and _meets_core(place[n], place[n + 1], ix, iy, patch, held)
                ):
                    what = CORE
                if meets:
                    met[n] = max(met[n], what)
                if far < distance[n]:
                    distance[n], nearest[n] = far, obstacles.first + patch
            cell += 1


@inner
def _seen_through(patch: int, ix: int, iy: int, low: float, high: float, held: Held) -> bool:
    """Return whether lines passed through all voxels of a patch.

    Parameters
    ----------
    patch : int
    ix, iy : int
        Its cell.
    low, high : float
        Where they overlap with these heights, only its voxels between them count.
    held : Held
    """
    obstacles, half = held.obstacles, held.side / 2
    bottom, top = obstacles.low[patch], obstacles.high[patch]
    if bottom < high and top > low:
        bottom, top = max(bottom, low), min(top, high)
    first = math.floor(bottom / half) - obstacles.level[patch]
    return all_seen(held.space, ix, iy, first, math.floor(top / half), held.least)


@inner
def _meets_core(a: Float64, b: Float64, ix: int, iy: int, patch: int, held: Held) -> bool:
    """Return whether a craft meets the core of a patch on its way from a to b.

    One that is thinner than a cell would pass between the middles of the cells of a wall: it counts
    as wide as a cell.

    Parameters
    ----------
    a, b : float64 (3,)
    ix, iy : int
        The cell of the patch.
    patch : int
    held : Held
    """
    craft, side, obstacles = held.craft, held.side, held.obstacles
    radius = max(craft.radius - craft.rounding, side / 2 + craft.rounding)
    begin, end = within(a[0], a[1], b[0], b[1], (ix + 0.5) * side, (iy + 0.5) * side, radius)
    lowest = obstacles.core_low[patch] - craft.half
    highest = obstacles.core_high[patch] + craft.half
    if lowest > highest:
        return False
    rises, ends = clipped(a[2], b[2] - a[2], lowest, highest)
    return max(begin, rises) <= min(end, ends)
