"""A map kept cell by cell."""

from __future__ import annotations

from mlscli.maps.cells import CellSet
from mlscli.maps.change import Change
from mlscli.maps.grid import Grid
from mlscli.maps.kept_rows import KeptRows
from mlscli.maps.records import WORDS, records_in, records_of, rows_in, surface_of
from mlscli.maps.surface_map import SurfaceMap
from mlscli.runtime.arrays import Array


class KeptMap:
    """A map that is read and changed area by area.

    Parameters
    ----------
    grid : Grid
    """

    def __init__(self, grid: Grid) -> None:
        self._grid = grid
        self._rows = KeptRows(WORDS)

    def extract(self, cells: CellSet) -> SurfaceMap:
        """Return the patches in `cells`, without a route."""
        return surface_of(self.records(cells), self._grid)

    def records(self, cells: CellSet) -> Array:
        """Return the patches in `cells` as records, in the file's order."""
        return records_in(self._rows.extract(cells))

    def replace(self, cells: CellSet, new: SurfaceMap | Array) -> Change:
        """Replace the patches in `cells` by those that `new` has there, and return what changes.

        Parameters
        ----------
        cells : CellSet
        new : SurfaceMap or PATCH (P,)
            A map, or records, in the file's order.
        """
        records = records_of(new) if isinstance(new, SurfaceMap) else new
        return Change(*self._rows.update(cells, rows_in(records)), self._grid)

    def whole(self) -> SurfaceMap:
        """Return the whole map, without a route."""
        return surface_of(records_in(self._rows.whole()), self._grid)
