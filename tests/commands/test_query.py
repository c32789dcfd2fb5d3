"""`mls query`, as a user runs it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mlscli.io.writing.npz import write_map
from mlscli.maps.free_space import FreeSpace
from mlscli.maps.surface_map import SurfaceMap
from tests.helpers.maps import CELL, Patch, map_of
from tests.helpers.program import mls

# Cells of 0.5: a floor, a closed deck above it, a wall beside them.
DECK = [
    Patch(2, -1, 0.0, 0.0, 0, 4),
    Patch(2, -1, 3.0, 0.0, 2, 0),
    Patch(3, -1, 2.5, 2.0, 0, 9),
]


def deck(folder: Path, *, free: bool, flown: bool = False) -> SurfaceMap:
    """Write a map; with free space from 0.25 to 2 under the deck, and a single line above it."""
    surface = map_of(DECK)
    if flown:
        surface = replace(surface, route=np.nan_to_num(surface.route))
    if free:
        voxels = [*range(1, 8), 20]
        surface = replace(
            surface,
            free=FreeSpace(
                np.array([2], dtype=np.int32),
                np.array([-1], dtype=np.int32),
                np.array([0, len(voxels)]),
                np.array(voxels, dtype=np.int32),
                np.array([3] * 7 + [1], dtype=np.uint8),
            ),
        )
    write_map(folder / "deck.npz", surface)
    return surface


def test_it_tells_levels_and_free_space_from_above(tmp_path: Path) -> None:
    deck(tmp_path, free=True)
    done = mls("query", "deck.npz", "--at", "1.2,-0.3,1", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert [line.split(maxsplit=1)[0] for line in done.stdout.splitlines()] == [
        "1.2,-0.3,1", "above", "3.000", "2.000", "0.250", "0.000", "below", "z",
    ]  # fmt: skip
    for words in (
        "(cell 2, -1)",
        "2.000 to 3.000  unknown",
        "0.250 to 2.000  free",
        "3.000           artificial\n",
        "measured, 4 points, sigma",
        "z 1             free, 1.000 above a level, 2.000 below one\n",
    ):
        assert words in done.stdout


@pytest.mark.parametrize(
    ("z", "space"), [(1.0, "free"), (0.1, "occupied"), (2.2, "never seen"), (5.1, "unknown")]
)
def test_it_tells_free_from_what_one_line_or_none_passed_through(
    tmp_path: Path, z: float, space: str
) -> None:
    deck(tmp_path, free=True)
    done = mls("query", "deck.npz", "--at", f"1.2,-0.3,{z}", "--json", cwd=tmp_path)
    assert json.loads(done.stdout)[0]["space"] == space


def test_the_json_holds_what_the_map_holds(tmp_path: Path) -> None:
    surface = deck(tmp_path, free=True)
    places = ["--at", "1.2,-0.3", "--at", "1.6,-0.3,1"]
    told = json.loads(mls("query", "deck.npz", *places, "--json", cwd=tmp_path).stdout)
    under, wall = told
    assert under["cell"] == [2, -1]
    assert under["free"] == [[CELL / 2, 2.0]]
    assert [level["origin"] for level in under["levels"]] == ["measured", "artificial"]
    assert under["levels"][0]["sigma"] == np.sqrt(surface.variance[0])
    assert [level["error"] for level in (*under["levels"], *wall["levels"])] == [
        None if np.isnan(variance) else pytest.approx(np.sqrt(variance))
        for variance in surface.height_variance
    ]
    assert under["levels"][1] == {
        "height": 3.0, "depth": 0.0, "origin": "artificial", "moved": False, "points": 0,
        "sigma": None, "error": None, "keyframes": None, "region": None,
    }  # fmt: skip
    assert "space" not in under
    assert (wall["space"], wall["free"]) == ("occupied", [])
    assert (wall["above_level"], wall["below_level"]) == (None, None)


@pytest.mark.parametrize(
    ("flown", "way"),
    [
        (True, "; build it with --free-space\n"),
        (False, "positions, or with --route, and --free-space\n"),
    ],
)
def test_without_free_space_all_between_levels_is_unknown(
    flown: bool, way: str, tmp_path: Path
) -> None:
    deck(tmp_path, free=False, flown=flown)
    done = mls("query", "deck.npz", "--at", "1.2,-0.3,1", "--at", "9,9", cwd=tmp_path)
    assert "0.000 to 3.000  unknown" in done.stdout
    assert "z 1             unknown, 1.000 above a level, 2.000 below one" in done.stdout
    assert "  nothing  no patch\n" in done.stdout
    assert done.stdout.endswith(way)


def test_where_nothing_is_known_it_says_so(tmp_path: Path) -> None:
    deck(tmp_path, free=True)
    done = mls("query", "deck.npz", "--at", "9,9", cwd=tmp_path)
    assert done.stdout == "9,9 (cell 18, 18)\n  nothing  no patch, and nothing seen through\n"


@pytest.mark.parametrize("place", ["1", "1,2,3,4", "1,a", "1,nan", ""])
def test_a_place_that_is_none_is_refused(tmp_path: Path, place: str) -> None:
    deck(tmp_path, free=False)
    done = mls("query", "deck.npz", "--at", place, cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr == (
        f"mls: --at {place}: expected two or three numbers, as in --at 1.5,-3 or --at 1.5,-3,2\n"
    )
