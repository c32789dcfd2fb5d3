"""Maps of clouds larger than memory: the same files, and nothing left behind.

How one could cheat: so much memory that everything fits; one tile, one strip, one run of points;
an empty folder looked at where nothing was ever put. How much memory it really takes is measured
by benchmarks/large.py.
"""

from __future__ import annotations

import resource
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import mlscli
from mlscli.building import gap_size, large
from mlscli.building.build import build
from mlscli.building.large import build_large
from mlscli.errors import InputError, OutputError, UsageError
from mlscli.io.reading.recording import open_recording
from mlscli.io.writing.npz import read_map, write_map
from mlscli.keyframes.batches import Points
from mlscli.maps.summary import describe
from mlscli.pipeline.parameters import Parameters
from mlscli.pipeline.tilewise import tiles as tilewise
from mlscli.pipeline.tilewise.blocks import PointBlocks
from tests.helpers.bags import Sent, write_bag

SAMPLE = Path(__file__).resolve().parents[2] / "data/samples/bridge.txt"
REGIONS = "pipeline: [median, walls, plaster, {regions: {min_size: 3, snap: true}}, pyramids]"


def parameters(*sets: str, config: Path | None = None) -> Parameters:
    return mlscli.load_parameters(config and str(config), ["map.cell_size=0.5", *sets])


@pytest.fixture
def little(monkeypatch: pytest.MonkeyPatch) -> int:
    """Return a memory that has room for few points, and for few patches at a time."""
    monkeypatch.setattr(large, "SORTED", large.LEAST_BYTES // 800)
    monkeypatch.setattr(large, "ORDERED", large.LEAST_BYTES // 100)
    monkeypatch.setattr(large, "COMFORTABLE_POINTS", 1500)
    monkeypatch.setattr(large, "LEAST_SORTED", 1)
    monkeypatch.setattr(large, "resident", lambda: 100 * 2**20)
    return 100 * 2**20 + 2 * large.LEAST_BYTES


@pytest.mark.parametrize("jobs", [1, 3])
@pytest.mark.parametrize("config", ["", REGIONS])
def test_a_map_made_on_disk_is_the_file_of_the_map_made_in_memory(
    little: int, tmp_path: Path, jobs: int, config: str
) -> None:
    (tmp_path / "given.yaml").write_text(config)
    given = parameters(config=tmp_path / "given.yaml" if config else None)
    recording = open_recording(SAMPLE)
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    with build_large(recording, given, little, scratch=scratch, jobs=jobs) as made:
        write_map(tmp_path / "large.npz", made.surface)
        description = describe(made.surface)
        assert (len(made.surface.parts) > 5) != bool(config)
    expected = build(recording, given)
    write_map(tmp_path / "expected.npz", expected.surface)
    assert (tmp_path / "large.npz").read_bytes() == (tmp_path / "expected.npz").read_bytes()
    assert read_map(tmp_path / "large.npz").meta == expected.surface.meta
    assert description == describe(expected.surface)
    assert made.report.dropped == expected.report.dropped
    assert list(scratch.iterdir()) == []


def test_the_gap_is_found_on_disk_as_in_memory(
    little: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Surroundings of a few points at a time, over many blocks.
    monkeypatch.setattr(gap_size, "_TOGETHER", 7)
    rng = np.random.default_rng(1)
    deck = rng.uniform((0, 8, 0.9), (20, 12, 1), (800, 3))
    ground = np.concatenate([rng.uniform((0, 0, 0), (20, 20, 0.1), (4000, 3)), deck])
    wall = rng.uniform((0, 0, 0), (20, 0.05, 5), (1500, 3))
    for number, cloud in enumerate((ground, np.concatenate([ground, wall]))):
        write_bag(tmp_path / f"{number}.bag", [Sent(part) for part in np.array_split(cloud, 9)])
        recording = open_recording(tmp_path / f"{number}.bag")
        expected = build(recording, parameters()).surface
        assert expected.gap_size == (1.5 if number else 0.25)
        with build_large(recording, parameters(), little) as made:
            write_map(tmp_path / f"{number}.npz", made.surface)
        large_map = read_map(tmp_path / f"{number}.npz")
        assert large_map == expected
        assert large_map.meta == expected.meta


def test_a_keyframe_is_sorted_in_parts_where_memory_is_left_for_few_points(
    little: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sorted_at_once: list[int] = []
    add = PointBlocks.add

    def counted(blocks: PointBlocks, points: Points) -> None:
        sorted_at_once.append(points.size)
        add(blocks, points)

    monkeypatch.setattr(PointBlocks, "add", counted)
    recording = open_recording(np.random.default_rng(1).uniform(0, (20, 20, 2), (5_000, 3)))
    with build_large(recording, parameters(), little, scratch=tmp_path) as made:
        write_map(tmp_path / "large.npz", made.surface)
    assert sum(sorted_at_once) == 5_000
    assert max(sorted_at_once) <= 800
    assert read_map(tmp_path / "large.npz") == build(recording, parameters()).surface


def test_what_memory_cannot_do_is_refused_with_what_it_takes(little: int) -> None:
    recording = open_recording(SAMPLE)
    for given, words in (
        (mlscli.load_parameters(None, []), r"map\.cell_size"),
        (parameters("mode=sequential"), "consistent"),
    ):
        with pytest.raises(UsageError, match=words), build_large(recording, given, little):
            pass
    too_little = r"`memory`: 50M is too little; give at least \d+M"
    with (
        pytest.raises(UsageError, match=too_little),
        build_large(recording, parameters(), 50 << 20),
    ):
        pass


def test_a_crowd_that_memory_cannot_hold_is_told(
    monkeypatch: pytest.MonkeyPatch, little: int
) -> None:
    monkeypatch.setattr(tilewise, "EVALUATED", large.LEAST_BYTES)
    told = r"16 cells square and their surroundings hold [\d,]+ points; give at least \d+M"
    recording = open_recording(SAMPLE)
    with pytest.raises(UsageError, match=told), build_large(recording, parameters(), little):
        pass


def test_points_too_scattered_to_be_listed_are_told(
    monkeypatch: pytest.MonkeyPatch, little: int
) -> None:
    recording = open_recording(SAMPLE)
    monkeypatch.setattr(large, "INDEXED", large.LEAST_BYTES // 2)
    told = r"too little: the points lie in [\d,]+ blocks, which have to be listed; give .* \d+M"
    with pytest.raises(UsageError, match=told), build_large(recording, parameters(), little):
        pass


def test_regions_that_memory_cannot_hold_are_told(
    monkeypatch: pytest.MonkeyPatch, little: int, tmp_path: Path
) -> None:
    (tmp_path / "given.yaml").write_text(REGIONS)
    monkeypatch.setattr(large, "FINISHED", large.LEAST_BYTES)
    given = parameters(config=tmp_path / "given.yaml")
    recording = open_recording(SAMPLE)
    told = r"regions needs the whole map, [\d,]+ patches; give at least \d+M"
    with pytest.raises(UsageError, match=told), build_large(recording, given, little):
        pass


def test_where_no_point_is_left_it_says_so(little: int) -> None:
    given = parameters("map.cell_size=0.0001")
    recording = open_recording(SAMPLE)
    with pytest.raises(InputError, match="no point is left"), build_large(recording, given, little):
        pass


def test_no_folder_for_what_does_not_fit(little: int, tmp_path: Path) -> None:
    recording = open_recording(SAMPLE)
    missing = tmp_path / "none"
    with (
        pytest.raises(OutputError, match=r"none: no room .*`scratch` DIR"),
        build_large(recording, parameters(), little, scratch=missing),
    ):
        pass


def test_a_full_disk_is_one_line_and_leaves_nothing(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    clouds = [Sent(rng.uniform(0, 9, (20_000, 3)) * (1, 1, 0.01)) for _ in range(2)]
    write_bag(tmp_path / "flight.bag", clouds)
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    # Files may grow no larger than a tenth of the points: as if the disk were full.
    command = [sys.executable, "-m", "mlscli", "build", "flight.bag", "--memory", "1G"]
    command += ["--set", "map.cell_size=0.2", "--scratch", str(scratch)]
    done = subprocess.run(
        command,
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000)),
    )
    assert done.returncode == 1
    assert "scratch: no room for temporary files: " in done.stderr
    said = [line for line in done.stderr.splitlines() if line.startswith("mls")]
    assert len([line for line in said if "compiling kernels" not in line]) == 2
    assert sorted(path.name for path in tmp_path.iterdir()) == ["flight.bag", "scratch"]
    assert list(scratch.iterdir()) == []
