"""What ``--json`` prints is what the schemas of the reference say.

How one could cheat: a schema that lets everything pass, so objects are closed, and one with a key
more or less, or of another type, must be refused; results that no schema tells, so every command
that has the option is looked up.
"""

from __future__ import annotations

import copy
import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator

from docs.site import results
from mlscli.cli import COMMANDS, commands
from tests.helpers.program import mls

# Reports of experiments, and parameters, which have a page of their own.
WITHOUT = {"bench", "config"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a small flight, its truth and two maps of it."""
    made = tmp_path_factory.mktemp("results")
    coarse = ("--type", "bridge", "--grid", "0.4", "--anew", "--sigma", "0.02,0.02")
    assert mls("synth", *coarse, "-o", "flight.bag", cwd=made).returncode == 0
    size = ("--set", "map.cell_size=0.3", "--set", "map.gap_size=0.2")
    built = mls("build", "flight.bag", "--free-space", *size, "-o", "a.npz", cwd=made)
    assert built.returncode == 0
    shutil.copy(made / "a.npz", made / "b.npz")
    (made / "cloud.txt").write_text("".join(f"{x} {y} 0 0\n" for x in range(6) for y in range(6)))
    return made


RUNS = {
    "build": ("build", "flight.bag", "--growing", "-o", "again.npz", "--overwrite"),
    "build-dry-run": ("build", "flight.bag", "--dry-run", "-o", "none.npz"),
    "info-messages": ("info", "flight.bag"),
    "info-cloud": ("info", "cloud.txt"),
    "info-map": ("info", "a.npz"),
    "query": ("query", "a.npz", "--at", "0,0", "--at", "1,1,0.8"),
    "clearance": ("clearance", "a.npz", "--craft", "0.6,0.4", "--line=0,-2.5,0.75,0,2.5,0.75"),
    "explore": ("explore", "a.npz", "--craft", "0.6,0.4", "--views", "2"),
    "compare": ("compare", "a.npz", "b.npz"),
    "compare-changed": ("compare", "a.npz", "b.npz", "--changed"),
    "compare-truth": ("compare", "a.npz", "--truth", "flight.truth.npz"),
    "compare-cloud": ("compare", "a.npz", "--cloud", "cloud.txt"),
    "export": ("export", "a.npz", "--format", "nav2"),
    "merge": ("merge", "a.npz", "b.npz", "-o", "merged.npz"),
    "synth": ("synth", "--type", "bridge", "--grid", "0.5", "-o", "coarse.bag"),
}


def faults(name: str, told: Any) -> list[str]:
    validator = Draft202012Validator(results.schema(name))
    return [f"{error.json_path}: {error.message}" for error in validator.iter_errors(told)]


@pytest.mark.parametrize("name", RUNS)
def test_what_is_printed_is_what_the_schema_says(name: str, folder: Path) -> None:
    done = mls(*RUNS[name], "--json", cwd=folder)
    told = json.loads(done.stdout)
    for each in told if isinstance(told, list) else [told]:
        assert faults(name, each) == []
        # A schema that lets anything pass would be no use.
        key = next(iter(each))
        assert faults(name, {k: v for k, v in each.items() if k != key})
        wrong = copy.deepcopy(each)
        wrong[key] = {"unlike": "anything"}
        assert faults(name, wrong)
        if name != "export":
            assert faults(name, {**each, "more": 1})


def test_every_result_has_a_schema_that_is_one_and_all_are_tried() -> None:
    # Maps are aligned where that is tested: it takes a second, and these look alike turned around.
    assert set(results.names()) == {*RUNS, "align"}
    for name in results.names():
        # The shared parts are the same in all.
        own = {**results.schema(name), "$defs": {}}
        Draft202012Validator.check_schema(own)
    Draft202012Validator.check_schema(results.schema(name))


def test_every_command_with_json_has_a_schema() -> None:
    context = commands.make_context("mls", [], resilient_parsing=True)
    told = {name.partition("-")[0] for name in results.names()}
    for name in COMMANDS:
        command = commands.get_command(context, name)
        assert command is not None
        if any("--json" in option.opts for option in command.params):
            assert name in told | WITHOUT, name
