"""Builds that go on after they were interrupted: the same bits, or a reason why not.

How one could cheat: nothing kept, so that all is evaluated again; nothing left to do, so that
nothing has to go on; damage where nobody looks; another build that differs in everything.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from shutil import copytree, rmtree
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import mlscli
from mlscli.building import identity as identities
from mlscli.building.build import build
from mlscli.errors import InputError, OutputError, UsageError
from mlscli.io.reading.recording import open_recording
from mlscli.io.writing.npz import write_map
from mlscli.pipeline.tilewise import checkpoint as checkpoints
from mlscli.pipeline.tilewise import tiles as tilewise
from mlscli.pipeline.tilewise.checkpoint import Checkpoint, folder_of

CELL = "map.cell_size=0.5"


class StoppedError(Exception):
    """The build was interrupted."""


@pytest.fixture(autouse=True)
def _small_tiles(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tilewise, "WORTHWHILE_POINTS", 1)


@pytest.fixture
def said(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    lines: list[str] = []
    monkeypatch.setattr(checkpoints, "notice", lines.append)
    return lines


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a flight over two levels, whose craft is known."""
    rng = np.random.default_rng(5)
    path = tmp_path_factory.mktemp("flown") / "flight.txt"
    xyz = rng.uniform((0, 0, 0), (62, 7, 0.2), (1600, 3))
    xyz[::3, 2] += 3
    craft = np.tile((10.0, 9.0, 9.0), (1600, 1))
    rows = np.column_stack((xyz, np.arange(1600) // 200, craft))
    np.savetxt(path, rows, fmt="%.6f", header="x y z keyframe cx cy cz", comments="")
    return path


def made(
    flight: Path, target: Path, *sets: str, stop: int = 10**9, free: bool = False, **how: bool
) -> bytes:
    """Build with a checkpoint after each tile, and return the file; stop after some tiles."""

    def progress(what: str, done: int, _: int | None) -> None:
        if what == "tiles" and done > stop:
            raise StoppedError

    given = mlscli.load_parameters(None, [CELL, *sets])
    given = given.with_free_space() if free else given
    with Checkpoint(target, every=0.0, **how) as kept:
        built = build(open_recording(flight), given, progress, jobs=4, checkpoint=kept)
        write_map(target, built.surface, overwrite=True)
        kept.clear()
    return target.read_bytes()


def interrupted(flight: Path, target: Path, after: int = 4, *, free: bool = False) -> list[Path]:
    """Interrupt a build, and return the files of tiles that it has kept."""
    with pytest.raises(StoppedError):
        made(flight, target, stop=after, free=free)
    return sorted(folder_of(target).glob("tiles-*"))


@cache
def expected(flight: Path, *, free: bool = False) -> bytes:
    given = mlscli.load_parameters(None, [CELL])
    surface = build(open_recording(flight), given.with_free_space() if free else given).surface
    write_map(flight.with_suffix(".npz"), surface, overwrite=True)
    return flight.with_suffix(".npz").read_bytes()


@pytest.mark.parametrize("free", [False, True])
def test_a_resumed_build_ends_with_the_same_file_and_evaluates_the_rest_only(
    flight: Path, tmp_path: Path, said: list[str], monkeypatch: pytest.MonkeyPatch, free: bool
) -> None:
    target = tmp_path / "map.npz"
    assert len(interrupted(flight, target, free=free)) == 4
    evaluated: list[object] = []
    evaluate = tilewise.evaluate

    def counted(*given: Any) -> Any:
        evaluated.append(given[2])
        return evaluate(*given)

    monkeypatch.setattr(tilewise, "evaluate", counted)
    assert made(flight, target, resume=True, free=free) == expected(flight, free=free)
    (told,) = said
    tiles = int(told.split(" of ")[1].split()[0])
    assert " 4 of " in told
    assert len(evaluated) == tiles - 4 > 2
    assert not folder_of(target).exists()


def test_a_build_can_be_interrupted_again_and_again(
    flight: Path, tmp_path: Path, said: list[str]
) -> None:
    target = tmp_path / "map.npz"
    interrupted(flight, target, 1)
    for stop in (2, 4, 6):
        with pytest.raises(StoppedError):
            made(flight, target, resume=True, stop=stop)
    assert [line.split(": ")[1].split()[0] for line in said] == ["1", "2", "4"]
    assert made(flight, target, resume=True) == expected(flight)


def test_damaged_tiles_are_told_and_evaluated_anew(
    flight: Path, tmp_path: Path, said: list[str]
) -> None:
    target, other = tmp_path / "map.npz", tmp_path / "other.npz"
    name = interrupted(flight, target)[1].name
    with pytest.raises(StoppedError):
        made(flight, other, "plaster.max_gap=0.7", stop=3)
    content = (folder_of(target) / name).read_bytes()
    middle = len(content) // 2
    damaged = {
        "cut": content[:-40],
        "empty": b"",
        "flipped": content[:middle] + bytes([content[middle] ^ 4]) + content[middle + 1 :],
        "longer": content + b"0",
        "of another build": (folder_of(other) / name).read_bytes(),
    }
    copytree(folder_of(target), tmp_path / "kept")
    for damage, there in damaged.items():
        rmtree(folder_of(target), ignore_errors=True)
        copytree(tmp_path / "kept", folder_of(target))
        (folder_of(target) / name).write_bytes(there)
        said.clear()
        assert made(flight, target, resume=True) == expected(flight), damage
        told = f"{name}: is damaged, or of another build; its tiles are evaluated anew"
        assert told in said[0], damage
        assert ": 3 of " in said[1], damage


def test_a_checkpoint_whose_description_is_damaged_is_refused(flight: Path, tmp_path: Path) -> None:
    target = tmp_path / "map.npz"
    interrupted(flight, target)
    description = folder_of(target) / "build.json"
    text = description.read_text()
    for damaged in (text[:-9], text.replace("0.5", "0.7", 1), "", "{}\n", f"{text}\n{text}"):
        description.write_text(damaged)
        with pytest.raises(InputError, match=r"build\.json: is damaged.*`overwrite` to begin anew"):
            made(flight, target, resume=True)
    assert made(flight, target, overwrite=True) == expected(flight)


def test_another_build_is_refused_with_the_difference_named(
    flight: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = tmp_path / "map.npz"
    interrupted(flight, target)
    with pytest.raises(
        UsageError, match=r"plaster\.max_gap is 0\.7 here, and \S+ .*checkpoint; build"
    ):
        made(flight, target, "plaster.max_gap=0.7", resume=True)
    other = flight.with_name("other.txt")
    other.write_bytes(flight.read_bytes())
    with pytest.raises(
        UsageError, match=r'sources is \["\S+other.txt"\] here, and \["\S+flight.txt"\]'
    ):
        made(other, target, resume=True)
    text = flight.read_text()
    flight.write_text(text + text.splitlines(keepends=True)[-1])
    with pytest.raises(UsageError, match=r"bytes\.\S+flight\.txt is \d+ here, and \d+ in"):
        made(flight, target, resume=True)
    # As many bytes, and another digit.
    row = text.splitlines()[1]
    flight.write_text(text.replace(row, f"{row[:4]}{(int(row[4]) + 1) % 10}{row[5:]}"))
    with pytest.raises(UsageError, match="do not hold the points of the checkpoint any more"):
        made(flight, target, resume=True)
    flight.write_text(text)
    for package in ("mlscli", "numpy", "numba"):
        there = {"mlscli": "1", "numpy": "1", "numba": "1"} | {package: "0.0"}
        monkeypatch.setattr(identities, "versions", lambda there=there: there)
        with pytest.raises(UsageError, match=r"program\.\w+ is "):
            made(flight, target, resume=True)
    monkeypatch.undo()
    monkeypatch.setattr(identities, "_code", lambda: "changed")
    with pytest.raises(UsageError, match=r'program\.code is "changed" here, and "\w{16}" in'):
        made(flight, target, resume=True)


def test_a_folder_is_known_by_the_size_of_all_that_lies_in_it(tmp_path: Path) -> None:
    folder = tmp_path / "recording"
    (folder / "parts").mkdir(parents=True)
    (folder / "metadata.yaml").write_text("12345")
    (folder / "parts/a.db3").write_text("678")
    recording: Any = SimpleNamespace(sources=[str(folder)], options={})
    made_of = identities.identity(recording, mlscli.Parameters())
    assert made_of["bytes"] == {str(folder): 8}


def test_what_another_build_left_is_used_by_nobody_who_does_not_say_so(
    flight: Path, tmp_path: Path, said: list[str]
) -> None:
    target = tmp_path / "map.npz"
    parts = interrupted(flight, target)
    with pytest.raises(UsageError, match="add `resume` to go on from it, or `overwrite`"):
        made(flight, target)
    assert sorted(folder_of(target).glob("tiles-*")) == parts
    assert made(flight, target, overwrite=True) == expected(flight)
    assert said == []


def test_where_nothing_was_kept_a_resumed_build_begins_and_says_so(
    flight: Path, tmp_path: Path, said: list[str]
) -> None:
    target = tmp_path / "map.npz"
    assert made(flight, target, resume=True) == expected(flight)
    assert said == [f"{target}.checkpoint: no checkpoint is there; the build begins anew"]


def test_two_builds_do_not_keep_their_tiles_in_one_place(flight: Path, tmp_path: Path) -> None:
    target = tmp_path / "map.npz"
    interrupted(flight, target)
    with (
        Checkpoint(target, resume=True),
        pytest.raises(OutputError, match="another build writes there"),
        Checkpoint(target, resume=True),
    ):
        pass
    assert made(flight, target, resume=True) == expected(flight)


def test_what_is_no_checkpoint_stays(flight: Path, tmp_path: Path, said: list[str]) -> None:
    target = tmp_path / "map.npz"
    folder_of(target).mkdir()
    (folder_of(target) / "notes.txt").write_text("mine")
    assert made(flight, target) == expected(flight)
    assert [path.name for path in folder_of(target).iterdir()] == ["notes.txt"]
    assert "stays, as it holds more than a checkpoint" in said[0]
    other = tmp_path / "other.npz"
    folder_of(other).write_text("a file")
    with pytest.raises(OutputError, match="no checkpoint can lie there"):
        made(flight, other)


def test_a_time_between_checkpoints_is_kept_to(
    flight: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = tmp_path / "map.npz"
    clock = iter(range(1000))
    monkeypatch.setattr(checkpoints, "monotonic", lambda: float(next(clock)))
    given = mlscli.load_parameters(None, [CELL])
    files: list[int] = []

    def progress(what: str, *_: object) -> None:
        if what == "tiles":
            files.append(len(list(folder_of(target).glob("tiles-*"))))

    with Checkpoint(target, every=2.0) as kept:
        build(open_recording(flight), given, progress, jobs=4, checkpoint=kept)
    # A file is there once the next tile is asked for.
    assert files[:7] == [0, 0, 1, 1, 2, 2, 3]
