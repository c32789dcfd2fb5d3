"""Where on Earth a map lies, in its meta and in files.

How one could cheat: to take any text for a reference system; to compare names, so that one system
told in two ways is two, or two offsets are one place; to place a turned map by its x and y; to
name a system and leave its offset out. Files are read back by rasterio, laspy and xarray.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import laspy
import numpy as np
import pytest

from mlscli.errors import InputError, UsageError
from mlscli.io.writing.clouds import write_cloud
from mlscli.io.writing.raster import write_layers
from mlscli.maps.georeference import Georeference, georeference_of, map_georeference, named_crs
from mlscli.maps.merging import merge_maps
from mlscli.maps.surface_map import SurfaceMap
from mlscli.rasters.layers import layers_of
from tests.helpers.meshes import house

pytestmark = pytest.mark.filterwarnings("ignore:Use .* matmul:PendingDeprecationWarning")

WKT = 'PROJCS["mine",GEOGCS["WGS 84",AUTHORITY["EPSG","4326"]],AUTHORITY["EPSG","32632"]]'
OFFSET = (500_000.0, 5_200_000.0, 400.0)
PLACE = Georeference("EPSG:32632", OFFSET, "a test")
TURN = [[1, 0, 0, 5], [0, 0, 1, 6], [0, -1, 0, 7], [0, 0, 0, 1]]


def placed(place: Georeference = PLACE, **meta: object) -> SurfaceMap:
    return replace(house(), meta={"georeference": place.to_dict(), **meta})


def test_codes_and_texts_are_told_from_all_else() -> None:
    assert [named_crs(text) for text in ("epsg:32632", " 25832+7837 ")] == [
        "EPSG:32632",
        "EPSG:25832+7837",
    ]
    assert named_crs(WKT) == WKT
    local = 'LOCAL_CS["a hall",UNIT["metre",1]]'
    for wrong in ("", "UTM 32N", "EPSG:12", local, WKT[:-1], WKT.replace('"mine', "mine")):
        with pytest.raises(UsageError, match=r"`crs`: is .*expected an EPSG code"):
            named_crs(wrong)


def test_two_places_are_the_same_by_system_and_offset() -> None:
    assert PLACE.is_same(Georeference(WKT, OFFSET))
    assert not PLACE.is_same(PLACE._replace(crs="EPSG:32633"))
    assert not PLACE.is_same(PLACE._replace(offset=(0.0, 0.0, 0.0)))
    unnamed = 'GEOGCS["WGS 84"]'
    assert not Georeference(unnamed).is_same(Georeference(unnamed.replace("84", "72")))
    assert str(PLACE) == "EPSG:32632, offset 500000,5200000,400 (a test)"


def test_what_a_meta_holds_is_checked() -> None:
    assert georeference_of(placed().meta) == PLACE
    assert georeference_of({}) is None
    for held in ("EPSG:32632", {"crs": "EPSG:32632"}, {"crs": "x", "offset": [0, 0, 0]}):
        with pytest.raises(InputError, match=r"meta: georeference holds .*it must be an object"):
            georeference_of({"georeference": held})
    far = PLACE.to_dict() | {"offset": [0, float("inf"), 0]}
    with pytest.raises(InputError, match="three numbers"):
        georeference_of({"georeference": far})


def test_a_turned_map_lies_nowhere_and_says_so_if_asked() -> None:
    meta = placed(map_from_recording=TURN).meta
    assert map_georeference(meta) is None
    with pytest.raises(UsageError, match=r"`crs`: is EPSG:32632, but the map was turned"):
        map_georeference(meta, "EPSG:32632")
    with pytest.raises(UsageError, match=r"`crs`: is EPSG:32633, but the map says EPSG:32632"):
        map_georeference(placed().meta, "EPSG:32633")


def test_merged_maps_lie_in_one_place_or_are_refused() -> None:
    known = merge_maps(house(), placed())
    assert georeference_of(known.meta) == PLACE
    both = merge_maps(placed(), placed(Georeference(WKT, OFFSET)))
    assert georeference_of(both.meta) == PLACE
    with pytest.raises(UsageError, match=r"different places on Earth.*EPSG:32632.*EPSG:32633"):
        merge_maps(placed(), placed(PLACE._replace(crs="EPSG:32633")))


def test_rasterio_finds_the_map_on_earth_and_heights_above_the_datum(tmp_path: Path) -> None:
    rasterio = pytest.importorskip("rasterio")
    surface = placed()
    write_layers(tmp_path / "a.tif", surface, "geotiff")
    raster = layers_of(surface)
    places = [(x + OFFSET[0], y + OFFSET[1]) for y in raster.y for x in raster.x]
    added = [OFFSET[2] if name in ("ground", "top") else 0.0 for name in raster.layers]
    expected = np.array([layer.ravel() for layer in raster.layers.values()]).T + added
    with rasterio.open(tmp_path / "a.tif") as file:
        assert file.crs.to_epsg() == 32632
        np.testing.assert_array_equal(np.array(list(file.sample(places))), expected)
    write_layers(tmp_path / "b.tif", placed(map_from_recording=TURN), "geotiff")
    with rasterio.open(tmp_path / "b.tif") as file:
        assert file.crs is None
        assert file.bounds.left == raster.extent.min_x * surface.cell_size


def test_xarray_finds_the_system_and_the_places(tmp_path: Path) -> None:
    xarray, pyproj = pytest.importorskip("xarray"), pytest.importorskip("pyproj")
    surface = placed()
    write_layers(tmp_path / "a.nc", surface, "netcdf")
    raster = layers_of(surface)
    with xarray.open_dataset(tmp_path / "a.nc", engine="scipy") as data:
        assert pyproj.CRS.from_wkt(data["crs"].attrs["crs_wkt"]).to_epsg() == 32632
        assert data["top"].attrs["grid_mapping"] == "crs"
        np.testing.assert_array_equal(data["x"], raster.x + OFFSET[0])
        np.testing.assert_array_equal(data["top"], raster.layers["top"] + OFFSET[2])
        np.testing.assert_array_equal(data["clearance"], raster.layers["clearance"])


def test_laspy_finds_the_system_and_the_places(tmp_path: Path) -> None:
    pytest.importorskip("pyproj")
    write_cloud(tmp_path / "local.las", house())
    local = laspy.read(tmp_path / "local.las")
    assert local.header.parse_crs() is None
    write_cloud(tmp_path / "a.laz", placed())
    found = laspy.read(tmp_path / "a.laz")
    assert found.header.parse_crs().to_epsg() == 32632
    assert found.header.global_encoding.wkt
    np.testing.assert_allclose(found.xyz, local.xyz + OFFSET, atol=1e-3)
    # As recorded, points lie over their own cloud, which needs no offset to be where it is.
    for offset, code in ((OFFSET, None), ((0.0, 0.0, 0.0), 32632)):
        turned = placed(PLACE._replace(offset=offset), map_from_recording=TURN)
        write_cloud(tmp_path / "b.las", turned, as_recorded=True, overwrite=True)
        system = laspy.read(tmp_path / "b.las").header.parse_crs()
        assert (system and system.to_epsg()) == code
    write_cloud(tmp_path / "c.las", placed(map_from_recording=TURN))
    assert laspy.read(tmp_path / "c.las").header.parse_crs() is None
    with pytest.raises(UsageError, match="`crs`: pcd does not take it"):
        write_cloud(tmp_path / "a.pcd", house(), crs="EPSG:32632")
