"""Which patches a robot can stand on, and from which to which it can go."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mlscli.maps.neighbours import shifted
from mlscli.maps.surface_map import ARTIFICIAL, SurfaceMap
from mlscli.rasters.robot import Limits
from mlscli.runtime.arrays import Bool, Float64, Int32, Int64, UInt8
from mlscli.runtime.kernels import kernel

# So many cells between two may hold nothing.
_GAP = 5

# The slope is that over so many links to either side: over one alone, noise is steep.
_FAR = 2


class Floor(NamedTuple):
    """Where a robot can stand.

    Attributes
    ----------
    stands : bool (P,)
        The patches that it can stand on: there is room above, and they are not too steep.
    doubtful : bool (P,)
        Those that are artificial, or have an artificial patch where the robot would be.
    links : int64 (P, 4)
        The patch of the next cell at -x, +x, -y, +y to which it can go from each patch with room
        above; -1: none.
    """

    stands: Bool
    doubtful: Bool
    links: Int64


def floor_of(surface: SurfaceMap, limits: Limits) -> Floor:
    """Return where a robot can stand on a map, and go to.

    Along an axis, the next cell that holds anything counts, up to `_GAP` empty ones away. The robot
    can go to its patch that is nearest in height, where the two differ by no more than a step, or
    by the slope over the way. The slope along an axis is the lesser of those to either side, and
    none where they differ in sign: a lone step is none.
    """
    cells = surface.cells
    room, doubtful = _room(
        cells.start, surface.height, surface.low_end, surface.origin, limits.headroom
    )
    size = surface.cell_size
    links = np.empty((surface.size, 4), dtype=np.int64)
    rises = np.array([limits.rise(size * away) for away in range(_GAP + 2)])
    for side, (dx, dy) in enumerate(((-1, 0), (1, 0), (0, -1), (0, 1))):
        there = np.full(len(cells.ix), -1, dtype=np.int64)
        rise = np.zeros(len(cells.ix))
        for away in range(1, _GAP + 2):
            found = shifted(cells.ix, cells.iy, dx * away, dy * away)
            new = (there < 0) & (found >= 0)
            there[new], rise[new] = found[new], rises[away]
            if (there >= 0).all():
                break
        links[:, side] = _links(cells.start, there, surface.height, room, rise)
    _keep_mutual(links)
    steep = _slopes(links, surface.ix, surface.iy, surface.height, size) > limits.slope
    return Floor(room & ~steep, doubtful, links)


@kernel
def _room(
    start: Int64, height: Float64, low: Float64, origin: UInt8, headroom: float
) -> tuple[Bool, Bool]:
    """Return which patches have room above, and which are doubtful, bool (P,)."""
    room = np.ones(len(height), dtype=np.bool_)
    doubtful = np.zeros(len(height), dtype=np.bool_)
    for cell in range(len(start) - 1):
        for patch in range(start[cell], start[cell + 1]):
            doubtful[patch] = origin[patch] == ARTIFICIAL
            for other in range(patch + 1, start[cell + 1]):
                if low[other] - height[patch] < headroom:
                    if origin[other] == ARTIFICIAL:
                        doubtful[patch] = True
                    else:
                        room[patch] = False
    return room, doubtful


@kernel
def _links(start: Int64, there: Int64, height: Float64, room: Bool, rise: Float64) -> Int64:
    """Return the patch that a robot goes to from each into the next cell, int64 (P,); -1: none.

    Parameters
    ----------
    start : int64 (C + 1,)
    there : int64 (C,)
        The next cell after each, or -1.
    height : float64 (P,)
    room : bool (P,)
    rise : float64 (C,)
        By how much heights may differ.
    """
    found = np.full(len(height), -1, dtype=np.int64)
    for cell in range(len(there)):
        beside = there[cell]
        if beside < 0:
            continue
        for patch in range(start[cell], start[cell + 1]):
            least = rise[cell]
            for other in range(start[beside], start[beside + 1]):
                apart = abs(height[other] - height[patch])
                if room[patch] and room[other] and apart <= least:
                    # Of two as near, the lower.
                    if found[patch] < 0 or apart < least:
                        found[patch] = other
                    least = apart
    return found


@kernel
def _keep_mutual(links: Int64) -> None:
    """Drop the links that do not lead back: to go to a patch and to come from it is one."""
    back = links.copy()
    for patch in range(len(links)):
        for side in range(4):
            there = links[patch, side]
            if there >= 0 and back[there, side ^ 1] != patch:
                links[patch, side] = -1


@kernel
def _slopes(links: Int64, ix: Int32, iy: Int32, height: Float64, cell_size: float) -> Float64:
    """Return the slope of each patch, height by length, float64 (P,)."""
    slopes = np.zeros(len(height))
    for patch in range(len(height)):
        square = 0.0
        for axis in range(2):
            gradients = np.zeros(2)
            sides = 0
            for side in range(2):
                at, steps = patch, 0
                while steps < _FAR and links[at, 2 * axis + side] >= 0:
                    at = links[at, 2 * axis + side]
                    steps += 1
                if steps:
                    # Along one axis; the other index is the same.
                    cells = abs(np.int64(ix[at]) - ix[patch]) + abs(np.int64(iy[at]) - iy[patch])
                    rise = (height[at] - height[patch]) / (cells * cell_size)
                    gradients[sides] = rise if side else -rise
                    sides += 1
            least = gradients[0]
            if sides == 2:
                if gradients[0] * gradients[1] <= 0:
                    least = 0.0
                elif abs(gradients[1]) < abs(least):
                    least = gradients[1]
            square += least * least
        slopes[patch] = np.sqrt(square)
    return slopes
