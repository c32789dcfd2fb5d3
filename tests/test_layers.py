"""Rooms stand on floors, and import only from below.

How one could cheat: to import by name, late, so the names that commands and the package load are
looked up, too; to leave a room out of the list, so every module must lie in a room of it; to put
all into one room, so modules must not import each other in a circle either.
"""

from __future__ import annotations

import ast
import re
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

import mlscli
from mlscli.cli import COMMANDS

ROOT = Path(mlscli.__file__).parent

# From the ground up. A room is a folder; of the package's own folder each module is one.
FLOORS = (
    ("errors", "version", "words"),
    ("parameters", "runtime"),
    ("keyframes", "maps"),
    ("geometry", "io", "io.plausibility", "mesh", "pipeline.stages", "queries", "rasters"),
    ("io.clouds", "io.containers", "io.writing", "pipeline"),
    ("aligning", "config", "io.messages", "pipeline.tilewise", "scoring", "view"),
    ("io.reading", "plot", "scenes"),
    ("building",),
    ("trials",),
    ("commands",),
    ("cli", "__init__"),
    ("__main__",),
)
FLOOR = {room: number for number, rooms in enumerate(FLOORS) for room in rooms}
MODULES = {
    ".".join(path.relative_to(ROOT).with_suffix("").parts): path for path in ROOT.rglob("*.py")
}


def room_of(module: str) -> str:
    return module.rpartition(".")[0] or module


def module_of(name: str) -> str:
    """Return the module that a name in an import stands for."""
    own = name.removeprefix("mlscli").removeprefix(".")
    return own if own in MODULES else f"{own}.__init__".removeprefix(".")


@cache
def imports(module: str) -> frozenset[str]:
    """Return the modules that one imports, wherever in it, and those it loads by name."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(MODULES[module].read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            inside = [f"{node.module}.{alias.name}" for alias in node.names]
            names |= {name if module_of(name) in MODULES else node.module for name in inside}
        elif isinstance(node, ast.Constant) and str(node.value).startswith("mlscli."):
            names |= {str(node.value)} if module_of(str(node.value)) in MODULES else set()
    own = {module_of(name) for name in names if name.split(".")[0] == "mlscli"}
    return frozenset(own & MODULES.keys() - {module})


def test_every_module_lies_in_a_room_and_every_room_has_modules() -> None:
    assert {room_of(module) for module in MODULES} == FLOOR.keys()


def test_what_is_loaded_by_name_is_seen() -> None:
    assert {module_of(home) for home, _ in COMMANDS.values()} <= imports("cli")
    assert "building.build" in imports("__init__")


@pytest.mark.parametrize("module", sorted(MODULES))
def test_a_room_imports_only_from_floors_below(module: str) -> None:
    room = room_of(module)
    above = {
        other
        for other in imports(module)
        if room_of(other) != room and FLOOR[room_of(other)] >= FLOOR[room]
    }
    assert not above


def test_no_modules_import_each_other_in_a_circle() -> None:
    TopologicalSorter({module: imports(module) for module in MODULES}).prepare()


def test_reading_and_writing_do_not_know_each_other() -> None:
    reading = ("io.clouds", "io.containers", "io.messages", "io.reading")
    for module in MODULES:
        others = {room_of(other) for other in imports(module)}
        if room_of(module) in reading:
            assert "io.writing" not in others
        elif room_of(module) == "io.writing":
            assert others.isdisjoint(reading)


def test_the_design_says_so_too() -> None:
    page = (Path(__file__).resolve().parent.parent / "docs/design.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| *(\d+) \| ([^|]*) \|", page, re.MULTILINE)
    told = {int(floor): set(re.findall(r"`([\w/]+?)/?`", rooms)) for floor, rooms in rows}
    expected = {
        number: {room.replace(".", "/") for room in rooms} for number, rooms in enumerate(FLOORS, 1)
    }
    # The package's own modules share a floor there, one above the other.
    expected[11] |= expected.pop(12)
    assert told == expected
