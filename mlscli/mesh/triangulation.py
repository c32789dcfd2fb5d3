"""Which patches of neighbouring cells make one surface, and its triangles.

A horizontal patch has one *node*, at the centre of its cell and at its height. A vertical patch has
two, its top and its foot, and further ones where horizontal patches of the eight cells around meet
it between these, more than `reach` from both. Heights of such patches that follow each other at no
more than `reach` share a node, at their mean. These nodes and the foot are *joints*.

Two nodes in cells that share an edge are *linked* where each is the other's nearest in height
(equal: the higher) and they are at most `reach` apart in height. So a node has at most one link on
each side, and the links between two cells never cross.

In a block of 2 x 2 cells the links form rings and open chains. A ring of four nodes makes two
triangles, cut along the diagonal that is less steep. An open chain makes a triangle of its first
three nodes. Where it is longer, as on a spiral ramp, its last node and the next two make another
triangle, which covers the other half of the block, and so on. (In a chain with an even number of
nodes one end is left out: that of the steeper triangle; equal: the lower end.) The corners of a
triangle are thus linked in a row. A ring or chain of joints alone is not drawn: the inside of a
wall has no floor.

A step that is higher than `reach`, with no wall measured between its levels, stays open: nothing in
the map distinguishes a wall from an overhang there.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mlscli.maps.neighbours import shifted
from mlscli.maps.surface_map import SurfaceMap
from mlscli.runtime.arrays import Bool, Float64, Int64
from mlscli.runtime.kernels import inner, kernel
from mlscli.runtime.sorting import sort_along

NONE = -1
EAST, NORTH, WEST, SOUTH = range(4)
EDGES = ((1, 0), (0, 1), (-1, 0), (0, -1))


class Nodes(NamedTuple):
    """The nodes of all patches: tops and joints, sorted by cell and height.

    Attributes
    ----------
    patch : int64 (N,)
        The patch that a node belongs to.
    height : float64 (N,)
        Height of a node, in the unit of the recording.
    is_joint : bool (N,)
        Whether the node only joins a vertical patch to others: its foot, or between its ends.
    start : int64 (C + 1,)
        The nodes of cell c are ``start[c]`` to ``start[c + 1]``.
    top : int64 (P,)
        The node at each patch's height.
    foot : int64 (P,)
        The node at each patch's lower end; -1 where the patch is horizontal.
    """

    patch: Int64
    height: Float64
    is_joint: Bool
    start: Int64
    top: Int64
    foot: Int64


def nodes_of(surface: SurfaceMap, reach: float) -> Nodes:
    """Return the nodes of a map's patches.

    A depth too small to show in float64 at the patch's height makes no foot.

    Parameters
    ----------
    surface : SurfaceMap
    reach : float
        Greatest difference in height of patches that belong together, in the unit of the recording;
        infinite: there are no joints but feet.
    """
    low, high = surface.low_end + 0.0, surface.height + 0.0
    is_upright = low < high
    upright = np.flatnonzero(is_upright)
    start = surface.cells.start
    between, meeting = np.empty(0, dtype=np.int64), np.empty(0)
    if (high - low > 2 * reach).any():
        between, meeting = _joints(low, high, is_upright, start, _around(surface), reach)
    patch = np.concatenate((np.arange(surface.size), upright, between))
    height = np.concatenate((high, low[upright], meeting))
    order, first = _order(start, patch[surface.size :], height)
    number = np.empty_like(order)
    number[order] = np.arange(len(order))
    foot = np.full(surface.size, NONE)
    foot[upright] = number[surface.size : surface.size + len(upright)]
    is_joint = order >= surface.size
    return Nodes(patch[order], height[order], is_joint, first, number[: surface.size], foot)


@kernel
def _order(start: Int64, joined: Int64, height: Float64) -> tuple[Int64, Int64]:
    """Return the order of nodes by cell and height, and where each cell's begin.

    Nodes of one height keep their order. Few patches have joints, and those of a cell are few: they
    are put in their places among the tops, which ascend already.

    Parameters
    ----------
    start : int64 (C + 1,)
        Where the patches of each cell begin.
    joined : int64 (J,)
        The patches of the nodes that follow the tops of all P patches.
    height : float64 (P + J,)
        Heights of all nodes.

    Returns
    -------
    order : int64 (P + J,)
    first : int64 (C + 1,)
    """
    size = start[-1]
    cells = len(start) - 1
    cell_of = np.empty(size, dtype=np.int64)
    first = start.copy()
    for cell in range(cells):
        cell_of[start[cell] : start[cell + 1]] = cell
    for patch in joined:
        first[cell_of[patch] + 1] += 1
    # What was added to the cells before.
    for cell in range(cells):
        first[cell + 1] += first[cell] - start[cell]
    order = np.empty(size + len(joined), dtype=np.int64)
    end = first[:-1].copy()
    for cell in range(cells):
        for patch in range(start[cell], start[cell + 1]):
            order[end[cell]] = patch
            end[cell] += 1
    for j in range(len(joined)):
        cell, node = cell_of[joined[j]], size + j
        place = end[cell]
        while place > first[cell] and height[order[place - 1]] > height[node]:
            order[place] = order[place - 1]
            place -= 1
        order[place] = node
        end[cell] += 1
    return order, first


def _around(surface: SurfaceMap) -> Int64:
    """Return for each cell the numbers of the eight around it, int64 (C, 8); -1: not occupied."""
    ix, iy, _ = surface.cells
    steps = [(dx, dy) for dx in (-1, 0, 1) for dy in (-1, 0, 1) if dx or dy]
    return np.stack([shifted(ix, iy, *step) for step in steps], axis=1)


@kernel
def _joints(
    low: Float64, high: Float64, is_upright: Bool, start: Int64, around: Int64, reach: float
) -> tuple[Int64, Float64]:
    """Return the joints between the ends of vertical patches.

    Parameters
    ----------
    low, high : float64 (P,)
        Lower and upper ends of the patches.
    is_upright : bool (P,)
        Whether a patch is vertical.
    start : int64 (C + 1,)
        Where the patches of each cell begin.
    around : int64 (C, 8)
        The cells around each cell; -1: not occupied.
    reach : float
        Greatest difference in height of patches that belong together.

    Returns
    -------
    patches : int64 (J,)
        The patch of each joint.
    heights : float64 (J,)
        Its height, ascending in each patch.
    """
    patches, heights = [np.int64(0) for _ in range(0)], [0.0 for _ in range(0)]
    for cell in range(len(around)):
        for patch in range(start[cell], start[cell + 1]):
            if high[patch] - low[patch] <= 2 * reach:
                continue
            met = [0.0 for _ in range(0)]
            for there in around[cell]:
                if there >= 0:
                    for other in range(start[there], start[there + 1]):
                        z = high[other]
                        if not is_upright[other] and z - low[patch] > reach < high[patch] - z:
                            met.append(z)
            ends = np.array(met, dtype=np.float64)
            sort_along(ends, ends)
            first = 0
            for i in range(len(ends)):
                if i + 1 == len(ends) or ends[i + 1] - ends[i] > reach:
                    total = 0.0
                    for z in ends[first : i + 1]:
                        total += z
                    patches.append(np.int64(patch))
                    heights.append(min(max(total / (i + 1 - first), ends[first]), ends[i]))
                    first = i + 1
    return np.array(patches, dtype=np.int64), np.array(heights, dtype=np.float64)


def links(surface: SurfaceMap, nodes: Nodes, reach: float) -> Int64:
    """Return for each node the one it is linked with to the east, north, west and south.

    Parameters
    ----------
    surface : SurfaceMap
    nodes : Nodes
        As `nodes_of` returns them for this map.
    reach : float
        Greatest difference in height of linked nodes, in the unit of the recording.

    Returns
    -------
    int64 (N, 4)
        Node numbers; -1: none.
    """
    ix, iy, _ = surface.cells
    nearest = np.stack(
        [_nearest(nodes.start, nodes.height, shifted(ix, iy, *step)) for step in EDGES], axis=1
    )
    return _mutual(nearest, nodes.height, reach)


@kernel
def _nearest(start: Int64, height: Float64, neighbour: Int64) -> Int64:
    """Return for each node the nearest in height of the neighbouring cell, int64 (N,); -1: none.

    `neighbour` (C,) is the number of that cell, for each cell; -1: not occupied.
    """
    nearest = np.full(len(height), NONE, dtype=np.int64)
    for cell in range(len(neighbour)):
        there = neighbour[cell]
        if there < 0:
            continue
        # Heights ascend in both cells, so that the nearest node only ever moves up.
        best = start[there]
        for node in range(start[cell], start[cell + 1]):
            z = height[node]
            while best + 1 < start[there + 1] and abs(height[best + 1] - z) <= abs(
                height[best] - z
            ):
                best += 1
            nearest[node] = best
    return nearest


@kernel
def _mutual(nearest: Int64, height: Float64, reach: float) -> Int64:
    """Return the links, int64 (N, 4), of nodes that are each other's nearest, within `reach`."""
    link = np.full(nearest.shape, NONE, dtype=np.int64)
    for node in range(len(height)):
        for side in range(4):
            other = nearest[node, side]
            if (
                other >= 0
                and nearest[other, (side + 2) % 4] == node
                and abs(height[node] - height[other]) <= reach
            ):
                link[node, side] = other
    return link


@kernel
def surface_triangles(link: Int64, height: Float64, is_joint: Bool) -> Int64:
    """Return the triangles of the surfaces, counter-clockwise seen from above.

    Parameters
    ----------
    link : int64 (N, 4)
        As `links` returns it.
    height : float64 (N,)
        As in `Nodes`.
    is_joint : bool (N,)
        As in `Nodes`.

    Returns
    -------
    int64 (T, 3)
        Node numbers.
    """
    # A node lies in four blocks, and a ring or chain has at most one triangle for every two nodes.
    triangles = np.empty((2 * len(link), 3), dtype=np.int64)
    found = 0
    for node in range(len(link)):
        # At corner k of a block (counter-clockwise from the south-west), the link on side k leads
        # on round the block, and the link on side k + 1 leads back.
        for corner in range(4):
            if link[node, (corner + 1) % 4] < 0:
                found = _add_chain(triangles, found, node, corner, link, height, is_joint)
        found = _add_ring(triangles, found, node, link, height, is_joint)
    return triangles[:found]


@inner
def _add_ring(
    triangles: Int64, found: int, a: int, link: Int64, height: Float64, is_joint: Bool
) -> int:
    """Add the triangles of the ring of four whose south-western node is `a`, if there is one.

    Parameters
    ----------
    triangles : int64 (2 N, 3)
        The triangles so far, and room for more.
    found : int
        How many triangles there are so far.
    a : int
        A node.
    link, height, is_joint
        As in `surface_triangles`.

    Returns
    -------
    int
        How many triangles there are now.
    """
    b = link[a, EAST]
    c = link[b, NORTH] if b >= 0 else NONE
    d = link[c, WEST] if c >= 0 else NONE
    if d < 0 or link[d, SOUTH] != a:
        return found
    if is_joint[a] and is_joint[b] and is_joint[c] and is_joint[d]:
        return found
    if abs(height[a] - height[c]) <= abs(height[b] - height[d]):
        found = _add(triangles, found, a, b, c)
        return _add(triangles, found, a, c, d)
    found = _add(triangles, found, b, c, d)
    return _add(triangles, found, b, d, a)


@inner
def _add_chain(
    triangles: Int64,
    found: int,
    first: int,
    corner: int,
    link: Int64,
    height: Float64,
    is_joint: Bool,
) -> int:
    """Add the triangles of the open chain that begins at a node in the given corner of a block.

    Parameters
    ----------
    triangles : int64 (2 N, 3)
        The triangles so far, and room for more.
    found : int
        How many triangles there are so far.
    first : int
        The node at which the chain begins.
    corner : int
        The corner of the block in which `first` lies, 0 to 3 counter-clockwise from the south-west.
    link, height, is_joint
        As in `surface_triangles`.

    Returns
    -------
    int
        How many triangles there are now.
    """
    size, last, solid = 1, first, not is_joint[first]
    while link[last, (corner + size - 1) % 4] >= 0:
        last = link[last, (corner + size - 1) % 4]
        solid = solid or not is_joint[last]
        size += 1
    if size < 3 or not solid:
        return found
    a, side = first, corner
    b = link[a, side]
    c = link[b, (side + 1) % 4]
    if size % 2 == 0:
        before_last = link[last, (corner + size) % 4]
        third_last = link[before_last, (corner + size - 1) % 4]
        tilt, tilt_last = abs(height[a] - height[c]), abs(height[last] - height[third_last])
        if tilt_last < tilt or (tilt_last == tilt and height[last] > height[a]):
            a, side = b, side + 1
    for _ in range((size - 1) // 2):
        b = link[a, side % 4]
        c = link[b, (side + 1) % 4]
        found = _add(triangles, found, a, b, c)
        a, side = c, side + 2
    return found


@inner
def _add(triangles: Int64, found: int, a: int, b: int, c: int) -> int:
    triangles[found, 0], triangles[found, 1], triangles[found, 2] = a, b, c
    return found + 1
