"""Which way the triangles of walls look: outward, where that can be told.

Surfaces look up. A wall that shares an edge with one is turned so that both run through it in
opposite directions: it looks over the floor at its foot and away from the roof at its top. Its
triangles that share an edge with each other are turned alike, so that a wall looks to one side
all along, the side on which more edges agree. Where floors and roofs do not tell (a wall that
stands free), it is still one side; where three walls meet, each is its own. Walls that come back to
themselves turned over, as a Moebius strip, look to one side but for one edge of the way round.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mlscli.runtime.arrays import Bool, Int64
from mlscli.runtime.kernels import inner, kernel


class _Edges(NamedTuple):
    """The three edges of each triangle (3 T,): which it is, and whether its ends ascend."""

    key: Int64
    triangle: Int64
    ascends: Bool


def oriented(walls: Int64, surfaces: Int64) -> Int64:
    """Return the triangles of walls, turned to look outward.

    Parameters
    ----------
    walls, surfaces : int64 (T, 3)
        Node numbers of triangles; those of surfaces run counter-clockwise seen from above.
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
    """Return the pairs of triangles that alone share an edge.

    And whether they run through it in opposite directions.
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
    """Return for each triangle one of those it belongs to, and whether it is turned against that.

    Pairs are joined one by one: of a way round that contradicts itself the last is left out.
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
    """Return the root of a triangle, of which it and all on the way there become children."""
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
    """Return for each wall triangle by how many edges more surfaces agree with it than not."""
    keys, which = np.unique(walls.key, return_inverse=True)
    place = np.minimum(np.searchsorted(keys, surfaces.key), len(keys) - 1)
    met = keys[place] == surfaces.key
    ascending = np.bincount(place[met], np.where(surfaces.ascends[met], 1, -1), minlength=len(keys))
    agree = np.where(walls.ascends, -1, 1) * ascending[which.reshape(-1)]
    return np.bincount(walls.triangle, agree, size).astype(np.int64)
