"""The rectangle of cells that a raster covers."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mlscli.errors import UsageError
from mlscli.maps.surface_map import SurfaceMap
from mlscli.runtime.arrays import Array, Int32

MOST_CELLS = 2**26
"""The largest raster: one stray point far away would make it as large as memory."""


class Extent(NamedTuple):
    """A rectangle of cells.

    Attributes
    ----------
    min_x, min_y : int
        The least cell indices.
    width, height : int
        How many cells it has along x and along y.
    """

    min_x: int
    min_y: int
    width: int
    height: int

    @classmethod
    def of(cls, ix: Int32, iy: Int32) -> Extent:
        """Return the smallest rectangle that holds cells.

        Raises
        ------
        UsageError
            Where there are none, or the rectangle holds more than `MOST_CELLS`.
        """
        if not len(ix):
            raise UsageError("the map is empty; there is nothing to make a raster of")
        low_x, low_y, high_x, high_y = (
            int(end) for end in (ix.min(), iy.min(), ix.max(), iy.max())
        )
        extent = cls(low_x, low_y, high_x - low_x + 1, high_y - low_y + 1)
        if extent.width * extent.height > MOST_CELLS:
            raise UsageError(
                f"the map spans {extent.width:,} x {extent.height:,} cells; a raster can have "
                f"{MOST_CELLS:,}. Build it with larger cells, or without what lies far away: `crop`"
            )
        return extent

    @classmethod
    def of_map(cls, surface: SurfaceMap, *, with_free: bool = False) -> Extent:
        """Return that of the cells that hold patches, or also those of free space, see `of`."""
        ix, iy = surface.cells.ix, surface.cells.iy
        if with_free and surface.free is not None:
            ix = np.concatenate((ix, surface.free.ix))
            iy = np.concatenate((iy, surface.free.iy))
        return cls.of(ix, iy)

    def place(self, values: Array, ix: Int32, iy: Int32, empty: object) -> Array:
        """Return values of cells as a raster (height, width): row by row along x, from low y up.

        Parameters
        ----------
        values : (C,)
        ix, iy : int32 (C,)
            Cells within the rectangle.
        empty : object
            The value of all other cells.
        """
        raster = np.full((self.height, self.width), empty, dtype=values.dtype)
        raster[iy - self.min_y, ix - self.min_x] = values
        return raster
