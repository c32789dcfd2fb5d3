"""Words of errors: the library names arguments, the command line options."""

from __future__ import annotations

import ast
import json
import re
from importlib import import_module
from pathlib import Path

import pytest

import mlscli
from mlscli.cli import COMMANDS
from mlscli.commands import report
from mlscli.commands.topics import lines
from mlscli.errors import OPTIONS, UsageError, expect, printable, with_options
from tests.helpers.program import mls

ROOT = Path(mlscli.__file__).parent


@pytest.mark.parametrize(
    ("message", "spoken"),
    [
        ("`up` q: expected one of z, -z", "--up q: expected one of z, -z"),
        ("say `time_source` log, or `frame` map", "say --time-source log, or --frame map"),
        ("`sets` a=b: unknown", "--set a=b: unknown"),
        ("`type_` 9: no such scene", "--type 9: no such scene"),
        ("houses (`size` N)", "houses (--size N)"),
        ("a `b.txt` and `C` and ` d `", "a `b.txt` and `C` and ` d `"),
        ("/a/`topic`.npz: no `nofile` in '`up`' or x`end`", None),
        ("no argument", "no argument"),
    ],
)
def test_arguments_are_options_on_the_command_line(message: str, spoken: str | None) -> None:
    assert with_options(message) == (message if spoken is None else spoken)


@pytest.mark.parametrize(
    ("name", "shown"),
    [
        ("/wolke/ä 中", "/wolke/ä 中"),
        ("a\x1b]0;title\x07b", r"a\x1b]0;title\x07b"),
        ("a\nmls: done\r", r"a\nmls: done\r"),
        ("\x9b31m\u202egpj.\u2028", r"\x9b31m\u202egpj.\u2028"),
        ("\udcff", r"\udcff"),
    ],
)
def test_names_do_not_reach_a_terminal_as_controls(name: str, shown: str) -> None:
    assert printable(name) == shown
    link = {"parent": name, "child": "base", "moves": False}
    topic = {"name": name, "type": name, "messages": 1, "use": None}
    written = "\n".join(lines({"topics": [topic], "frames": [link]}))
    assert (written.count(shown), written.count("\n")) == (3, 4)
    assert report.lines([(name, name)]) == f"  {shown}  {shown}"


def test_every_option_that_is_named_is_one_of_a_command() -> None:
    there = {
        option
        for module, _ in COMMANDS.values()
        for parameter in import_module(module).command.params
        for option in parameter.opts
    }
    assert set(OPTIONS.values()) <= there


# What the library names beside options: arguments that no command has.
OTHERS = {"across", "axes", "cluster", "follow", "points", "seen"}


def test_every_argument_that_a_message_names_is_known() -> None:
    for path in ROOT.rglob("*.py"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        docstrings = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
        for node in ast.walk(tree):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                if id(node) in docstrings or path.name == "errors.py":
                    continue
                named = set(re.findall(r"`([a-z_]+)`", node.value))
                assert named <= OPTIONS.keys() | OTHERS, f"{path}: {node.value}"


def test_notes_and_lists_name_options_too(tmp_path: Path) -> None:
    rows = "".join(f"{n % 9} {n % 7} {n % 5} {n + 0.5} {n}\n" for n in range(200))
    (tmp_path / "a.txt").write_text(rows)
    notes = json.loads(mls("info", "a.txt", "--json", cwd=tmp_path).stdout)[0]["notes"]
    foreseen = mls("build", "a.txt", "--dry-run", "--json", cwd=tmp_path)
    for words in ("; ".join(notes), "; ".join(json.loads(foreseen.stdout)["notes"])):
        assert "--columns says what they hold" in words
    assert "(--size N)" in mls("synth", "--list", cwd=tmp_path).stdout


def test_the_same_fault_is_an_argument_in_the_library_and_an_option_of_the_command(
    tmp_path: Path,
) -> None:
    (tmp_path / "a.txt").write_text("1 2 3\n")
    with pytest.raises(UsageError, match=r"^`up` q: expected one of z, "):
        mlscli.open_recording(tmp_path / "a.txt", up="q")
    run = mls("build", "a.txt", "--up", "q", cwd=tmp_path)
    assert run.returncode == 2
    assert run.stderr.startswith("mls: --up q: expected one of z, ")


def test_no_message_of_the_library_speaks_of_an_option() -> None:
    # Where the one is made of the other.
    outside = ("commands", "cli.py", "errors.py")
    for path in ROOT.rglob("*.py"):
        if path.relative_to(ROOT).parts[0] in outside:
            continue
        for line in path.read_text(encoding="utf-8").splitlines():
            # What other programs are told, and this one on its command line, is no argument.
            if not re.search(r"mls bench|ros2 bag play|mls build --dry-run", line):
                assert not re.search(r"(?<![\w-])--[a-z]", line), f"{path}: {line}"


def test_a_wrong_type_says_what_was_found_and_what_is_right() -> None:
    expect(1, (int, str), "number", "a number or its name")
    with pytest.raises(TypeError, match=r"^`number`: found list; expected a number or its name$"):
        expect([], (int, str), "number", "a number or its name")
