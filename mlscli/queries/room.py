"""How much room a craft has at a place: up, down, to its left and right, and what ends it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mlscli.maps.free_space import voxels_at
from mlscli.maps.surface_map import ARTIFICIAL, ORIGINS, SurfaceMap
from mlscli.queries.obstacles import bounds
from mlscli.queries.voxels import Voxels, all_seen
from mlscli.runtime.arrays import Bool, Float64, Int64

# How far room is looked for, in cells beside the craft.
FARTHEST = 100
# Space was seen where lines passed through so great a share of its voxels, in steps of a voxel.
SEEN = 0.5

NOTHING, UNSEEN = "nothing", "never seen"


class Room(NamedTuple):
    """How far a craft could move in a direction.

    Attributes
    ----------
    distance : float
        To where the room ends, in the unit of the map; below 0 where the craft reaches in; infinite
        where nothing ends it within `FARTHEST` cells.
    least : float
        The same, if heights are off by two standard deviations. What lies to the side is in doubt
        by a cell, and `distance` is the least.
    rests : str
        What ends it: ``measured``, ``plastered``, ``artificial``, ``never seen`` or ``nothing``.
    patch : int
        The patch that ends it; -1: none.
    """

    distance: float
    least: float
    rests: str
    patch: int


_OPEN = Room(math.inf, math.inf, NOTHING, -1)


def room_at(
    surface: SurfaceMap, begin: Float64, end: Float64, width: float, height: float, least: int = 2
) -> dict[str, Room]:
    """Return the room of a craft on a piece: ``up``, ``down``, ``left``, ``right``.

    Parameters
    ----------
    surface : SurfaceMap
    begin, end : float64 (3,)
        Ends of the piece; left and right are those of one who flies along it, or along x where it
        is upright.
    width, height : float
        The craft's diameter, and its height.
    least : int
        So many sight lines show that a voxel is free.
    """
    place, side = (begin + end) / 2, surface.cell_size
    ahead = (end - begin)[:2]
    length = math.hypot(*ahead.tolist())
    ahead = ahead / length if length > 0 else np.array([1.0, 0.0])
    beside = width / 2 + FARTHEST * side
    ends = (math.floor((place[0] + sign * beside) / side) for sign in (-1, 1))
    first, last = np.searchsorted(surface.ix, [next(ends), next(ends) + 1]).tolist()
    near = np.flatnonzero(np.abs((surface.iy[first:last] + 0.5) * side - place[1]) <= beside)
    patches = first + near
    patches = patches[_stands(surface, patches, place[2], height, least)]
    part = surface.take(patches)
    below, above = place[2] - height / 2, place[2] + height / 2
    low, high, off = part.low_end, part.height, bounds(part)
    corner = np.stack((part.ix, part.iy), axis=1) * side
    # What the craft is above or below anywhere on the piece: at its ends or in its middle.
    under = np.zeros(len(patches), dtype=np.bool_)
    for at in (begin[:2], place[:2], end[:2]):
        gap = np.maximum(np.maximum(corner - at, at - corner - side), 0.0)
        under |= np.hypot(*gap.T) < width / 2 - 1e-9 * side
    across = np.array([-ahead[1], ahead[0]])
    corners = (corner[:, None] - place[:2]) + side * np.array([[0, 0], [1, 0], [0, 1], [1, 1]])
    along, aside = corners @ ahead, corners @ across
    level = (low < above) & (high > below)
    level &= (along.min(axis=1) < width / 2) & (along.max(axis=1) > -width / 2)
    level &= ~(under & ((low > place[2]) | (high < place[2])))
    is_left = aside.mean(axis=1) > 0
    none = np.zeros(len(patches))
    rooms = {
        "up": _nearest(part, patches, under & (low > place[2]), low - above, off),
        "down": _nearest(part, patches, under & (high < place[2]), below - high, off),
        "left": _nearest(part, patches, level & is_left, aside.min(axis=1) - width / 2, none),
        "right": _nearest(part, patches, level & ~is_left, -aside.max(axis=1) - width / 2, none),
    }
    if surface.free is None:
        return rooms
    disc = _disc(ahead, across, width, side)
    for name, room in rooms.items():
        seen = _seen(surface, place, name, across, disc, (width, height), room.distance, least)
        # Lines end a cell before their points, and what was seen is known to a voxel.
        if seen < room.distance - 1.5 * side:
            rooms[name] = Room(seen, seen, UNSEEN, -1)
    return rooms


def _stands(surface: SurfaceMap, patches: Int64, z: float, height: float, least: int) -> Bool:
    """Return which patches are more than a guess through which lines passed, bool (N,)."""
    stands = np.ones(len(patches), dtype=np.bool_)
    guessed = np.flatnonzero(surface.origin[patches] == ARTIFICIAL)
    if surface.free is None or not len(guessed):
        return stands
    half = surface.cell_size / 2
    ix = surface.ix[patches[guessed]]
    space = Voxels.of(surface.free, int(ix.min()), int(ix.max()))
    for n in guessed.tolist():
        patch = patches[n]
        low, high = surface.height[patch] - surface.depth[patch], surface.height[patch]
        level = surface.depth[patch] == 0
        if low < z + height / 2 and high > z - height / 2:
            low, high = max(low, z - height / 2), min(high, z + height / 2)
        bottom, top = math.floor(low / half) - level, math.floor(high / half)
        cell = int(surface.ix[patch]), int(surface.iy[patch])
        stands[n] = not all_seen(space, *cell, bottom, top, least)
    return stands


def _nearest(part: SurfaceMap, patches: Int64, which: Bool, far: Float64, off: Float64) -> Room:
    """Return the room up to the nearest of some patches of a part of the map."""
    chosen = np.flatnonzero(which)
    if not len(chosen):
        return _OPEN
    n = chosen[np.argmin(far[chosen])]
    least = float((far - off)[chosen].min())
    return Room(float(far[n]), least, ORIGINS[part.origin[n]], int(patches[n]))


def _disc(ahead: Float64, across: Float64, width: float, side: float) -> Float64:
    """Return places about half a cell apart on a disc, x and y from its middle, float64 (N, 2)."""
    count = max(1, math.ceil(width / side * 2))
    steps = (np.arange(count) + 0.5) / count * width - width / 2
    one, other = (grid.ravel() for grid in np.meshgrid(steps, steps))
    inside = one * one + other * other <= width * width / 4
    return np.outer(one[inside], ahead) + np.outer(other[inside], across)


def _seen(
    surface: SurfaceMap,
    place: Float64,
    way: str,
    across: Float64,
    disc: Float64,
    size: tuple[float, float],
    farthest: float,
    least: int,
) -> float:
    """Return how far beside a craft space was seen, at most to a distance.

    Parameters
    ----------
    surface : SurfaceMap
        With free space.
    place : float64 (3,)
        The middle of the craft.
    way : str
        ``up``, ``down``, ``left`` or ``right``.
    across : float64 (2,)
        The direction to the left.
    disc : float64 (N, 2)
        Places on the craft's disc, from its middle.
    size : tuple of float
        The craft's diameter, and its height.
    farthest : float
        How far is enough.
    least : int
        So many sight lines show that a voxel is free.
    """
    assert surface.free is not None
    width, height = size
    half = surface.cell_size / 2
    steps = (np.arange(2 * FARTHEST) + 0.5) * half
    steps = steps[steps - half < farthest]
    if not len(steps):
        return math.inf
    if way in ("up", "down"):
        sign = 1 if way == "up" else -1
        z = place[2] + sign * (height / 2 + steps)
        xy = place[:2] + disc
        places = np.column_stack((np.tile(xy, (len(z), 1)), np.repeat(z, len(xy))))
    else:
        sign = 1 if way == "left" else -1
        count = max(1, math.ceil(height / half))
        z = place[2] + (np.arange(count) + 0.5) / count * height - height / 2
        xy = place[:2] + sign * np.outer(width / 2 + steps, across)
        places = np.column_stack((np.repeat(xy, len(z), axis=0), np.tile(z, len(xy))))
    lines = surface.free.lines_through(*voxels_at(places, surface.cell_size))
    shares = (lines.reshape(len(steps), -1) >= least).mean(axis=1)
    unseen = np.flatnonzero(shares < SEEN)
    return float(steps[unseen[0]] - half / 2) if len(unseen) else math.inf
