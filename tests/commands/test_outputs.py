"""No command replaces what it reads, under whatever name.

Ways to pass without being right: to compare names, or to look after the work is done, when the
output has been replaced.
"""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from pathlib import Path

import pytest
from click.testing import CliRunner

from mlscli.errors import OutputError, UsageError
from mlscli.io.writing.npz import write_map
from tests.helpers.maps import Patch, map_of

CASES = {
    "a map's route": "build a.txt --route tum.npz -o again/tum.npz",
    "a map's transform": "build a.txt --transform onto.npz -o again/onto.npz",
    "a map's configuration": "build a.txt -c p.npz -o again/p.npz",
    "a source under another name": "build a.txt b.npz -o again/b.npz",
    "the replay's source": "build a.txt b.npz --replay again/b.npz",
    "a route around a scan": "synth --cloud a.txt --route tum.txt -o again/tum.txt",
    "legs": "synth --cloud a.txt --legs legs.txt -o again/legs.txt",
    "the report's configuration": "bench --quality -c p.npz -o again/p.npz",
    "points of a page": "view b.npz --points a.html --html again/a.html",
    "another map of a picture": "plot b.npz --compare a.png -o again/a.png",
    "the path of a craft": "clearance b.npz --craft 1,1 --path a.mcap --mcap again/a.mcap",
    "a map to align": "align b.npz c.npz -o again/c.npz",
    "maps to merge": "merge b.npz c.npz -o again/c.npz",
}


@pytest.mark.parametrize("case", CASES)
def test_an_input_is_never_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, case: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "again").symlink_to(".")
    name, *arguments = CASES[case].split()
    for word in arguments:
        if "." in word and not word.startswith("again"):
            Path(word).write_text("mode: consistent\n" if word == "p.npz" else "0 0 0\n")
    before = {file.name: file.read_bytes() for file in tmp_path.glob("*.*")}
    command = import_module(f"mlscli.commands.{name}").command
    error = CliRunner().invoke(command, [*arguments, "--overwrite"]).exception
    assert isinstance(error, OutputError)
    assert str(error) == f"{arguments[-1]}: is the source itself; choose another name"
    assert {file.name: file.read_bytes() for file in tmp_path.glob("*.*")} == before


def test_a_replay_is_not_written_over_the_map_that_goes_with_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "again").symlink_to(".")
    (tmp_path / "a.txt").write_text("0 0 0\n")
    command = import_module("mlscli.commands.build").command
    arguments = ["a.txt", "-o", "q.npz", "--replay", "again/q.npz", "--overwrite"]
    error = CliRunner().invoke(command, arguments).exception
    assert isinstance(error, UsageError)
    assert str(error) == "--replay again/q.npz: is the map's name; choose another"


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ("synth --type 1 --grid 1e-300 -o b.txt", "expected at most 200000000"),
        ("plot a\udcff.npz -o a.png", ""),
        ("view a\udcff.npz --points a.txt --html a.html", ""),
    ],
)
def test_odd_names_numbers_and_metas_end_in_no_internal_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: str, told: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.txt").write_text("0 0 0\n1 0 0\n")
    write_map("a\udcff.npz", replace(map_of([Patch(0, 0, 1.0, 0.0, 0, 1)]), meta={"reading": 3}))
    name, *rest = arguments.split(" ")
    done = CliRunner().invoke(import_module(f"mlscli.commands.{name}").command, rest)
    assert done.exception is None if not told else isinstance(done.exception, UsageError)
    assert told in str(done.exception)
