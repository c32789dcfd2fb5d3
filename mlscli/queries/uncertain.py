"""Where a map is uncertain: cells that a look would settle, and the regions that they form.

Cells of one kind belong to one region where they share an edge or a corner and their heights, or
intervals of height, come within `gap_size` of each other. Regions that are wider than a stated
length are cut by a grid, so that each can be looked at from one place.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mlscli.maps.cells import GREATEST_INDEX, LEAST_INDEX, pack, unpack
from mlscli.maps.surface_map import ARTIFICIAL, SurfaceMap
from mlscli.queries.sights import refuted
from mlscli.queries.under import never_looked_into
from mlscli.runtime.arrays import Array, Bool, Float64, Int64, UInt8, UInt64, repeated

RED, HOLE, UNSEEN, EDGE = 0, 1, 2, 3
KINDS = ("artificial", "hole", "unseen", "edge")
"""Artificial patches that no sight lines refute; cells without a patch within the map, beside ones
with; space that nobody looked into; and cells beyond its outer edge."""

LEAST_CELLS = 4
"""Regions of fewer cells are left out: a point more or less makes such."""

_BESIDE = [(dx, dy) for dx in (-1, 0, 1) for dy in (-1, 0, 1) if (dx, dy) > (0, 0)]


class Uncertain(NamedTuple):
    """Cells that are uncertain, region by region.

    Attributes
    ----------
    kind : uint8 (N,)
        `RED`, `HOLE`, `UNSEEN` or `EDGE`.
    region : int64 (N,)
        The number of the region that each is of, ascending from 0.
    key : uint64 (N,)
        Packed keys of the cells.
    low, high : float64 (N,)
        From which height to which it is uncertain what is there; equal, where it is one height.
    """

    kind: UInt8
    region: Int64
    key: UInt64
    low: Float64
    high: Float64

    def places(self, side: float) -> Float64:
        """Return the middles, float64 (N, 3), of cells with a side."""
        ix, iy = unpack(self.key)
        return np.column_stack(((ix + 0.5) * side, (iy + 0.5) * side, (self.low + self.high) / 2))


def uncertain(surface: SurfaceMap, widest: float, least: int = 2) -> Uncertain:
    """Return where a map is uncertain.

    Parameters
    ----------
    surface : SurfaceMap
        Without free space, nothing is known of what was never looked into.
    widest : float
        How wide regions may be, in the unit of the map.
    least : int
        So many sight lines show that a voxel is free.
    """
    red = np.flatnonzero((surface.origin == ARTIFICIAL) & ~refuted(surface, least))
    keys = pack(surface.ix, surface.iy)
    rim, height, is_outer = _rims(surface)
    space = never_looked_into(surface, least)
    parts = (
        (RED, keys[red], surface.low_end[red], surface.height[red]),
        (HOLE, rim[~is_outer], height[~is_outer], height[~is_outer]),
        (UNSEEN, pack(space.ix, space.iy), space.low, space.high),
        (EDGE, rim[is_outer], height[is_outer], height[is_outer]),
    )
    cells = max(1, int(widest / surface.cell_size))
    found, regions = [], 0
    for kind, key, low, high in parts:
        region = _regions(key, low, high, surface.gap_size, cells)
        order = np.argsort(region, kind="stable")
        order = order[region[order] >= 0]
        kinds = np.full(len(order), kind, dtype=np.uint8)
        found.append((kinds, region[order] + regions, key[order], low[order], high[order]))
        regions += int(region.max(initial=-1)) + 1
    return Uncertain(*(np.concatenate(columns) for columns in zip(*found, strict=True)))


def _rims(surface: SurfaceMap) -> tuple[UInt64, Float64, Bool]:
    """Return the cells without a patch that share an edge with one that has some.

    Returns
    -------
    keys : uint64 (N,)
        Ascending.
    height : float64 (N,)
        The least of the lowest levels beside each.
    is_outer : bool (N,)
        Whether they lie around the map, or a part of it, and not within.
    """
    cells = surface.cells
    own = pack(cells.ix, cells.iy)
    lowest = surface.height[cells.start[:-1]]
    beside, heights = [], []
    for dx, dy in ((-1, 0), (1, 0), (0, -1), (0, 1)):
        key, inside = _moved(own, dx, dy)
        empty = inside & ~_among(key, own)
        beside.append(key[empty])
        heights.append(lowest[empty])
    keys, place = np.unique(np.concatenate(beside), return_inverse=True)
    height = np.full(len(keys), np.inf)
    np.minimum.at(height, place, np.concatenate(heights))
    level = np.zeros(len(keys))
    ring = _labels(keys, level, level, 0.0)
    # West of the westernmost cell of a hole there is a level; of what lies around, there is none.
    first = np.unique(ring, return_index=True)[1]
    west, inside = _moved(keys[first], -1, 0)
    is_outer = ~(inside & _among(west, own))
    return keys, height, is_outer[ring]


def _regions(key: UInt64, low: Float64, high: Float64, gap: float, cells: int) -> Int64:
    """Return the region of each cell, int64 (N,), -1: it is of one that is too small.

    Parameters
    ----------
    key : uint64 (N,)
        Packed keys, ascending.
    low, high : float64 (N,)
    gap : float
        How far apart in height they may be.
    cells : int
        How wide regions may be.
    """
    if not len(key):
        return np.empty(0, dtype=np.int64)
    label = _labels(key, low, high, gap)
    ix, iy = unpack(key)
    blocks = np.column_stack((label, ix // cells, iy // cells))
    first, region, size = np.unique(
        blocks, axis=0, return_index=True, return_inverse=True, return_counts=True
    )[1:]
    region = region.reshape(-1)
    # Numbered in the order of their first cells.
    number = np.full(len(size), -1, dtype=np.int64)
    kept = np.flatnonzero(size >= LEAST_CELLS)
    number[kept[np.argsort(first[kept])]] = np.arange(len(kept))
    numbered: Int64 = number[region]
    return numbered


def _labels(key: UInt64, low: Float64, high: Float64, gap: float) -> Int64:
    """Return a number for each cell, int64 (N,), the same for those that are connected."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    ends: list[tuple[Array, Array]] = []
    for dx, dy in [(0, 0), *_BESIDE]:
        other, inside = _moved(key, dx, dy)
        begin, end = (np.searchsorted(key, other, side) for side in ("left", "right"))
        one, step = repeated(np.where(inside, end - begin, 0))
        two = begin[one] + step
        near = np.maximum(low[one] - high[two], low[two] - high[one]) <= gap
        ends.append((one[near], two[near]))
    one, two = (np.concatenate(each) for each in zip(*ends, strict=True))
    joined = coo_matrix((np.ones(len(one), dtype=np.bool_), (one, two)), (len(key), len(key)))
    labels: Int64 = connected_components(joined, directed=False)[1].astype(np.int64)
    return labels


def _moved(key: UInt64, dx: int, dy: int) -> tuple[UInt64, Bool]:
    """Return the cells beside cells, and which of them lie on the grid, bool (N,)."""
    ix, iy = (index.astype(np.int64) for index in unpack(key))
    x, y = ix + dx, iy + dy
    inside = (x >= LEAST_INDEX) & (x <= GREATEST_INDEX) & (y >= LEAST_INDEX) & (y <= GREATEST_INDEX)
    moved: UInt64 = pack(
        np.where(inside, x, ix).astype(np.int32), np.where(inside, y, iy).astype(np.int32)
    )
    return moved, inside


def _among(key: UInt64, others: UInt64) -> Bool:
    """Return which keys are among others, ascending, bool (N,)."""
    place = np.minimum(np.searchsorted(others, key), len(others) - 1)
    among: Bool = others[place] == key if len(others) else np.zeros(len(key), dtype=np.bool_)
    return among
