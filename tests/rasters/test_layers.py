"""Layers of a map, cell by cell.

How one could cheat: to swap x and y, or to put what is not known as 0; to take the highest level
for the lowest.
"""

from __future__ import annotations

import numpy as np
import pytest

from mlscli.errors import UsageError
from mlscli.rasters.layers import LAYERS, layers_of, level_heights
from tests.helpers.maps import map_of, random_map


def test_each_cell_has_what_its_patches_say() -> None:
    rng = np.random.default_rng(4)
    for _ in range(40):
        surface = random_map(rng)
        if not surface.size:
            continue
        extent, size, layers = layers_of(surface)
        raster = layers_of(surface)
        assert list(layers) == list(LAYERS)
        errors = np.sqrt(surface.height_variance)
        for row, column in np.ndindex(extent.height, extent.width):
            x, y = raster.x[column], raster.y[row]
            here = np.flatnonzero(
                (surface.ix == np.floor(x / size)) & (surface.iy == np.floor(y / size))
            )
            expected = dict.fromkeys(LAYERS, np.nan) | {"levels": 0.0, "count": 0.0}
            if len(here):
                low, high = here[0], here[-1]
                expected = {
                    "ground": surface.height[here].min(),
                    "top": surface.height[here].max(),
                    "clearance": np.nan,
                    "levels": len(here),
                    "count": surface.count[here].sum(),
                    "origin": surface.origin[low],
                    "variance": surface.variance[low],
                    "uncertainty": errors[low],
                    "top_uncertainty": errors[high],
                }
                if len(here) > 1:
                    under = surface.height[here[1]] - surface.depth[here[1]]
                    expected["clearance"] = under - surface.height[low]
            for name, value in expected.items():
                np.testing.assert_equal(layers[name][row, column], float(value))
            for level in range(4):
                height = surface.height[here[level]] if level < len(here) else np.nan
                np.testing.assert_equal(level_heights(surface, extent, level)[row, column], height)


def test_a_map_of_nothing_has_no_layers() -> None:
    with pytest.raises(UsageError, match="empty"):
        layers_of(map_of([]))
