"""The orientation of wall triangles: outward, where floors and roofs show which side that is.

Surfaces face up. A wall triangle that shares an edge with a surface triangle should run through the
edge in the opposite direction: it then faces the floor at its foot, and away from the roof at its
top. Wall triangles that share an edge which no third one has are turned alike, so that a wall faces
one side all along: the side on which most of its edges with surfaces agree. A free-standing wall
also faces one side all along, but either one. Where three walls meet, each is turned by itself. A
wall that returns to itself turned over, like a Moebius strip, faces one side except at one edge.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mlscli.runtime.arrays import Bool, Int64
from mlscli.runtime.kernels import inner, kernel


class _Edges(NamedTuple):
    """The three edges of each of T triangles.

    Attributes
    ----------
    key : int64 (3 T,)
        A number that is the same for all triangles at an edge: its lower node times the number of
        nodes, plus its higher node.
    triangle : int64 (3 T,)
        Index of the triangle.
    ascends : bool (3 T,)
        Whether the triangle runs from the lower node to the higher one.
    """

    key: Int64
    triangle: Int64
    ascends: Bool


def oriented(walls: Int64, surfaces: Int64) -> Int64:
    """Return the triangles of walls, int64 (T, 3), turned to face outward.

    Parameters
    ----------
    walls : int64 (T, 3)
        Node numbers of the triangles of walls.
    surfaces : int64 (S, 3)
        Node numbers of the triangles of surfaces, counter-clockwise seen from above.
    """
    if len(walls) == 0:
        return walls
    size = int(max(walls.max(), surfaces.max(initial=0))) + 1
    mine, others = _edges(walls, size), _edges(surfaces, size)
    first, over = _joined(*_shared_by_two(mine), len(walls))
    votes = np.where(over, -1, 1) * _votes(mine, others, len(walls))
    turned = over ^ (np.bincount(first, votes, len(walls))[first] < 0)
    result = walls.copy()
    result[turned] = walls[turned][:, ::-1]
    return result


def _edges(triangles: Int64, size: int) -> _Edges:
    begin, end = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    key = np.minimum(begin, end) * size + np.maximum(begin, end)
    return _Edges(key, np.repeat(np.arange(len(triangles)), 3), begin < end)


def _shared_by_two(edges: _Edges) -> tuple[Int64, Int64, Bool]:
    """Return the pairs of triangles that share an edge which no third triangle has.

    Returns
    -------
    one, other : int64 (E,)
        Indices of the triangles.
    differ : bool (E,)
        Whether the two run through the edge in opposite directions.
    """
    order = np.argsort(edges.key, kind="stable")
    key = edges.key[order]
    first = np.flatnonzero(np.append(True, key[1:] != key[:-1]))
    first = first[np.diff(np.append(first, len(key))) == 2]
    one, other = order[first], order[first + 1]
    differ = edges.ascends[one] != edges.ascends[other]
    return edges.triangle[one], edges.triangle[other], differ


@kernel
def _joined(one: Int64, other: Int64, differ: Bool, size: int) -> tuple[Int64, Bool]:
    """Return for each triangle a representative of its wall, and whether to turn it against that.

    Pairs are joined one by one (union-find); a pair of triangles that are already joined is
    skipped, even where it contradicts the others. Arguments are as `_shared_by_two` returns them,
    and the number of triangles.
    """
    parent, over = np.arange(size), np.zeros(size, dtype=np.bool_)
    for pair in range(len(one)):
        here, there = one[pair], other[pair]
        first, second = _root(parent, over, here), _root(parent, over, there)
        if first != second:
            # A root is never turned against itself.
            parent[second] = first
            over[second] = over[here] ^ over[there] ^ (not differ[pair])
    for triangle in range(size):
        _root(parent, over, triangle)
    return parent, over


@inner
def _root(parent: Int64, over: Bool, triangle: int) -> int:
    """Return the root of a triangle; the triangle and all above it become children of the root."""
    root, turned = triangle, False
    while parent[root] != root:
        turned ^= over[root]
        root = parent[root]
    while triangle != root:
        above, rest = parent[triangle], turned ^ over[triangle]
        parent[triangle], over[triangle] = root, turned
        triangle, turned = above, rest
    return root


def _votes(walls: _Edges, surfaces: _Edges, size: int) -> Int64:
    """Return for each wall triangle how many edges of surfaces agree with it, minus the others.

    An edge of a surface agrees where the two triangles run through it in opposite directions.
    """
    keys, which = np.unique(walls.key, return_inverse=True)
    place = np.minimum(np.searchsorted(keys, surfaces.key), len(keys) - 1)
    met = keys[place] == surfaces.key
    ascending = np.bincount(place[met], np.where(surfaces.ascends[met], 1, -1), minlength=len(keys))
    agree = np.where(walls.ascends, -1, 1) * ascending[which.reshape(-1)]
    return np.bincount(walls.triangle, agree, size).astype(np.int64)
