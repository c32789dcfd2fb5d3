"""Free space in a scan: where a craft could be, and straight ways from place to place.

Space is divided into boxes. Those that a disc of the scan runs through are taken. A craft keeps
away from them, and stays where something lies below it: under the ground nothing is free.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from mlscli.runtime.arrays import Bool, Float64, Int64
from mlscli.runtime.kernels import kernel
from mlscli.runtime.tree import Tree
from mlscli.scenes.discs import boxes_around
from mlscli.scenes.scans import Scan

# How many boxes and places there are at most.
_BOXES, _PLACES = 4_000_000, 500
# Side of the boxes, in the usual radius of a disc, if there are not too many.
_SIDE = 1.5
# So many boxes lie around the scan on each side.
_MARGIN = 8
# A place keeps so many boxes away from taken ones, a way between places so many.
_CLEARANCE, _WAY = 2.0, 1.5
# Ways lead from each place to so many of the nearest.
_WAYS = 12


class Places(NamedTuple):
    """Places where a craft could be, and ways between them.

    Attributes
    ----------
    position : float64 (P, 3)
        In the unit of the scan.
    clearance : float64 (P,)
        Distance of the nearest taken box, in the unit of the scan.
    covered : bool (P,)
        Whether something of the scan lies above.
    ways : scipy.sparse.csr_array (P, P)
        Lengths of the straight ways between places, in the unit of the scan.
    """

    position: Float64
    clearance: Float64
    covered: Bool
    ways: Any


def find_places(scan: Scan) -> Places:
    """Return places spread over the free space of a scan, each the freest around."""
    from scipy.ndimage import distance_transform_edt

    least, high = scan.bounds
    side = _SIDE * scan.spacing
    while float(np.prod(np.floor((high - least) / side) + 1 + 2 * _MARGIN)) > _BOXES:
        side *= 1.1
    low = least - _MARGIN * side
    shape = np.floor((high - least) / side).astype(np.int64) + 1 + 2 * _MARGIN
    taken, solid = np.zeros(tuple(shape), dtype=np.bool_), scan.discs
    _take(taken, solid.centre, solid.normal, solid.radius, low, side)
    clearance = distance_transform_edt(~taken)
    below = np.logical_or.accumulate(taken, axis=2)
    above = np.logical_or.accumulate(taken[:, :, ::-1], axis=2)[:, :, ::-1]
    free = np.flatnonzero((clearance >= _CLEARANCE) & below)
    best = _freest(free, clearance, 2)
    block = 3
    while len(best) > _PLACES:
        best = _freest(free, clearance, block)
        block += 1
    position = low + (np.column_stack(np.unravel_index(best, taken.shape)) + 0.5) * side
    ways = _ways(position, clearance, low, side)
    return Places(position, clearance.ravel()[best] * side, above.ravel()[best], ways)


def _freest(free: Int64, clearance: Float64, block: int) -> Int64:
    """Return of each cube of boxes the free one that is farthest from all taken ones.

    Parameters
    ----------
    free : int64 (F,)
        Indices of free boxes, ascending.
    clearance : float64 (X, Y, Z)
        Distance of each box from taken ones.
    block : int
        How many boxes the cubes are wide.
    """
    x, y, z = (index // block for index in np.unravel_index(free, clearance.shape))
    _, rows, layers = (count // block + 1 for count in clearance.shape)
    cube = (x * rows + y) * layers + z
    order = np.lexsort((free, -clearance.ravel()[free], cube))
    return free[order[np.unique(cube[order], return_index=True)[1]]]


def _ways(position: Float64, clearance: Float64, low: Float64, side: float) -> Any:
    """Return the lengths of the ways between places, as in `Places`.

    Parameters
    ----------
    position : float64 (P, 3)
        The places.
    clearance : float64 (X, Y, Z)
        Distance of each box from taken ones, in boxes.
    low : float64 (3,)
        The lowest corner of the boxes.
    side : float
        Side of the boxes, in the unit of the scan.
    """
    from scipy.sparse import csr_array

    count = len(position)
    if count < 2:
        return csr_array(np.zeros((count, count)))
    _, near = Tree(position).nearest(position, min(_WAYS + 1, count))
    pairs = np.column_stack((np.repeat(np.arange(count), near.shape[1]), near.ravel()))
    pairs = np.unique(np.sort(pairs[pairs[:, 0] != pairs[:, 1]], axis=1), axis=0)
    begin, end = position[pairs[:, 0]], position[pairs[:, 1]]
    length = np.linalg.norm(end - begin, axis=1)
    steps = math.ceil(2 * float(length.max()) / side) + 1
    free = np.ones(len(pairs), dtype=np.bool_)
    for share in np.linspace(0.0, 1.0, steps):
        boxes = ((begin + share * (end - begin) - low) / side).astype(np.int64)
        free &= clearance[tuple(boxes.T)] >= _WAY
    a, b = pairs[free].T
    both = (np.concatenate((a, b)), np.concatenate((b, a)))
    return csr_array((np.tile(length[free], 2), both), shape=(count, count))


@kernel
def _take(
    taken: Bool, centre: Float64, normal: Float64, radius: Float64, low: Float64, side: float
) -> None:
    """Take the boxes that discs run through.

    Parameters
    ----------
    taken : bool (X, Y, Z)
        The boxes; those taken become True.
    centre, normal, radius
        As in `mlscli.scenes.discs.Discs`.
    low : float64 (3,)
        The lowest corner of the boxes.
    side : float
        Side of the boxes, in the unit of the scan.
    """
    # A plane runs through a box if its middle is no farther away: half a diagonal.
    diagonal = math.sqrt(0.75) * side
    for n in range(len(centre)):
        far = radius[n] + diagonal
        a, b, c, d, e, f = boxes_around(centre[n], radius[n], low, side, taken.shape)
        for i in range(a, d):
            x = low[0] + (i + 0.5) * side - centre[n, 0]
            for j in range(b, e):
                y = low[1] + (j + 0.5) * side - centre[n, 1]
                for k in range(c, f):
                    z = low[2] + (k + 0.5) * side - centre[n, 2]
                    off = normal[n, 0] * x + normal[n, 1] * y + normal[n, 2] * z
                    if abs(off) <= diagonal and x * x + y * y + z * z <= far * far:
                        taken[i, j, k] = True
