"""`mls explore`, as a user runs it.

How one could cheat: to write a way that no program reads, so `mls synth` flies it; to round places
in tables; to be silent that the map does not know what was looked into.
"""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mlscli.io.writing.npz import write_map
from mlscli.queries.exploration import Camera
from mlscli.queries.explore import explore
from tests.helpers.program import mls
from tests.queries.test_explore import yard


def test_views_are_told_and_their_way_is_flown_by_synth(tmp_path: Path) -> None:
    write_map(tmp_path / "yard.npz", yard())
    found = explore(yard(), 0.5, 0.5, Camera(90.0, 8.0), most=4)
    asked = ("explore", "yard.npz", "--craft", "0.5,0.5", "--field-of-view", "90", "--range", "8")
    done = mls(*asked, "--views", "4", "-o", "yard.csv", "-o", "way.tum", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    lines = done.stdout.splitlines()
    assert lines[0].startswith("yard.npz: 168 uncertain cells in ")
    assert lines[1] == "  cells   20 artificial, 12 hole, 40 unseen, 96 edge"
    assert lines[2] == "  camera  90 degrees, sees 8.000 far"
    assert lines[4].split()[:6] == ["view", "at", "yaw", "tilt", "across", "above"]
    assert len(lines) == 9
    more = ("-o", "views.plan", "-o", "views.mcap", "-o", "views.html", "--origin", "47,8,400")
    told = json.loads(mls(*asked, "--views", "4", "--json", *more, cwd=tmp_path).stdout)
    for ending in ("plan", "mcap", "html"):
        assert (tmp_path / f"views.{ending}").stat().st_size > 1000
    assert told["free_space"] is True
    assert len(told["views"]) == 4
    with (tmp_path / "yard.csv").open(newline="") as file:
        table = list(csv.DictReader(file))
    for row, other, view in zip(told["views"], table, found.views, strict=True):
        for axis, value in zip("xyz", view.place, strict=True):
            assert row[axis] == float(other[axis]) == value
        assert (row["yaw"], row["tilt"]) == (view.yaw, view.tilt)
        assert float(other["unseen_cells"]) == row["unseen_cells"] == view.sees[2]
        assert other["kind"] == row["kind"]
    assert told["length"] == found.length

    (tmp_path / "scene.yaml").write_text("- horizontal: {position: [0, 0, 0], size: [12, 12]}\n")
    flown = ("--grid", "1", "--all-points", "--anew", "--route", "way.tum", "-o", "flight.txt")
    done = mls("synth", "--scene", "scene.yaml", *flown, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    header, *rows = (tmp_path / "flight.txt").read_text().splitlines()
    assert header == "x y z keyframe t cx cy cz"
    passed = np.array([list(map(float, row.split()[3:])) for row in rows])
    first = np.unique(passed[:, 0], return_index=True)[1]
    assert np.array_equal(passed[first, 2:], found.way()[0])


def test_what_it_does_not_know_is_said(tmp_path: Path) -> None:
    write_map(tmp_path / "yard.npz", replace(yard(), free=None))
    done = mls("explore", "yard.npz", "--craft", "0.5,0.5", cwd=tmp_path)
    assert done.returncode == 0
    assert done.stdout.endswith(
        "space that nobody looked into is not among it: the map does not say what was seen "
        "through; build it with --free-space\n"
    )
    assert " unseen" not in done.stdout


@pytest.mark.parametrize(
    ("words", "fault"),
    [
        (("--craft", "0.5,0.5", "-o", "views.pdf"), "views.pdf: does not end in .csv, .tum, "),
        (("--craft", "0.5,0.5", "-o", "views.plan"), "views.plan: a plan is in degrees, and the "),
        (("--craft", "0.5,0.5", "--crs", "EPSG:32632"), "--origin and --crs: are for a plan; "),
        (("--craft", "0.5,0.5", "--range", "-1"), "--range -1: expected more than a cell, 0.5"),
    ],
)
def test_what_is_wrong_is_said_in_a_line(
    words: tuple[str, ...], fault: str, tmp_path: Path
) -> None:
    write_map(tmp_path / "yard.npz", yard())
    done = mls("explore", "yard.npz", *words, cwd=tmp_path)
    assert done.returncode != 0
    assert done.stderr.startswith(f"mls: {fault}")
    assert done.stderr.count("\n") == 1


def test_a_map_that_knows_where_it_lies_needs_no_origin_for_a_plan(tmp_path: Path) -> None:
    pytest.importorskip("pyproj")
    place = {"crs": "EPSG:32632", "offset": [500_000, 5_200_000, 400], "source": "a test"}
    write_map(tmp_path / "yard.npz", replace(yard(), meta={"georeference": place}))
    done = mls("explore", "yard.npz", "--craft", "0.5,0.5", "-o", "a.plan", cwd=tmp_path)
    assert "EPSG:32632, offset 500000,5200000,400 (a test), are taken for altitudes" in done.stderr
    home = json.loads((tmp_path / "a.plan").read_text())["mission"]["plannedHomePosition"]
    assert home[:2] == pytest.approx([46.95, 9.0], abs=0.01)
    assert 400 < home[2] < 450
