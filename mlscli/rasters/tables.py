"""A map as a table of pandas and as a dataset of xarray, for notebooks."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mlscli.errors import UsageError, expect
from mlscli.maps.levels import level_of
from mlscli.maps.surface_map import SurfaceMap
from mlscli.maps.uncovering import patch_places
from mlscli.rasters.layers import LAYERS, layers_of

if TYPE_CHECKING:
    import pandas
    import xarray


def to_pandas(surface: SurfaceMap) -> pandas.DataFrame:
    """Return a map as a table with a row for each patch, in the map's order.

    Returns
    -------
    pandas.DataFrame
        ``x`` and ``y`` of the middle of its cell, its ``level`` there, 0 the lowest; all columns of
        the map; and ``uncertainty``, the standard deviation of its height's error.

    Raises
    ------
    UsageError
        Where pandas is not installed.
    """
    expect(surface, SurfaceMap, "surface", "a map (SurfaceMap)")
    try:
        import pandas
    except ImportError:
        raise UsageError(
            "to_pandas needs pandas, which is not installed: pip install pandas"
        ) from None
    place = patch_places(surface)
    table = {"x": place[:, 0], "y": place[:, 1], "level": level_of(surface)}
    table |= surface.columns | {"uncertainty": np.sqrt(surface.height_variance)}
    return pandas.DataFrame({name: np.array(values) for name, values in table.items()})


def to_xarray(surface: SurfaceMap) -> xarray.Dataset:
    """Return the layers of a map as a dataset over ``y`` and ``x``, the middles of its cells.

    Returns
    -------
    xarray.Dataset
        A variable for each of `mlscli.rasters.layers.LAYERS`; the attributes are the map's
        ``frame_id`` and ``cell_size``.

    Raises
    ------
    UsageError
        Where the map is empty, or too wide for a raster; or xarray is not installed.
    """
    expect(surface, SurfaceMap, "surface", "a map (SurfaceMap)")
    try:
        import xarray
    except ImportError:
        raise UsageError(
            "to_xarray needs xarray, which is not installed: pip install xarray"
        ) from None
    raster = layers_of(surface)
    variables = {
        name: (("y", "x"), values, {"long_name": LAYERS[name]})
        for name, values in raster.layers.items()
    }
    attributes = {"frame_id": surface.frame_id, "cell_size": surface.cell_size}
    return xarray.Dataset(variables, {"y": raster.y, "x": raster.x}, attributes)
