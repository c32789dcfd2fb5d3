"""Maps for map_server, held to the rule that it documents, pixel by pixel.

How one could cheat: to flip an axis or shift the origin by a cell, so scenes have no symmetry and
each pixel is looked up by its place; to write unknown as a shade that is free by other thresholds.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mlscli.errors import OutputError, UsageError
from mlscli.io.writing.nav2 import PIXELS, write_nav2
from mlscli.maps.space import FREE, OCCUPIED, UNKNOWN
from mlscli.rasters.flying import at_height
from mlscli.rasters.robot import Robot
from mlscli.rasters.storeys import storeys_of
from tests.helpers.maps import Patch, map_of
from tests.helpers.meshes import house
from tests.helpers.occupancy import served
from tests.rasters.test_flying import with_random_free


def test_map_server_finds_every_storey_as_the_map_has_it(tmp_path: Path) -> None:
    surface = house()
    robot = Robot(slope=40, headroom=1.0)
    found = storeys_of(surface, robot)
    sheets, left_out = write_nav2(tmp_path / "a house.yaml", surface, robot)
    assert (len(sheets), left_out) == (len(found.storeys), found.left_out)
    assert len(sheets) >= 1
    for number, (sheet, storey) in enumerate(zip(sheets, found.storeys, strict=True), 1):
        assert sheet.file == tmp_path / f"a house.{number}.yaml"
        states, told = served(sheet.file)
        assert told["resolution"] == surface.cell_size
        extent = found.extent
        for (x, y), state in states.items():
            assert state == storey.space[y - extent.min_y, x - extent.min_x]
        assert len(states) == storey.space.size
        counted = [
            int(np.count_nonzero(storey.space == each)) for each in (FREE, OCCUPIED, UNKNOWN)
        ]
        assert [sheet.free, sheet.occupied, sheet.unknown] == counted
        assert min(counted) > 0


def test_map_server_finds_what_is_known_at_a_flying_height(tmp_path: Path) -> None:
    surface = with_random_free(house(), np.random.default_rng(1))
    flight = at_height(surface, 0.6, Robot(headroom=0.3), 1)
    write_nav2(tmp_path / "fly.yml", surface, Robot(headroom=0.3), flying_height=0.6, least=1)
    states, _ = served(tmp_path / "fly.yml")
    assert set(states.values()) == {FREE, OCCUPIED, UNKNOWN}
    for (x, y), state in states.items():
        assert state == flight.space[y - flight.extent.min_y, x - flight.extent.min_x]


def test_unknown_is_neither_by_the_thresholds_of_ros_1_nor_by_those_of_ros_2() -> None:
    for free_below, occupied_above in ((0.196, 0.65), (0.25, 0.65), (0.25, 0.55)):
        p = {state: (255 - pixel) / 255 for state, pixel in PIXELS.items()}
        assert p[FREE] < free_below <= p[UNKNOWN] <= occupied_above < p[OCCUPIED]


def test_small_cells_are_numbers_in_the_file_too(tmp_path: Path) -> None:
    surface = map_of([Patch(-3, 2, 0.0, 0.0, 0, 1)], cell_size=1e-5, gap_size=1e-4)
    write_nav2(tmp_path / "a.yaml", surface)
    assert served(tmp_path / "a.1.yaml")[0] == {(-3, 2): FREE}


def test_files_appear_all_or_not_at_all(tmp_path: Path) -> None:
    patches = [Patch(x, y, 3.0 * (x > 4), 0.0, 0, 1) for x in range(10) for y in range(9)]
    surface = map_of(patches)
    (tmp_path / "a.2.pgm").write_bytes(b"mine")
    with pytest.raises(OutputError, match=r"a\.2\.pgm: exists already"):
        write_nav2(tmp_path / "a.yaml", surface)
    assert [file.name for file in tmp_path.iterdir()] == ["a.2.pgm"]
    write_nav2(tmp_path / "a.yaml", surface, overwrite=True)
    assert len(list(tmp_path.iterdir())) == 4
    before = {file: file.read_bytes() for file in tmp_path.iterdir()}
    # With fewer storeys the second pair would stay, and be taken for one of this map.
    with pytest.raises(OutputError, match=r"a\.2\.yaml: is of an earlier export.*1 storey"):
        write_nav2(tmp_path / "a.yaml", surface.take(surface.ix < 5), overwrite=True)
    assert {file: file.read_bytes() for file in tmp_path.iterdir()} == before


def test_names_and_maps_that_cannot_be_are_refused(tmp_path: Path) -> None:
    surface = map_of([Patch(0, 0, 0.0, 0.0, 0, 1)])
    with pytest.raises(OutputError, match=r"end the name so"):
        write_nav2(tmp_path / "a.pgm", surface)
    with pytest.raises(OutputError, match="cannot name its image"):
        write_nav2(tmp_path / "a\udcff.yaml", surface)
    low = [Patch(0, 0, 0.0, 0.0, 0, 1), Patch(0, 0, 1.0, 0.0, 0, 1)]
    roofed = replace(map_of(low), origin=np.array([0, 0], dtype=np.uint8))
    top = map_of([Patch(0, 0, 0.0, 0.0, 2, 0)])
    assert write_nav2(tmp_path / "r.yaml", roofed, Robot(headroom=5.0)).sheets[0].free == 1
    assert write_nav2(tmp_path / "t.yaml", top).sheets[0].unknown == 1
    with pytest.raises(UsageError, match="empty"):
        write_nav2(tmp_path / "e.yaml", map_of([]))
    assert not (tmp_path / "e.1.yaml").exists()
