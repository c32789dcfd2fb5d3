"""`mls build --dry-run`, as a user runs it.

How one could cheat: a run that writes, and clears up; one that says less where the build would
fail; numbers shown as exact that are extrapolated.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from mlscli.building.depth_noise import auto_noise
from mlscli.io.reading.recording import open_recording
from mlscli.io.writing.flight_text import write_text
from mlscli.scenes.flight import fly
from mlscli.scenes.noise import Noise
from mlscli.scenes.presets import make
from mlscli.scenes.surfaces import Scatter
from tests.helpers.bags import Sent, write_bag
from tests.helpers.program import mls

FLOOR = np.array([(0.1 * x, 0.1 * y, 0.01 * ((x + y) % 2)) for x in range(20) for y in range(20)])


def test_it_says_what_the_build_then_does_and_writes_nothing(tmp_path: Path) -> None:
    write_bag(tmp_path / "flight.bag", [Sent(FLOOR, frame_id="odom")] * 3, topics=("/a", "/b"))
    arguments = ("build", "flight.bag", "--topic", "/b", "--up", "-y", "--json")
    foreseen = mls(*arguments, "--dry-run", cwd=tmp_path)
    assert foreseen.returncode == 0, foreseen.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["flight.bag"]
    told, done = json.loads(foreseen.stdout), json.loads(mls(*arguments, cwd=tmp_path).stdout)
    assert told["clouds"] == ["flight.bag: /b"]
    assert told["up"] == "-y"
    assert told["whole"]
    sizes = "cell_size", "gap_size", "sizes"
    for key in ("map", "mode", "keyframes", "batches", *sizes, "frame_id"):
        assert told[key] == done[key], key
    assert told["patches"] == done["patches"]["total"]
    assert told["points"] == done["points"]["read"]
    given = (*arguments, "--set", "map.cell_size=0.3", "-o", "given.npz")
    told_of_gap, done_with_gap = (
        json.loads(mls(*given, *more, cwd=tmp_path).stdout) for more in (("--dry-run",), ())
    )
    assert told_of_gap["sizes"] == done_with_gap["sizes"]
    assert told_of_gap["gap_size"] == done_with_gap["gap_size"]
    assert list(told_of_gap["sizes"]) == ["gap_size"]
    assert told["read"]["dropped"] == done["points"]["dropped"]


def test_what_is_extrapolated_is_about(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    rows = np.c_[rng.uniform(0, 50, (300_000, 2)), np.zeros(300_000), np.arange(300_000) // 1000]
    np.savetxt(tmp_path / "long.txt", rows, fmt="%.3f %.3f %.0f %.0f")
    told = mls("build", "long.txt", "--dry-run", "--set", "map.cell_size=0.5", cwd=tmp_path).stdout
    rows_told = dict(line.strip().split("  ", 1) for line in told.splitlines()[1:])
    # The count of keyframes is known, and so is what was asked for.
    assert rows_told["keyframes"].split()[0] == "300"
    assert rows_told["points"].strip().startswith("about 300,000")
    assert rows_told["patches"].strip().startswith("about ")
    assert rows_told["cell size"].strip() == "0.5"
    assert rows_told["gap size"].strip().startswith("about 0.25 (auto: half a cell, as only")
    assert rows_told["judged by"].startswith("the first ")


def test_it_tells_the_noise_that_the_build_would_find(tmp_path: Path) -> None:
    flown = fly(make("house"), 0.15, Noise("slam", Scatter(0.0, 0.05)), seed=3)
    write_text(tmp_path / "flight.txt", flown.keyframes)
    told = mls("build", "flight.txt", "--dry-run", cwd=tmp_path).stdout
    noise = auto_noise(open_recording(tmp_path / "flight.txt"))
    assert noise > 0
    assert f"  noise      auto: a depth errs by {noise:g} times its square\n" in told


def test_it_fails_as_the_build_would(tmp_path: Path) -> None:
    write_bag(tmp_path / "lidar.bag", [Sent(FLOOR, frame_id="os_sensor")])
    write_bag(tmp_path / "two.bag", [Sent(FLOOR)], topics=("/a", "/b"))
    (tmp_path / "there.npz").write_text("precious")
    (tmp_path / "nan.txt").write_text("nan 1 2\n")
    before = sorted(path.name for path in tmp_path.iterdir())
    for arguments in (
        ("lidar.bag",),
        ("two.bag",),
        ("nan.txt",),
        ("nosuch.bag",),
        ("two.bag", "--topic", "/a", "-o", "there.npz"),
        ("two.bag", "--topic", "/a", "--set", "plastr.max_gap=1"),
    ):
        foreseen = mls("build", *arguments, "--dry-run", cwd=tmp_path)
        done = mls("build", *arguments, cwd=tmp_path)
        assert foreseen.returncode == done.returncode != 0
        assert foreseen.stderr == done.stderr
        assert foreseen.stdout == ""
    assert sorted(path.name for path in tmp_path.iterdir()) == before


def test_losses_known_at_once_are_told_with_status_3(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "flight", [Sent(FLOOR)] * 3, "ros2")
    metadata = bag / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace("message_count: 3", "message_count: 5"))
    done = mls("build", "flight", "--dry-run", cwd=tmp_path)
    assert done.returncode == 3
    assert "lost: 2 messages" in done.stderr
