"""`mls clearance`, as a user runs it.

How one could cheat: to exit with 0 whatever is found; to say `fits` of a map that does not know
what was seen; to tell the first place for the narrowest; to read a path in the order of its lines,
not of its times; to fly the route through places that are not known.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mlscli.io.writing.npz import write_map
from mlscli.maps.surface_map import SurfaceMap
from tests.helpers.lines import free_space_of
from tests.helpers.maps import CELL, Patch, map_of
from tests.helpers.program import mls

OPEN, UNDER, FAR = "-3,0,1.5,-1,0,1.5", "-3,0,1.5,3,0,1.5", "-3,0,1.5,6,0,1.5"


def deck(folder: Path, *, free: bool = True, route: Any = None) -> SurfaceMap:
    """Write a map: a floor, and from x = 0 to 2 a deck at 3; seen through but beyond x = 4."""
    patches = [Patch(ix, iy, 0.0, 0.0, 0, 4) for ix in range(-10, 16) for iy in range(-5, 5)]
    patches += [Patch(ix, iy, 3.0, 0.0, 0, 4) for ix in range(4) for iy in range(-5, 5)]
    surface = map_of(patches)
    if free:
        lines = {
            (ix, iy, iz): 2
            for ix in range(-10, 8)
            for iy in range(-5, 5)
            for iz in range(1, 20)
            if not (0 <= ix < 4 and iz > 11)
        }
        surface = replace(surface, free=free_space_of(lines))
    if route is not None:
        surface = replace(surface, route=np.array(route))
    write_map(folder / "deck.npz", surface)
    return surface


@pytest.mark.parametrize(
    ("craft", "line", "status", "verdict"),
    [
        ("1,1", UNDER, 0, "fits"),
        ("1,4", UNDER, 1, "does not fit"),
        ("1,1", FAR, 4, "never seen"),
        ("1,2.9", UNDER, 4, "doubtful"),
    ],
)
def test_the_status_says_what_is_found(
    craft: str, line: str, status: int, verdict: str, tmp_path: Path
) -> None:
    deck(tmp_path)
    done = mls("clearance", "deck.npz", "--craft", craft, "--line", line, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (status, "")
    assert done.stdout.startswith(f"deck.npz: {verdict}\n")
    told = mls("clearance", "deck.npz", "--craft", craft, "--line", line, "--json", cwd=tmp_path)
    assert told.returncode == status
    assert json.loads(told.stdout)["verdict"] == verdict


def test_it_tells_places_and_the_room_where_it_is_narrowest(tmp_path: Path) -> None:
    surface = deck(tmp_path)
    done = mls(
        "clearance", "deck.npz", "--craft", "1,1", "--line", "-3,0,1.6,6,0,1.6", cwd=tmp_path
    )
    for words in (
        "way             9.000 long: 6.500 fits, 2.500 never seen",
        "0.000 to 6.500  fits, from -3.000,0.000,1.600 to 3.500,0.000,1.600",
        "of what is measured, 4 points",
        "up            0.900, at least 0.",
        "down          1.100, at least 0.",
    ):
        assert words in done.stdout
    told = json.loads(
        mls("clearance", "deck.npz", "--craft", "1,1", "--line", "-3,0,1.6,6,0,1.6", "--json",
            cwd=tmp_path).stdout
    )  # fmt: skip
    narrow = told["narrowest"]
    off = 2 * surface.height_variance[0] ** 0.5
    assert narrow["distance"] == pytest.approx(0.9 - off)
    assert 0 <= narrow["cell"][0] < 4
    assert -0.75 <= narrow["at"][0] <= 2.75
    assert [each["verdict"] for each in told["stretches"]] == ["fits", "never seen"]
    assert told["stretches"][1]["to"] == [6.0, 0.0, 1.6]


def test_one_place_is_where_a_craft_hovers(tmp_path: Path) -> None:
    deck(tmp_path)
    done = mls("clearance", "deck.npz", "--craft", "1,1", "--line", "1,0,1.5", cwd=tmp_path)
    assert done.returncode == 0
    assert "  way             one place\n" in done.stdout


def test_a_map_without_free_space_never_fits_and_says_why(tmp_path: Path) -> None:
    deck(tmp_path, free=False)
    done = mls("clearance", "deck.npz", "--craft", "1,1", "--line", OPEN, cwd=tmp_path)
    assert done.returncode == 4
    assert "deck.npz: never seen\n" in done.stdout
    assert "with positions, or with --route, and --free-space" in done.stdout


@pytest.mark.parametrize(("craft", "thin"), [("0.9,1", True), ("1,0.9", True), ("1,1", False)])
def test_a_craft_thinner_than_two_cells_is_told_what_it_could_miss(
    craft: str, thin: bool, tmp_path: Path
) -> None:
    deck(tmp_path)
    asked = "clearance", "deck.npz", "--craft", craft, "--line", OPEN
    assert ("thinner than two cells, 1: " in mls(*asked, cwd=tmp_path).stdout) == thin
    assert json.loads(mls(*asked, "--json", cwd=tmp_path).stdout)["thin"] == thin


def test_the_route_is_flown_where_it_is_known(tmp_path: Path) -> None:
    route = [[0.0, -3, 0, 1.5], [1, np.nan, np.nan, np.nan], [2, 1, 0, 1.5], [3, 3, 0, 1.5]]
    deck(tmp_path, route=[*route, *[[4 + n, np.nan, np.nan, np.nan] for n in range(3)]])
    done = mls("clearance", "deck.npz", "--craft", "1,1", "--along", "route", cwd=tmp_path)
    assert done.returncode == 0
    assert "6.000 long: 6.000 fits" in done.stdout
    # The route of `map_of` is not known.
    (tmp_path / "deck.npz").unlink()
    deck(tmp_path)
    done = mls("clearance", "deck.npz", "--craft", "1,1", "--along", "route", cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr == "mls: --along route: deck.npz does not say where the craft was\n"


@pytest.mark.parametrize("name", ["tum", "csv"])
def test_a_path_is_flown_in_the_order_of_its_times(name: str, tmp_path: Path) -> None:
    deck(tmp_path)
    text = {
        "tum": "1 -3 0 1.5 0 0 0 1\n3 3 0 1.5 0 0 0 1\n2 0 0 1.5 0 0 0 1\n",
        "csv": "t,x,y,z\n1,-3,0,1.5\n3,3,0,1.5\n2,0,0,1.5\n",
    }[name]
    (tmp_path / f"way.{name}").write_text(text)
    done = mls("clearance", "deck.npz", "--craft", "1,1", "--path", f"way.{name}", cwd=tmp_path)
    assert (done.returncode, "6.000 long: 6.000 fits" in done.stdout) == (0, True)


@pytest.mark.parametrize(
    ("options", "fault"),
    [
        ((), "no way; give one of --along route, --line and --path"),
        (
            ("--along", "route", "--line", OPEN),
            "--along and --line: do not go together; choose one of --along route, --line and",
        ),
        (("--line", "1,2"), "--line 1,2: expected x,y,z of each place, as in --line 0,-3,1,0,3,1"),
        (("--line", "1,2,nan"), "--line 1,2,nan: expected x,y,z of each place"),
        (("--path", "none.txt"), "none.txt: cannot be read: No such file or directory"),
    ],
)
def test_wrong_ways_are_refused(options: tuple[str, ...], fault: str, tmp_path: Path) -> None:
    deck(tmp_path)
    done = mls("clearance", "deck.npz", "--craft", "1,1", *options, cwd=tmp_path)
    assert done.returncode in (1, 2)
    assert done.stderr.startswith(f"mls: {fault}")
    assert done.stdout == ""


def test_wrong_crafts_are_refused(tmp_path: Path) -> None:
    deck(tmp_path)
    for craft, fault in (("0,1", "width: is 0"), ("1,nan", "height: is nan"), ("1", "'1' is not")):
        done = mls("clearance", "deck.npz", "--craft", craft, "--line", OPEN, cwd=tmp_path)
        assert done.returncode == 2
        assert fault in done.stderr


def test_the_way_is_written_only_where_nothing_is_lost(tmp_path: Path) -> None:
    deck(tmp_path)
    given = ("clearance", "deck.npz", "--craft", "1,1", "--line", UNDER, "--mcap", "way.mcap",
             "--html", "way.html")  # fmt: skip
    assert mls(*given, cwd=tmp_path).returncode == 0
    assert (tmp_path / "way.mcap").stat().st_size > 0
    assert '"name": "clearance"' in (tmp_path / "way.html").read_text()
    done = mls(*given, cwd=tmp_path)
    assert done.returncode == 1
    assert "way.mcap" in done.stderr
    assert mls(*given, "--overwrite", cwd=tmp_path).returncode == 0
    assert CELL == 0.5


def test_what_is_told_of_a_path_begins_with_the_name_of_the_program(tmp_path: Path) -> None:
    deck(tmp_path)
    lines = [f"{1403636580 * 10**9 + n * 10**8} {n - 3} 0 1.5 0 0 0 1\n" for n in range(5)]
    (tmp_path / "path.txt").write_text("".join(lines))
    words = ("--craft", "1,1", "--path", "path.txt")
    done = mls("clearance", "deck.npz", *words, cwd=tmp_path)
    assert done.returncode == 0
    assert done.stderr == "mls: path.txt: the time stamps are taken as nanoseconds\n"
