"""Which vertical patches of neighbouring cells make one wall, and its triangles.

Two vertical patches are *joined* where they are at most `reach` apart, in cells that share an
edge, or that share a corner while no third patch joined with both leads round it. The columns of
two cells are drawn as a ladder is climbed: from the lowest ends upward, the side whose next end
is lower goes first (equal: either). Each step along a patch makes a triangle with the end reached
on the other side, if the two patches are joined; steps over the space between two patches make
none. So two single patches make a quad, and a wall that is whole
in one cell and in pieces in the next (after a hole was closed, say) has no cracks.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from mlscli.mesh.triangulation import NONE, Nodes
from mlscli.pipeline.neighbours import shifted
from mlscli.surface_map import SurfaceMap
from mlscli.typing import Bool, Float64, Int64

ACROSS_EDGES = ((1, 0), (0, 1))
ACROSS_CORNERS = ((1, 1), (1, -1))


class Uprights(NamedTuple):
    """The vertical patches, in the file's order.

    Attributes
    ----------
    start : int64 (C + 1,)
        The vertical patches of cell c are ``start[c]`` to ``start[c + 1]``.
    low, high : float64 (U,)
        Their ends.
    foot, top : int64 (U,)
        The nodes at these.
    """

    start: Int64
    low: Float64
    high: Float64
    foot: Int64
    top: Int64


def wall_triangles(surface: SurfaceMap, nodes: Nodes, reach: float) -> tuple[Int64, Bool]:
    """Return the triangles of the walls, and which patches these show from end to end.

    Returns
    -------
    triangles : int64 (T, 3)
        Node numbers.
    shown : bool (P,)
    """
    ix, iy, start = surface.cells
    patch = np.flatnonzero(nodes.foot != NONE)
    foot, top = nodes.foot[patch], nodes.top[patch]
    uprights = Uprights(
        np.searchsorted(patch, start), nodes.height[foot], nodes.height[top], foot, top
    )
    climbed = np.zeros(len(patch), dtype=np.bool_)
    triangles = []
    for dx, dy in (*ACROSS_EDGES, *ACROSS_CORNERS):
        round_corner = np.full((len(ix), 2), NONE)
        if dx and dy:
            round_corner[:, 0] = shifted(ix, iy, dx, 0)
            round_corner[:, 1] = shifted(ix, iy, 0, dy)
        beyond = shifted(ix, iy, dx, dy)
        triangles.append(_ladders(uprights, beyond, round_corner, reach, climbed))
    shown = np.zeros(surface.size, dtype=np.bool_)
    shown[patch[climbed]] = True
    return np.concatenate(triangles), shown


@njit(cache=True, nogil=True)
def _ladders(
    uprights: Uprights, beyond: Int64, round_corner: Int64, reach: float, climbed: Bool
) -> Int64:
    """Return the triangles between each cell's vertical patches and those `beyond` it.

    `round_corner` are the two cells between, where the cells share a corner alone. Patches that
    a step runs along are marked in `climbed`.
    """
    triangles = np.empty((2 * len(climbed), 3), dtype=np.int64)
    found = 0
    for cell in range(len(beyond)):
        there = beyond[cell]
        if there < 0:
            continue
        here, end_here = uprights.start[cell], uprights.start[cell + 1]
        that, end_that = uprights.start[there], uprights.start[there + 1]
        if here == end_here or that == end_that:
            continue
        # Ends of patches are counted from the foot of the lowest: even ones are feet.
        i = j = 0
        last_i, last_j = 2 * (end_here - here) - 1, 2 * (end_that - that) - 1
        while i < last_i or j < last_j:
            near_side = j == last_j or (
                i < last_i and _end(uprights, here, i + 1) <= _end(uprights, that, j + 1)
            )
            step, opposite = (i, j) if near_side else (j, i)
            begin, begin_opposite = (here, that) if near_side else (that, here)
            if step % 2 == 0:
                patch = begin + step // 2
                apex = _apex(
                    uprights,
                    patch,
                    begin_opposite,
                    opposite,
                    last_j if near_side else last_i,
                    round_corner[cell],
                    reach,
                )
                if apex != NONE:
                    triangles[found] = (uprights.foot[patch], uprights.top[patch], apex)
                    found += 1
                    climbed[patch] = True
            if near_side:
                i += 1
            else:
                j += 1
    return triangles[:found].copy()


@njit(cache=True, nogil=True)
def _end(uprights: Uprights, begin: int, number: int) -> float:
    """Return the height of an end, counted from the foot of patch `begin`."""
    patch = begin + number // 2
    end: float = uprights.low[patch] if number % 2 == 0 else uprights.high[patch]
    return end


@njit(cache=True, nogil=True)
def _apex(
    uprights: Uprights,
    patch: int,
    begin: int,
    reached: int,
    last: int,
    round_corner: Int64,
    reach: float,
) -> int:
    """Return the node that a step along `patch` makes a triangle with; -1: none.

    Where the other side has reached a space between two patches, it is the end of the one that
    is nearer to `patch`, or overlaps it more (equal: of the one reached).
    """
    other = begin + reached // 2
    node: int = uprights.foot[other] if reached % 2 == 0 else uprights.top[other]
    if 0 < reached < last:
        beyond = other - 1 if reached % 2 == 0 else other + 1
        if _space(uprights, patch, beyond) < _space(uprights, patch, other):
            node = uprights.top[beyond] if reached % 2 == 0 else uprights.foot[beyond]
            other = beyond
    if _space(uprights, patch, other) > reach:
        return NONE
    for cell in round_corner:
        if cell >= 0:
            for between in range(uprights.start[cell], uprights.start[cell + 1]):
                if (
                    _space(uprights, patch, between) <= reach
                    and _space(uprights, between, other) <= reach
                ):
                    return NONE
    return node


@njit(cache=True, nogil=True)
def _space(uprights: Uprights, one: int, other: int) -> float:
    """Return how far apart two vertical patches are; below 0: by how much they overlap."""
    low = max(uprights.low[one], uprights.low[other])
    high = min(uprights.high[one], uprights.high[other])
    space: float = low - high
    return space
