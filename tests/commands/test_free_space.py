"""Free space as a user asks for it: `mls build --free-space`, and what `mls info` says of it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from mlscli.io.writing.npz import read_map
from tests.helpers.program import mls

POINTS = [(x / 4 + 0.1, y / 4 + 0.1, 0.05) for x in range(12) for y in range(12)]


@pytest.fixture
def flight(tmp_path: Path) -> Path:
    """Return a cloud of a floor seen from two places."""
    rows = [(*point, n, 0.3 + 2 * n, 1.4, 4.0) for n in range(2) for point in POINTS]
    path = tmp_path / "flight.txt"
    path.write_text("\n".join(" ".join(map(str, row)) for row in rows))
    return path


def built(flight: Path, name: str, *options: str) -> str:
    done = mls(
        "build", flight.name, "--columns", "x,y,z,keyframe,cx,cy,cz", "-o", name,
        "--set", "map.cell_size=0.5", *options, cwd=flight.parent,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_it_is_kept_if_asked_for_and_told(flight: Path) -> None:
    told = built(flight, "map.npz", "--free-space")
    free = read_map(flight.with_name("map.npz")).free
    assert free is not None
    assert free.size > 100
    assert f"in {free.size:,} voxels seen through, " in told
    built(flight, "large.npz", "--set", "map.free_space=true", "--memory", "2G")
    assert read_map(flight.with_name("large.npz")) == read_map(flight.with_name("map.npz"))
    assert "free space" not in built(flight, "without.npz")
    assert read_map(flight.with_name("without.npz")).free is None

    said = mls("info", "map.npz", "without.npz", cwd=flight.parent).stdout
    assert said.count("voxels seen through") == 1
    with_it, without = json.loads(
        mls("info", "map.npz", "without.npz", "--json", cwd=flight.parent).stdout
    )
    assert with_it["free_space"] == {
        "voxels": free.size,
        "twice": int((free.lines > 1).sum()),
        "volume": pytest.approx(free.size * 0.5 * 0.5 * 0.25),
    }
    assert without["free_space"] is None


def test_a_dry_run_foresees_it(flight: Path) -> None:
    foreseen = built(flight, "map.npz", "--free-space", "--dry-run")
    built(flight, "map.npz", "--free-space")
    free = read_map(flight.with_name("map.npz")).free
    assert free is not None
    assert f"free space  {free.size:,} voxels seen through\n" in foreseen
    assert "free space" not in built(flight, "without.npz", "--dry-run")


@pytest.mark.parametrize("option", [(), ("--dry-run",)])
def test_without_positions_it_is_an_error_of_one_line_and_no_map(
    option: tuple[str, ...], tmp_path: Path
) -> None:
    (tmp_path / "cloud.txt").write_text("\n".join(" ".join(map(str, p)) for p in POINTS))
    size = "--set", "map.cell_size=0.5"
    done = mls("build", "cloud.txt", "--free-space", *size, *option, cwd=tmp_path)
    assert done.returncode == 1
    assert done.stderr.startswith("mls: cloud.txt: --free-space: where the craft was is not known")
    assert done.stderr.count("\n") == 1
    assert not (tmp_path / "cloud.npz").exists()
