"""`mls build --resume`: what a killed build has evaluated is not lost, and the map is the same.

How one could cheat: killed before anything was kept, or when all was done; options that are taken
and do nothing.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tests.helpers.killed import CALLS, MOMENT
from tests.helpers.program import mls

KILLED = "tests.helpers.killed:main"
BUILD = ("build", "flight.txt", "-c", "plain", "--set", "map.cell_size=0.5")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    rng = np.random.default_rng(5)
    np.savetxt(tmp_path / "flight.txt", rng.uniform((0, 0, 0), (90, 7, 0.2), (2000, 3)), fmt="%.5f")
    return tmp_path


def test_a_build_killed_at_any_moment_goes_on_to_the_same_map(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    build = (*BUILD, "--memory", "2G")
    assert mls(*build, "-o", "whole.npz", cwd=folder).returncode == 0
    expected = (folder / "whole.npz").read_bytes()
    keeping = (*build, "-o", "map.npz", "--checkpoint-every", "0s")
    monkeypatch.setenv(MOMENT, "0")
    whole = mls(*keeping, cwd=folder, main=KILLED)
    assert whole.returncode == 0, whole.stderr
    calls = int(whole.stdout.rpartition(CALLS)[2])
    (folder / "map.npz").unlink()
    goes_on = []
    for moment in np.linspace(1, calls, 4).astype(int):
        monkeypatch.setenv(MOMENT, str(moment))
        assert mls(*keeping, cwd=folder, main=KILLED).returncode == -9
        there = (folder / "map.npz").exists()
        resumed = mls(*build, "-o", "map.npz", "--resume", "--overwrite", cwd=folder)
        assert resumed.returncode == 0, resumed.stderr
        assert (folder / "map.npz").read_bytes() == expected
        assert {path.name for path in folder.iterdir()} == {"flight.txt", "whole.npz", "map.npz"}
        goes_on.append("tiles were evaluated before" in resumed.stderr)
        assert not there or moment == calls or goes_on[-1]
        (folder / "map.npz").unlink()
    assert sum(goes_on) >= 2


def test_what_an_interrupted_build_left_is_told_and_not_used(folder: Path) -> None:
    left = folder / "map.npz.checkpoint"
    left.mkdir()
    (left / "build.json").write_text("{}")
    kept = (*BUILD, "-o", "map.npz", "--jobs", "2")
    done = mls(*kept, cwd=folder)
    assert done.returncode == 0
    assert "map.npz.checkpoint: is of an interrupted build, and not used without --resume" in (
        done.stderr
    )
    (folder / "map.npz").unlink()
    refused = mls(*kept, "--checkpoint-every", "1m", cwd=folder)
    assert (refused.returncode, refused.stderr.count("\n")) == (2, 1)
    assert "add --resume to go on from it, or --overwrite to begin anew" in refused.stderr
    damaged = mls(*kept, "--resume", cwd=folder)
    assert (damaged.returncode, damaged.stderr.count("\n")) == (1, 1)
    assert "build.json: is damaged" in damaged.stderr
    anew = mls(*kept, "--checkpoint-every", "1m", "--overwrite", "--json", cwd=folder)
    assert json.loads(anew.stdout)["points"]["read"] == 2000
    assert not left.exists()


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (("--resume",), "--resume: needs a map that is evaluated tile by tile"),
        (("--checkpoint-every", "5m"), "--checkpoint-every: needs a map that is evaluated"),
        (("--jobs", "2", "--checkpoint-every", "soon"), "'soon' is no time; write 30s, 10m or 2h"),
    ],
)
def test_options_that_would_do_nothing_are_refused(
    folder: Path, options: tuple[str, ...], told: str
) -> None:
    done = mls(*BUILD, *options, cwd=folder)
    assert done.returncode == 2
    assert told in done.stderr
