"""`mls merge`, as a user and a script run it.

Ways to pass without being right: the map of the first flight under a new name.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from mlscli.io.writing.npz import read_map, write_map
from mlscli.maps.merging import merge_maps
from tests.helpers.maps import Patch, map_of
from tests.helpers.program import mls

WEST = [Patch(x, 0, 0.25, 0.0, 0, 3) for x in range(4)]
EAST = [Patch(x, 0, 0.5, 0.0, 0, 1) for x in range(3, 6)]


def test_the_points_of_all_flights_are_in_the_map(tmp_path: Path) -> None:
    meta = {"sources": ["west.bag"], "points": {"read": 20, "dropped": {"median": 8}}, "batches": 2}
    more = {"sources": ["east.bag"], "points": {"read": 5, "dropped": {"range": 2}}, "batches": 1}
    one, other = replace(map_of(WEST), meta=meta), replace(map_of(EAST), meta=more)
    write_map(tmp_path / "west.npz", one)
    write_map(tmp_path / "east.npz", other)
    done = mls("merge", "west.npz", "east.npz", "east.npz", "-o", "all.npz", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    merged = read_map(tmp_path / "all.npz")
    assert merged == merge_maps(merge_maps(one, other), other)
    assert merged.count.tolist() == [3, 3, 3, 5, 2, 2]
    assert merged.height[3] == np.float64((3 * 0.25 + 2 * 0.5) / 5)
    assert merged.meta["sources"] == ["west.bag", "east.bag", "east.bag"]
    assert merged.meta["points"] == {"read": 30, "dropped": {"median": 8, "range": 4}}
    assert merged.meta["batches"] == 4
    assert done.stdout.splitlines()[:2] == ["all.npz", "  patches    6: 6 measured; 0 vertical"]


def test_what_cannot_be_merged_is_named(tmp_path: Path) -> None:
    write_map(tmp_path / "one.npz", map_of(WEST))
    write_map(tmp_path / "coarse.npz", map_of(WEST, cell_size=0.8))
    done = mls("merge", "one.npz", "coarse.npz", "-o", "all.npz", cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith("mls: one.npz, coarse.npz: ")
    assert "cell_size" in done.stderr
    assert mls("merge", "one.npz", "-o", "all.npz", cwd=tmp_path).returncode == 2
    same = mls("merge", "one.npz", "one.npz", "-o", "one.npz", "--overwrite", cwd=tmp_path)
    assert same.returncode == 1
    assert sorted(file.name for file in tmp_path.iterdir()) == ["coarse.npz", "one.npz"]


def test_free_space_that_one_map_lacks_is_said_to_be_left_out(tmp_path: Path) -> None:
    from mlscli.maps.free_space import FreeSpace

    write_map(tmp_path / "one.npz", replace(map_of(WEST), free=FreeSpace.of_none()))
    write_map(tmp_path / "other.npz", map_of(EAST))
    done = mls("merge", "one.npz", "other.npz", "-o", "all.npz", cwd=tmp_path)
    assert "free space  left out" in done.stdout
    told = mls("merge", "one.npz", "one.npz", "-o", "two.npz", "--json", cwd=tmp_path)
    assert json.loads(told.stdout)["free_space"]["voxels"] == 0
