"""Words of errors: the library names arguments, the command line options."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import mlscli
from mlscli.errors import UsageError, expect, with_options
from tests.helpers.program import mls

ROOT = Path(mlscli.__file__).parent


@pytest.mark.parametrize(
    ("message", "spoken"),
    [
        ("`up` q: expected one of z, -z", "--up q: expected one of z, -z"),
        ("say `time_source` log, or `frame` map", "say --time-source log, or --frame map"),
        ("`sets` a=b: unknown", "--set a=b: unknown"),
        ("`type_` 9: no such scene", "--type 9: no such scene"),
        ("a `b.txt` and `C` and ` d `", "a `b.txt` and `C` and ` d `"),
        ("no argument", "no argument"),
    ],
)
def test_arguments_are_options_on_the_command_line(message: str, spoken: str) -> None:
    assert with_options(message) == spoken


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
