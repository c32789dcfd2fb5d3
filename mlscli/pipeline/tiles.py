"""What grows, kept in square tiles, so that an area costs what the area costs.

Points and patches are kept alike: as records, each with its cell, in one array for each tile.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from mlscli.cells import CellSet, cell_indices, pack
from mlscli.keyframes import Points
from mlscli.patches import runs
from mlscli.surface_map import COLUMNS, SurfaceMap
from mlscli.typing import Array

# A tile is 2**5 cells wide: about what a batch of a sparse cloud touches.
SHIFT = 5

PATCH = np.dtype(list(COLUMNS.items()))
POINT = np.dtype(
    [("ix", np.int32), ("iy", np.int32), ("xyz", np.float64, (3,)), ("keyframe", np.int32)]
)


class Tiles:
    """Records by tile, ascending by cell in each; those of one cell stay in their order.

    No call touches more tiles than it names cells in.

    Parameters
    ----------
    dtype : numpy.dtype
        Of the records; its fields `ix` and `iy` are the cell.
    """

    def __init__(self, dtype: np.dtype[Any]) -> None:
        self._dtype = dtype
        # Bytes without fields, which numpy puts together faster.
        self._none = np.empty(0, (np.void, dtype.itemsize))
        self._tiles: dict[int, Array] = {}

    def extract(self, cells: CellSet) -> Array:
        """Return the records in `cells`, ascending by cell."""
        tiles = cells.squares(SHIFT).among(self._tiles.keys())
        near = self._joined(self._tiles[tile] for tile in tiles)
        return self._by_cell(near[cells.contains(near["ix"], near["iy"])])

    def replace(self, cells: CellSet, new: Array) -> None:
        """Replace the records in `cells` by `new`."""
        tiles = set(cells.squares(SHIFT).among(self._tiles.keys()))
        tiles |= self._tiles.keys() & set(pack(new["ix"] >> SHIFT, new["iy"] >> SHIFT).tolist())
        before = self._joined(self._tiles[tile] for tile in tiles)
        outside = before[~cells.contains(before["ix"], before["iy"])]
        after = self._by_cell(self._joined([outside, new]))
        tile_of = pack(after["ix"] >> SHIFT, after["iy"] >> SHIFT)
        order = np.argsort(tile_of, kind="stable")
        rows, tile_of = after[order].view(self._none.dtype), tile_of[order]
        start = runs(tile_of)
        for tile, (begin, end) in zip(tile_of[start[:-1]].tolist(), pairwise(start), strict=True):
            # A copy: a view would hold on to the other tiles.
            self._tiles[tile] = rows[begin:end].copy()
            tiles.discard(tile)
        for emptied in tiles:
            del self._tiles[emptied]

    def whole(self) -> Array:
        """Return all records, ascending by cell."""
        return self._by_cell(self._joined(self._tiles.values()))

    def _joined(self, parts: Iterable[Array]) -> Array:
        rows = [self._none, *(part.view(self._none.dtype) for part in parts)]
        return np.concatenate(rows).view(self._dtype)

    def _by_cell(self, records: Array) -> Array:
        """Return records ascending by cell; those of one cell stay in their order."""
        order = np.argsort(pack(records["ix"], records["iy"]), kind="stable")
        return records.view(self._none.dtype)[order].view(self._dtype)


class TiledMap:
    """A map, kept in tiles.

    Parameters
    ----------
    empty : SurfaceMap
        A map without patches, which gives cell size, gap size, thickness and frame.
    """

    def __init__(self, empty: SurfaceMap) -> None:
        self._empty = empty
        self._tiles = Tiles(PATCH)

    def extract(self, cells: CellSet) -> SurfaceMap:
        """Return the patches in `cells`."""
        return surface_of(self._tiles.extract(cells), self._empty)

    def replace(self, cells: CellSet, new: SurfaceMap) -> None:
        """Replace the patches in `cells` by `new`, all of which lie in them."""
        self._tiles.replace(cells, records_of(new))

    def whole(self) -> SurfaceMap:
        """Return the map of all tiles."""
        return surface_of(self._tiles.whole(), self._empty)


class TiledPoints:
    """Points, kept in tiles.

    Parameters
    ----------
    cell_size : float
    """

    def __init__(self, cell_size: float) -> None:
        self._cell_size = cell_size
        self._tiles = Tiles(POINT)

    def extract(self, cells: CellSet) -> Points:
        """Return the points in `cells`, ascending by cell."""
        records = self._tiles.extract(cells)
        return Points(
            np.ascontiguousarray(records["xyz"]), np.ascontiguousarray(records["keyframe"])
        )

    def add(self, points: Points) -> None:
        """Add points to those that there are."""
        self.replace(CellSet.of(*np.empty((2, 0), dtype=np.int32)), points)

    def replace(self, cells: CellSet, new: Points) -> None:
        """Replace the points in `cells` by `new`."""
        records = np.empty(new.size, POINT)
        records["ix"], records["iy"] = cells_of(new, self._cell_size)
        records["xyz"], records["keyframe"] = new
        self._tiles.replace(cells, records)


def records_of(surface: SurfaceMap) -> Array:
    """Return the patches as records, (P,)."""
    records = np.empty(surface.size, PATCH)
    for name, column in surface.columns.items():
        records[name] = column
    return records


def surface_of(records: Array, like: SurfaceMap) -> SurfaceMap:
    """Return the map of records, in their order; all but its patches is like another's."""
    columns: dict[str, Any] = {name: np.ascontiguousarray(records[name]) for name in COLUMNS}
    return replace(like, **columns)


def cells_of(points: Points, cell_size: float) -> Array:
    """Return the cell indices (ix, iy) of points, int32 (2, N); all lie on the grid."""
    return cell_indices(points.xyz[:, :2], cell_size).astype(np.int32).T
