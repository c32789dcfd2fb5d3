"""Where a map lies on Earth, from a recording's header to a file for a GIS, by the commands.

How one could cheat: to keep the system and to lose it on the way, so it is looked for in what each
command says and in the last file; to write a turned map as if it lay where it was recorded.
"""

from __future__ import annotations

from pathlib import Path

import laspy
import numpy as np
import pytest
from laspy.vlrs.vlr import VLR

from tests.helpers.program import mls
from tests.io.clouds.test_georeferences import keys

LINE = "EPSG:32632 (header of flight.las)"
GRID = ("--set", "map.cell_size=0.5", "--set", "map.gap_size=1.5", "-c", "plain")


@pytest.fixture
def flight(tmp_path: Path) -> Path:
    """Return a folder with a LAS file in UTM: a floor of 5 by 5 metres at 400 m."""
    header = laspy.LasHeader(point_format=3, version="1.2")
    header.scales, header.offsets = np.full(3, 0.001), np.array([500_000.0, 5_200_000.0, 400.0])
    header.vlrs.append(VLR("LASF_Projection", keys(3072, 32632)[0], "", keys(3072, 32632)[1]))
    cloud = laspy.LasData(header)
    cloud.X, cloud.Y = (np.arange(2500) % 50) * 100, (np.arange(2500) // 50) * 100
    cloud.Z = np.zeros(2500)
    cloud.write(tmp_path / "flight.las")
    return tmp_path


def test_a_map_knows_where_its_recording_lies_and_takes_it_to_its_files(flight: Path) -> None:
    assert LINE in mls("info", "flight.las", cwd=flight).stdout
    built = mls("build", "flight.las", *GRID, cwd=flight)
    assert (built.returncode, LINE in built.stdout) == (0, True)
    rasterio = pytest.importorskip("rasterio")
    done = mls("export", "flight.npz", "-o", "a.tif", cwd=flight)
    assert "; EPSG:32632 (header of flight.las)" in done.stdout
    assert done.stderr == ""
    with rasterio.open(flight / "a.tif") as file:
        assert file.crs.to_epsg() == 32632
        assert file.bounds.left == 500_000


def test_a_turned_map_is_not_placed_and_what_is_given_goes_first(flight: Path) -> None:
    built = mls("build", "flight.las", "--up", "x", "-o", "up.npz", *GRID, cwd=flight)
    assert f"{LINE}; of the recording, from which the map was turned" in built.stdout
    pytest.importorskip("pyproj")
    pytest.importorskip("rasterio")
    done = mls("export", "up.npz", "-o", "up.tif", cwd=flight)
    assert "names no reference system: the map was turned out of EPSG:32632" in done.stderr
    recorded = mls("export", "up.npz", "-o", "r.las", "--as-recorded", cwd=flight)
    assert recorded.stderr == ""
    found = laspy.read(flight / "r.las")
    assert found.header.parse_crs().to_epsg() == 32632
    assert found.x.min() > 499_990
    given = ("--crs", "EPSG:2056", "--crs-offset", "10,20,30")
    other = mls("build", "flight.las", *given, "-o", "other.npz", *GRID, cwd=flight)
    assert "EPSG:2056, offset 10,20,30 (as given)" in other.stdout
