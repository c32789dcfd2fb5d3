"""`mls align`, as a user and a script run it, up to the map of both flights.

Ways to pass without being right: a transform that a build takes and that leads elsewhere, so the
recording is built with it and compared; a refusal that leaves a file behind.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from mlscli.geometry.similarity import Similarity
from mlscli.io.writing.npz import read_map, write_map
from mlscli.maps.grid import LENGTHS
from mlscli.maps.merging import merge_maps
from mlscli.maps.surface_map import SurfaceMap
from tests.helpers.maps import Patch, map_of
from tests.helpers.program import mls
from tests.helpers.yards import CELL, cloud, map_of_points, off

MOVED = Similarity(-2.5, 2.0, (40.0, 7.0, -3.0))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a map, the recording of a second flight, and its map."""
    folder = tmp_path_factory.mktemp("align")
    write_map(folder / "a.npz", map_of_points(cloud(1)))
    points = MOVED.points(cloud(2, (1, 12)))
    np.savetxt(folder / "b.txt", points)
    write_map(folder / "b.npz", map_of_points(points, 0.9))
    return folder


def grid_of(surface: SurfaceMap) -> list[str]:
    return [word for n in LENGTHS for word in ("--set", f"map.{n}={getattr(surface, n)!r}")]


def test_a_second_flight_is_aligned_rebuilt_and_merged(folder: Path) -> None:
    outputs = "-o", "onto.json", "-o", "moved.npz"
    done = mls("align", "a.npz", "b.npz", "--scale", 0.5, *outputs, cwd=folder)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("b.npz onto a.npz\n")
    grid = grid_of(read_map(folder / "a.npz"))
    assert " ".join(["--transform FILE.json", *grid]) in done.stdout
    told = json.loads((folder / "onto.json").read_text())
    fit = Similarity.of(np.array(told["transform"]))
    assert fit is not None
    assert off(fit, MOVED.inverse, MOVED.points(cloud(2))) < CELL / 2
    built = mls(
        *("build", "b.txt", "-c", "plain", "--transform", "onto.json", *grid, "-o", "c.npz"),
        cwd=folder,
    )
    assert built.returncode == 0, built.stderr
    first, rebuilt, moved = (read_map(folder / f"{name}.npz") for name in ("a", "c", "moved"))
    assert rebuilt.count.sum() == moved.count.sum() == len(cloud(2, (1, 12)))
    for other in (rebuilt, moved):
        # The same floor and walls: little but the rim is new.
        assert merge_maps(first, other).size < 1.25 * first.size


def test_what_does_not_fit_writes_nothing(folder: Path) -> None:
    flat = [Patch(x, y, 0.0, 0.0, 0, 4) for x in range(12) for y in range(12)]
    write_map(folder / "flat.npz", map_of(flat))
    done = mls("align", "flat.npz", "flat.npz", "--no-scale", "-o", "no.json", cwd=folder)
    assert done.returncode == 1
    assert done.stdout == ""
    (line,) = done.stderr.splitlines()
    assert line.startswith("mls: flat.npz onto flat.npz: ")
    assert not (folder / "no.json").exists()


@pytest.mark.parametrize(
    ("options", "fault"),
    [
        (["-o", "out.txt"], "-o out.txt: one .json"),
        (["-o", "x.json", "-o", "y.json"], "-o x.json: one .json"),
        (["--scale", "2", "--no-scale"], "--no-scale: does not go with --scale"),
    ],
)
def test_options_that_make_no_sense_are_refused(
    folder: Path, options: list[str], fault: str
) -> None:
    done = mls("align", "a.npz", "b.npz", *options, cwd=folder)
    assert done.returncode == 2
    assert fault in done.stderr
