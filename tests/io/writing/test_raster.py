"""Layers in files, read by numpy, xarray and rasterio.

How one could cheat: to write rows upside down, or shifted by half a cell; each cell is looked for
by its coordinates, in a map without symmetry. A GeoTIFF that says nothing of where it lies would
pass for one that does.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.io import netcdf_file

from mlscli.errors import OutputError, UsageError
from mlscli.io.writing.npz import is_map
from mlscli.io.writing.raster import write_layers
from mlscli.rasters.layers import LAYERS, Layers, layers_of
from mlscli.runtime.arrays import Float64
from tests.helpers.maps import map_of
from tests.helpers.meshes import house

# Of rasterio, which multiplies affine matrices as they were multiplied before.
pytestmark = pytest.mark.filterwarnings("ignore:Use .* matmul:PendingDeprecationWarning")

Found = dict[str, Float64]


def expect_equal(found: Found, raster: Layers) -> None:
    assert list(found) == list(LAYERS)
    for name, values in raster.layers.items():
        np.testing.assert_array_equal(found[name], values)


def test_numpy_finds_every_layer(tmp_path: Path) -> None:
    surface = house()
    raster = write_layers(tmp_path / "a.npz", surface, "npz")
    with np.load(tmp_path / "a.npz") as arrays:
        found = {name: arrays[name] for name in arrays.files}
    assert str(found.pop("frame_id")) == surface.frame_id
    assert float(found.pop("cell_size")) == surface.cell_size
    np.testing.assert_array_equal(found.pop("x"), raster.x)
    np.testing.assert_array_equal(found.pop("y"), raster.y)
    expect_equal(found, layers_of(surface))
    assert not is_map(tmp_path / "a.npz")


def test_xarray_finds_every_layer(tmp_path: Path) -> None:
    xarray = pytest.importorskip("xarray")
    surface = house()
    write_layers(tmp_path / "a.nc", surface, "netcdf")
    with xarray.open_dataset(tmp_path / "a.nc", engine="scipy") as data:
        assert (data.attrs["cell_size"], data.attrs["frame_id"]) == (surface.cell_size, "map")
        raster = layers_of(surface)
        np.testing.assert_array_equal(data["x"], raster.x)
        np.testing.assert_array_equal(data["y"], raster.y)
        expect_equal({name: data[name].values for name in data.data_vars}, raster)
        assert data["clearance"].attrs["long_name"] == LAYERS["clearance"]


@pytest.mark.parametrize("frame", ["straße/地図\u202e", '"<b>&\x1b[31m]]>\n- x: y'])
def test_a_netcdf_file_has_the_frame_whatever_it_is_called(frame: str, tmp_path: Path) -> None:
    write_layers(tmp_path / "a.nc", replace(house(), frame_id=frame), "netcdf")
    with netcdf_file(tmp_path / "a.nc", mmap=False) as file:
        assert file.frame_id.decode() == frame


def test_rasterio_finds_every_cell_at_its_place(tmp_path: Path) -> None:
    rasterio = pytest.importorskip("rasterio")
    surface = house()
    write_layers(tmp_path / "a.tif", surface, "geotiff", crs="EPSG:32632")
    raster = layers_of(surface)
    with rasterio.open(tmp_path / "a.tif") as file:
        assert file.crs.to_epsg() == 32632
        assert list(file.descriptions) == list(LAYERS)
        assert np.isnan(file.nodata)
        assert file.res == (surface.cell_size, surface.cell_size)
        places = [(x, y) for y in raster.y for x in raster.x]
        expected = np.array([layer.ravel() for layer in raster.layers.values()]).T
        np.testing.assert_array_equal(np.array(list(file.sample(places))), expected)


def test_a_geotiff_without_a_system_says_so_and_turned_maps_have_none(tmp_path: Path) -> None:
    rasterio = pytest.importorskip("rasterio")
    surface = house()
    write_layers(tmp_path / "a.tif", surface, "geotiff")
    with rasterio.open(tmp_path / "a.tif") as file:
        assert file.crs is None
    with pytest.raises(UsageError, match=r"`crs`: is 'EPSG:999999', which is none"):
        write_layers(tmp_path / "b.tif", surface, "geotiff", crs="EPSG:999999")
    surface.meta["map_from_recording"] = [[1, 0, 0, 5], [0, 0, 1, 6], [0, -1, 0, 7], [0, 0, 0, 1]]
    with pytest.raises(UsageError, match=r"`crs`.*not those of the recording"):
        write_layers(tmp_path / "b.tif", surface, "geotiff", crs="EPSG:32632")
    assert not (tmp_path / "b.tif").exists()


def test_the_same_map_gives_the_same_bytes(tmp_path: Path) -> None:
    for kind in ("npz", "netcdf"):
        for name in "ab":
            write_layers(tmp_path / name, house(), kind, overwrite=True)
        assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_what_cannot_be_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(UsageError, match="`kind`: is 'hdf'"):
        write_layers(tmp_path / "a", house(), "hdf")
    with pytest.raises(UsageError, match="`crs`: npz does not take it"):
        write_layers(tmp_path / "a", house(), "npz", crs="EPSG:32632")
    with pytest.raises(UsageError, match="empty"):
        write_layers(tmp_path / "a", map_of([]), "npz")
    monkeypatch.setitem(sys.modules, "rasterio.crs", None)
    with pytest.raises(UsageError, match=r"pip install 'mlscli\[geo\]'"):
        write_layers(tmp_path / "a", house(), "geotiff")
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "a").write_bytes(b"mine")
    with pytest.raises(OutputError, match="exists already"):
        write_layers(tmp_path / "a", house(), "npz")
