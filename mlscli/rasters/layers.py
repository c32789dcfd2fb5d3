"""A map as layers: for each cell one number of each kind."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mlscli.errors import expect
from mlscli.maps.surface_map import SurfaceMap
from mlscli.rasters.extent import Extent
from mlscli.runtime.arrays import Array, Float64

LAYERS = {
    "ground": "height of the lowest level",
    "top": "height of the highest level",
    "clearance": "from the lowest level up to the underside of the next",
    "levels": "how many levels there are",
    "count": "how many points measured the cell's levels",
    "origin": "of the lowest level: 0 measured, 1 plastered, 2 artificial",
    "variance": "of the heights that measured the lowest level",
    "uncertainty": "standard deviation of the error of ground",
    "top_uncertainty": "standard deviation of the error of top",
}
"""The layers, and what each holds; lengths are in the unit of the map.

A cell without a patch is NaN in all of them, but 0 in ``levels`` and ``count``. Clearance is NaN
where nothing is above; variance and uncertainty where they are not known.
"""

HEIGHTS = ("ground", "top")
"""Those that are heights in the frame of the map."""


class Layers(NamedTuple):
    """The layers of a map.

    Attributes
    ----------
    extent : Extent
        The cells that they cover.
    cell_size : float
        In the unit of the map.
    layers : dict of str to float64 (H, W)
        As `LAYERS` lists them: row by row along x, from low y up.
    """

    extent: Extent
    cell_size: float
    layers: dict[str, Float64]

    @property
    def x(self) -> Float64:
        """The x of the cells' middles, float64 (W,), ascending."""
        return _middles(self.extent.min_x, self.extent.width, self.cell_size)

    @property
    def y(self) -> Float64:
        """The y of the cells' middles, float64 (H,), ascending."""
        return _middles(self.extent.min_y, self.extent.height, self.cell_size)


def _middles(least: int, number: int, cell_size: float) -> Float64:
    middles: Float64 = (least + np.arange(number, dtype=np.float64) + 0.5) * cell_size
    return middles


def layers_of(surface: SurfaceMap) -> Layers:
    """Return the layers of a map.

    Raises
    ------
    TypeError
        Where `surface` is no map.
    UsageError
        Where the map is empty, or too wide for a raster.
    """
    expect(surface, SurfaceMap, "surface", "a map (SurfaceMap)")
    extent, cells = Extent.of_map(surface), surface.cells
    first, last = cells.start[:-1], cells.start[1:] - 1
    levels = last - first + 1
    second = np.minimum(first + 1, last)
    above = np.where(levels > 1, surface.low_end[second] - surface.height[first], np.nan)
    sigma = np.sqrt(surface.height_variance)
    values: dict[str, Array] = {
        "ground": surface.height[first],
        "top": surface.height[last],
        "clearance": above,
        "levels": levels,
        "count": np.add.reduceat(surface.count.astype(np.int64), first),
        "origin": surface.origin[first],
        "variance": surface.variance[first],
        "uncertainty": sigma[first],
        "top_uncertainty": sigma[last],
    }
    counts = {"levels", "count"}
    return Layers(
        extent,
        surface.cell_size,
        {
            name: extent.place(
                values[name].astype(np.float64), cells.ix, cells.iy, 0 if name in counts else np.nan
            )
            for name in LAYERS
        },
    )


def level_heights(surface: SurfaceMap, extent: Extent, level: int) -> Float64:
    """Return the heights of a level, float64 (H, W), NaN where there is none; 0 is the lowest."""
    cells = surface.cells
    there = np.diff(cells.start) > level
    heights = surface.height[cells.start[:-1][there] + level]
    placed: Float64 = extent.place(heights, cells.ix[there], cells.iy[there], np.nan)
    return placed
