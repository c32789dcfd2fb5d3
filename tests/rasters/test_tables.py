"""Maps as tables of pandas and datasets of xarray.

How one could cheat: to give views that change the map, or rows in another order than the map's.
"""

from __future__ import annotations

import sys

import numpy as np
import pytest

import mlscli
from mlscli.errors import UsageError
from mlscli.rasters.layers import LAYERS, layers_of
from tests.helpers.meshes import house


def test_a_table_has_a_row_for_each_patch() -> None:
    pytest.importorskip("pandas")
    surface = house()
    table = mlscli.to_pandas(surface)
    assert len(table) == surface.size
    for name, column in surface.columns.items():
        np.testing.assert_array_equal(table[name], column)
        assert table[name].dtype == column.dtype
    np.testing.assert_array_equal(table["x"], (surface.ix + 0.5) * surface.cell_size)
    np.testing.assert_array_equal(table["y"], (surface.iy + 0.5) * surface.cell_size)
    np.testing.assert_array_equal(table["uncertainty"], np.sqrt(surface.height_variance))
    # What is asked in a notebook: cells with several levels, and the clearance in the lowest.
    levels = table.groupby(["ix", "iy"])["level"].max() + 1
    assert sorted(set(levels)) == [1, 3]
    table["height"] = 0.0
    assert surface == house()


def test_a_dataset_has_the_layers_by_place() -> None:
    pytest.importorskip("xarray")
    surface = house()
    data, raster = mlscli.to_xarray(surface), layers_of(surface)
    assert list(data.data_vars) == list(LAYERS)
    assert data.attrs == {"frame_id": "map", "cell_size": surface.cell_size}
    for row, y in enumerate(raster.y):
        for column, x in enumerate(raster.x):
            at = data.sel(x=x + 0.1, y=y - 0.1, method="nearest")
            np.testing.assert_equal(float(at["top"]), raster.layers["top"][row, column])


@pytest.mark.parametrize("name", ["pandas", "xarray"])
def test_what_is_missing_is_named(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(UsageError, match=f"pip install {name}"):
        getattr(mlscli, f"to_{name}")(house())
