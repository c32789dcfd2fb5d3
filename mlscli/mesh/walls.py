"""Which vertical patches of neighbouring cells make one wall, and its triangles.

Two vertical patches are *joined* where they are at most `reach` apart and their cells share an
edge. They are also joined where their cells share only a corner, unless a patch in a cell between
them is within `reach` of both. Between joined patches stands a quad, from the lower ends to the
upper ends. Where a patch is joined with several of one cell, each gets the stretch that it faces:
a window between them stays open. Ends more than `reach` apart are a step: the longer patch is cut
at the height where the other one ends.

Vertices lie on the vertical line through the cell's centre: the ends of patches, the joints where
floors meet them, the cuts, and where what was measured ends in a patch that is drawn out beyond it.
Every triangle along a line runs from one vertex to the next, so that walls on all sides of it, and
floors, share edges. Stretches of lines that no quad covers are returned as well, to be drawn by
themselves.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mlscli.maps.neighbours import shifted
from mlscli.maps.surface_map import SurfaceMap
from mlscli.mesh.colours import SNAP, origin_at
from mlscli.mesh.triangulation import NONE, Nodes
from mlscli.runtime.arrays import Bool, Float64, Int64, UInt8
from mlscli.runtime.kernels import inner, kernel
from mlscli.runtime.sorting import place_of

ACROSS_EDGES = ((1, 0), (0, 1))
ACROSS_CORNERS = ((1, 1), (1, -1))


class WallTriangles(NamedTuple):
    """The triangles of walls.

    Attributes
    ----------
    nodes : Nodes
        The nodes given, followed by the cuts, which lie outside the ranges of `start`.
    triangles : int64 (T, 3)
        Node numbers: two on the line of one patch, the third on the line of another.
    bare : int64 (B, 2)
        Lower and upper node of the stretches of lines that no triangle covers.
    """

    nodes: Nodes
    triangles: Int64
    bare: Int64


class MeasuredEnds(NamedTuple):
    """Where what was measured ends within vertical patches, E ends.

    Attributes
    ----------
    patch : int64 (E,)
        Indices of patches.
    height : float64 (E,)
        The least or the greatest height measured in each, in the unit of the recording.
    """

    patch: Int64
    height: Float64


class _Uprights(NamedTuple):
    """The vertical patches, in the file's order.

    Attributes
    ----------
    start : int64 (C + 1,)
        The vertical patches of cell c are ``start[c]`` to ``start[c + 1]``.
    low, high : float64 (V,)
        Their lower and upper ends, in the unit of the recording.
    """

    start: Int64
    low: Float64
    high: Float64


class _NodesByPatch(NamedTuple):
    """The nodes on the line of each vertical patch.

    Attributes
    ----------
    start : int64 (V + 1,)
        The nodes on the line of vertical patch v are ``start[v]`` to ``start[v + 1]``.
    node : int64 (M,)
        Node numbers.
    height : float64 (M,)
        Heights of the nodes, ascending on each line.
    """

    start: Int64
    node: Int64
    height: Float64


def walls_of(surface: SurfaceMap, nodes: Nodes, reach: float) -> WallTriangles:
    """Return the walls of a map.

    Parameters
    ----------
    surface : SurfaceMap
    nodes : Nodes
        The map's nodes, as `nodes_of` returns them.
    reach : float
        Greatest distance of patches, and of their ends, that are joined, in the unit of the
        recording.
    """
    ix, iy, start = surface.cells
    patch = np.flatnonzero(nodes.foot != NONE)
    if not len(patch):
        return WallTriangles(
            nodes, np.empty((0, 3), dtype=np.int64), np.empty((0, 2), dtype=np.int64)
        )
    uprights = _Uprights(
        np.searchsorted(patch, start),
        nodes.height[nodes.foot[patch]],
        nodes.height[nodes.top[patch]],
    )
    joined = []
    for dx, dy in (*ACROSS_EDGES, *ACROSS_CORNERS):
        round_corner = np.full((len(ix), 2), NONE)
        if dx and dy:
            round_corner[:, 0] = shifted(ix, iy, dx, 0)
            round_corner[:, 1] = shifted(ix, iy, 0, dy)
        joined.append(_joined(uprights, shifted(ix, iy, dx, dy), round_corner, reach))
    pairs = np.concatenate([pair for pair, _ in joined])
    ends = np.concatenate([end for _, end in joined])
    drawn = measured_ends(surface)
    nodes, lines = _lines(nodes, patch, pairs, ends, drawn, SNAP * surface.cell_size)
    triangles, covered = _climb(lines, pairs, ends)
    origin = origin_at(surface, nodes.patch[lines.node], lines.height)
    return WallTriangles(nodes, triangles, _bare(lines, covered, origin))


def measured_ends(surface: SurfaceMap) -> MeasuredEnds:
    """Return where what was measured ends, in the vertical patches that are drawn out beyond it."""
    low, high = surface.low_end, surface.height
    drawn = np.flatnonzero((surface.moved > 0) & (surface.depth > 0))
    patch = np.concatenate((drawn, drawn))
    height = np.concatenate((surface.bottom[drawn], surface.top[drawn]))
    inside = (low[patch] < height) & (height < high[patch])
    return MeasuredEnds(patch[inside], height[inside])


@kernel
def _joined(
    uprights: _Uprights, beyond: Int64, round_corner: Int64, reach: float
) -> tuple[Int64, Float64]:
    """Return the pairs of vertical patches joined between each cell and the one beyond it.

    Parameters
    ----------
    uprights : _Uprights
    beyond : int64 (C,)
        The other cell, for each cell; -1: not occupied.
    round_corner : int64 (C, 2)
        The two cells between, where these cells share only a corner; -1: none.
    reach : float
        Greatest distance of joined patches.

    Returns
    -------
    pairs : int64 (J, 2)
        Numbers of vertical patches.
    ends : float64 (J, 4)
        The part of each that faces the other: lower and upper end of the first, then of the second.
    """
    size = len(uprights.low)
    # The lowest and the highest patch that each is joined with: row 0 beyond it, row 1 before it.
    lowest, highest = np.full((2, size), NONE), np.full((2, size), NONE)
    pairs = [(np.int64(0), np.int64(0)) for _ in range(0)]
    for cell in range(len(beyond)):
        there = beyond[cell]
        if there < 0:
            continue
        first = uprights.start[there]
        for one in range(uprights.start[cell], uprights.start[cell + 1]):
            while (
                first < uprights.start[there + 1]
                and uprights.low[one] - uprights.high[first] > reach
            ):
                first += 1
            for other in range(first, uprights.start[there + 1]):
                if uprights.low[other] - uprights.high[one] > reach:
                    break
                if not _leads_round(uprights, one, other, round_corner[cell], reach):
                    pairs.append((np.int64(one), np.int64(other)))
                    lowest[0, one] = other if lowest[0, one] == NONE else lowest[0, one]
                    lowest[1, other] = one if lowest[1, other] == NONE else lowest[1, other]
                    highest[0, one], highest[1, other] = other, one
    ends = np.empty((len(pairs), 4))
    for k in range(len(pairs)):
        here, facing = pairs[k]
        for side, mine, others in ((0, here, facing), (1, facing, here)):
            low, high = uprights.low[mine], uprights.high[mine]
            if lowest[side, mine] != others:
                low = min(max(low, uprights.low[others]), high)
            if highest[side, mine] != others:
                high = max(min(high, uprights.high[others]), low)
            ends[k, 2 * side], ends[k, 2 * side + 1] = low, high
        low, high = max(ends[k, 0], ends[k, 2]), min(ends[k, 1], ends[k, 3])
        for side in (0, 2):
            if low - ends[k, side] > reach:
                ends[k, side] = min(low, ends[k, side + 1])
            if ends[k, side + 1] - high > reach:
                ends[k, side + 1] = max(high, ends[k, side])
    found = np.empty((len(pairs), 2), dtype=np.int64)
    for k in range(len(pairs)):
        found[k, 0], found[k, 1] = pairs[k]
    return found, ends


@inner
def _leads_round(
    uprights: _Uprights, one: int, other: int, round_corner: Int64, reach: float
) -> bool:
    """Return whether a patch in one of the cells between two patches is joined with both."""
    for cell in round_corner:
        if cell >= 0:
            for between in range(uprights.start[cell], uprights.start[cell + 1]):
                if (
                    _space(uprights, one, between) <= reach
                    and _space(uprights, between, other) <= reach
                ):
                    return True
    return False


@inner
def _space(uprights: _Uprights, one: int, other: int) -> float:
    """Return how far apart two vertical patches are; below 0: by how much they overlap."""
    low = max(uprights.low[one], uprights.low[other])
    high = min(uprights.high[one], uprights.high[other])
    space: float = low - high
    return space


def _lines(
    nodes: Nodes, patch: Int64, pairs: Int64, ends: Float64, measured: MeasuredEnds, snap: float
) -> tuple[Nodes, _NodesByPatch]:
    """Return the nodes with all cuts, and the lines of all vertical patches.

    Parameters
    ----------
    nodes : Nodes
    patch : int64 (V,)
        The vertical patches.
    pairs, ends
        As `_joined` returns them: `ends` make cuts.
    measured : MeasuredEnds
        They make cuts, too.
    snap : float
        Cuts are no nearer to other vertices.
    """
    upright = np.full(len(nodes.top), NONE)
    upright[patch] = np.arange(len(patch))
    own = np.flatnonzero(upright[nodes.patch] != NONE)
    cut_lines = np.repeat(pairs, 2, axis=1).ravel(), upright[measured.patch]
    cut_heights = ends.ravel(), measured.height
    line = np.concatenate((upright[nodes.patch[own]], *cut_lines))
    height = np.concatenate((nodes.height[own], *cut_heights)) + 0.0
    node = np.concatenate((own, np.full(len(line) - len(own), NONE)))
    order = np.lexsort((height, line))
    line, height, node = line[order], height[order], node[order]
    kept = _kept(line, height, node, snap)
    line, height, node = line[kept], height[kept], node[kept]
    cuts = np.flatnonzero(node == NONE)
    node[cuts] = len(nodes.height) + np.arange(len(cuts))
    grown = nodes._replace(
        patch=np.concatenate((nodes.patch, patch[line[cuts]])),
        height=np.concatenate((nodes.height, height[cuts])),
        is_joint=np.concatenate((nodes.is_joint, np.ones(len(cuts), dtype=np.bool_))),
    )
    return grown, _NodesByPatch(np.searchsorted(line, np.arange(len(patch) + 1)), node, height)


@kernel
def _kept(line: Int64, height: Float64, node: Int64, snap: float) -> Bool:
    """Return which vertices stay: all nodes, and cuts more than `snap` from the others that stay.

    Vertices ascend by line, then by height; `node` is `NONE` for a cut.
    """
    kept = np.ones(len(line), dtype=np.bool_)
    last = 0
    for k in range(1, len(line)):
        if line[k] == line[last] and height[k] - height[last] <= snap:
            if node[k] == NONE:
                kept[k] = False
                continue
            # A node replaces a cut just below it.
            kept[last] = node[last] != NONE
        last = k
    return kept


@kernel
def _climb(lines: _NodesByPatch, pairs: Int64, ends: Float64) -> tuple[Int64, Bool]:
    """Return the triangles between the facing parts of pairs, and which stretches they cover.

    From the lower ends upward, the line whose next vertex is lower goes first (equal: the first).

    Returns
    -------
    triangles : int64 (T, 3)
        Node numbers.
    covered : bool (M,)
        Whether the stretch from a vertex to the next one of its line is covered.
    """
    triangles = [(np.int64(0), np.int64(0), np.int64(0)) for _ in range(0)]
    covered = np.zeros(len(lines.node), dtype=np.bool_)
    for k in range(len(pairs)):
        i, last_i = _at(lines, pairs[k, 0], ends[k, 0]), _at(lines, pairs[k, 0], ends[k, 1])
        j, last_j = _at(lines, pairs[k, 1], ends[k, 2]), _at(lines, pairs[k, 1], ends[k, 3])
        while i < last_i or j < last_j:
            if j == last_j or (i < last_i and lines.height[i + 1] <= lines.height[j + 1]):
                triangles.append((lines.node[i], lines.node[i + 1], lines.node[j]))
                covered[i] = True
                i += 1
            else:
                triangles.append((lines.node[j], lines.node[j + 1], lines.node[i]))
                covered[j] = True
                j += 1
    found = np.empty((len(triangles), 3), dtype=np.int64)
    for k in range(len(triangles)):
        found[k, 0], found[k, 1], found[k, 2] = triangles[k]
    return found, covered


@inner
def _at(lines: _NodesByPatch, line: int, height: float) -> int:
    """Return the position of the vertex of a line that is nearest to a height."""
    begin, end = lines.start[line], lines.start[line + 1]
    above: int = begin + place_of(lines.height[begin:end], height)
    if above == begin:
        return above
    if above == end or height - lines.height[above - 1] < lines.height[above] - height:
        return above - 1
    return above


def _bare(lines: _NodesByPatch, covered: Bool, origin: UInt8) -> Int64:
    """Return the lower and upper node of each uncovered stretch of the lines, int64 (B, 2).

    A stretch is of one origin; `origin` (M,) is that of each vertex.
    """
    is_last = np.zeros(len(lines.node) + 1, dtype=np.bool_)
    is_last[lines.start[1:] - 1] = True
    open_ = np.concatenate(([False], ~covered & ~is_last[:-1], [False]))
    # What is above each vertex lies beyond the points of the patch if one of its ends does.
    above = np.append(np.maximum(origin[:-1], origin[1:]), origin[-1:])
    turns = np.concatenate(([True], above[1:] != above[:-1], [True]))
    begin = np.flatnonzero(open_[1:-1] & (~open_[:-2] | turns[:-1]))
    end = np.flatnonzero(open_[1:-1] & (~open_[2:] | turns[1:]))
    return np.column_stack((lines.node[begin], lines.node[end + 1]))
