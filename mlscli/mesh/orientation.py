"""Which way the triangles of walls look: outward, where that can be told.

Surfaces look up. A wall that shares an edge with one is turned so that both run through it in
opposite directions: it looks over the floor at its foot and away from the roof at its top. Its
triangles that share an edge with each other are turned alike, so that a wall looks to one side
all along, the side on which more edges agree. Where floors and roofs do not tell (a wall that
stands free), it is still one side; where three walls meet, each is its own.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from mlscli.typing import Bool, Int64


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
    one, other, differ = _shared_by_two(mine)
    # Each triangle is there twice, as it is and turned over; what belongs together is linked.
    turn = len(walls)
    here = np.concatenate((one, one + turn))
    there = np.where(differ, other, other + turn)
    there = np.concatenate((there, (there + turn) % (2 * turn)))
    links = coo_array((np.ones(len(here), dtype=np.bool_), (here, there)), (2 * turn, 2 * turn))
    count, component = connected_components(links, directed=False)
    votes = _votes(mine, others, turn)
    score = np.bincount(component, np.concatenate((votes, -votes)), count)
    as_is, over = component[:turn], component[turn:]
    turned = (score[over] > score[as_is]) | ((score[over] == score[as_is]) & (over < as_is))
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


def _votes(walls: _Edges, surfaces: _Edges, size: int) -> Int64:
    """Return for each wall triangle by how many edges more surfaces agree with it than not."""
    keys, which = np.unique(walls.key, return_inverse=True)
    place = np.minimum(np.searchsorted(keys, surfaces.key), len(keys) - 1)
    met = keys[place] == surfaces.key
    ascending = np.bincount(place[met], np.where(surfaces.ascends[met], 1, -1), minlength=len(keys))
    agree = np.where(walls.ascends, -1, 1) * ascending[which.reshape(-1)]
    return np.bincount(walls.triangle, agree, size).astype(np.int64)
