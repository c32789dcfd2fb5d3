"""A growing map, kept in square tiles so that replacing an area costs what the area costs."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mlscli.cells import CellSet, pack, unpack
from mlscli.surface_map import SurfaceMap

# A tile is 2**6 cells wide.
SHIFT = 6


class TiledMap:
    """Patches by tile; no call touches more tiles than it names cells in.

    Parameters
    ----------
    empty : SurfaceMap
        A map without patches, which gives cell size, gap size and thickness.
    """

    def __init__(self, empty: SurfaceMap) -> None:
        self._empty = empty
        self._tiles: dict[int, SurfaceMap] = {}

    def extract(self, cells: CellSet) -> SurfaceMap:
        """Return the patches in `cells`."""
        parts = [self._tiles[tile].in_cells(cells) for tile in _tiles(cells) if tile in self._tiles]
        return _together(self._empty, parts)

    def replace(self, cells: CellSet, new: SurfaceMap) -> None:
        """Replace the patches in `cells` by `new`, all of which lie in them."""
        tile_of = pack(new.ix >> SHIFT, new.iy >> SHIFT)
        for tile in _tiles(cells):
            before = self._tiles.get(tile, self._empty)
            outside = before.take(~cells.contains(before.ix, before.iy))
            after = outside.union(new.take(tile_of == tile))
            if after.size:
                self._tiles[tile] = after
            else:
                self._tiles.pop(tile, None)

    def whole(self) -> SurfaceMap:
        """Return the map of all tiles."""
        return _together(self._empty, list(self._tiles.values()))


def _tiles(cells: CellSet) -> Iterator[int]:
    ix, iy = unpack(cells.keys)
    yield from np.unique(pack(ix >> SHIFT, iy >> SHIFT)).tolist()


def _together(empty: SurfaceMap, parts: list[SurfaceMap]) -> SurfaceMap:
    if not parts:
        return empty
    names = empty.columns
    return parts[0].with_columns(
        **{name: np.concatenate([part.columns[name] for part in parts]) for name in names}
    )
