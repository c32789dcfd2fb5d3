"""Standard streams: ``-`` as input and output, and how much ``-q`` and ``-v`` tell.

How one could cheat: to read standard input once where a file is read twice, so a map from a pipe is
held against that of the file; to be quiet also of what was lost, so a cut file is read quietly.
"""

from __future__ import annotations

import os
import pty
import re
import subprocess
import sys
from pathlib import Path

import pytest

import mlscli
from mlscli.cli import COMMANDS
from tests.helpers.program import mls

ROOT = Path(__file__).resolve().parents[2]
SAMPLE = ROOT / "data/samples/bridge.txt"


def piped(*arguments: object, given: bytes, cwd: Path) -> subprocess.CompletedProcess[bytes]:
    """Run the program with something sent into it through a pipe."""
    words = [sys.executable, "-m", "mlscli", *map(str, arguments)]
    return subprocess.run(
        words, cwd=cwd, input=given, capture_output=True, timeout=300, check=False
    )


def test_a_map_of_standard_input_is_that_of_the_file(tmp_path: Path) -> None:
    done = piped("build", "-", "-o", "piped.npz", given=SAMPLE.read_bytes(), cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert mls("build", SAMPLE, "-o", "named.npz", cwd=tmp_path).returncode == 0
    one, other = (mlscli.read_map(tmp_path / name) for name in ("piped.npz", "named.npz"))
    assert mls("compare", "piped.npz", "named.npz", cwd=tmp_path).returncode == 0
    assert one.meta["sources"] == ["/dev/stdin"]
    assert other.meta["points"] == one.meta["points"]


def test_a_configuration_goes_through_a_pipe(tmp_path: Path) -> None:
    printed = mls("config", "init", "-o", "-", cwd=tmp_path)
    assert printed.returncode == 0
    done = piped("config", "check", "-", given=printed.stdout.encode(), cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, b"/dev/stdin: ok\n")
    wrong = piped("config", "check", "-", given=b"map:\n  cel_size: 1\n", cwd=tmp_path)
    assert wrong.returncode == 2
    assert wrong.stderr.startswith(b"mls: /dev/stdin:2:3: ")


def test_standard_input_is_one_file(tmp_path: Path) -> None:
    done = mls("build", "-", "--route", "-", "-o", "m.npz", cwd=tmp_path)
    assert done.returncode == 2
    assert "-: standard input is" in done.stderr


def test_what_is_no_text_is_not_written_to_standard_output(tmp_path: Path) -> None:
    mls("build", SAMPLE, "-o", "m.npz", cwd=tmp_path)
    for words in (("build", SAMPLE), ("export", "m.npz", "--format", "ply"), ("explore", "m.npz")):
        craft = ("--craft", "1,1", "--json") if words[0] == "explore" else ()
        done = mls(*words, *craft, "-o", "-", cwd=tmp_path)
        assert done.returncode in (1, 2)
        assert done.stderr.startswith("mls: -"), done.stderr
    assert not (tmp_path / "-").exists()


def test_tables_are_printed_as_they_are_written(tmp_path: Path) -> None:
    mls("build", SAMPLE, "-o", "m.npz", cwd=tmp_path)
    explored = ("explore", "m.npz", "--craft", "1,1", "--views", "2")
    printed = mls(*explored, "-o", "-", "-o", "views.csv", cwd=tmp_path)
    assert printed.stdout == (tmp_path / "views.csv").read_text()
    assert printed.stdout.startswith("view,kind,")


@pytest.mark.parametrize("words", [("-q", "build"), ("build", "-q")])
def test_quiet_tells_what_was_lost_and_no_notes(tmp_path: Path, words: tuple[str, ...]) -> None:
    # A line that is cut is a loss; of a cell so much larger than the spacing a note says so.
    rows = [f"{x} {0.1 * (x % 3)} {z} {x}" for x in range(30) for z in range(40)]
    (tmp_path / "cut.txt").write_text("# x y z keyframe\n" + "\n".join(rows) + "\n7 0.")
    usual, quiet = (
        mls(
            *each,
            "cut.txt",
            "--set",
            "map.cell_size=20",
            "-c",
            "plain",
            "--overwrite",
            cwd=tmp_path,
        )
        for each in (("build",), words)
    )
    assert usual.returncode == quiet.returncode == 3
    notes = set(usual.stderr.splitlines()) - set(quiet.stderr.splitlines())
    assert notes
    assert not any("warning" in note for note in notes)
    assert all(line.startswith("mls: warning: ") for line in quiet.stderr.splitlines())
    assert quiet.stderr
    assert quiet.stdout.splitlines()[:3] == usual.stdout.splitlines()[:3]


def test_verbose_tells_files_and_steps_with_their_times(tmp_path: Path) -> None:
    done = mls("build", SAMPLE, "-v", cwd=tmp_path)
    assert done.returncode == 0
    told = [re.fullmatch(r"mls: \d+\.\d\d s: (.*)", line) for line in done.stderr.splitlines()]
    steps = [line[1] for line in told if line]
    assert len(steps) == len(told)
    assert steps[0] == f"{SAMPLE}: is read as text"
    assert {"reading", "median", "plaster"} <= set(steps)
    size = (tmp_path / "bridge.npz").stat().st_size
    assert steps[-1] == f"bridge.npz: written, {size:,} bytes"


def test_every_command_can_be_quiet_or_verbose_but_not_both(tmp_path: Path) -> None:
    for name in COMMANDS:
        text = mls(name, "--help", cwd=tmp_path).stdout
        assert "-q, --quiet" in text, name
        assert "-v, --verbose" in text, name
    both = mls("info", "-q", SAMPLE, "--verbose", cwd=tmp_path)
    assert both.returncode == 2
    assert both.stderr == "mls: --quiet: does not go with --verbose; leave one of them out\n"


def test_rows_fit_the_terminal_and_are_lines_elsewhere(tmp_path: Path) -> None:
    mls("build", SAMPLE, "-o", "m.npz", cwd=tmp_path)
    plain = mls("info", "m.npz", cwd=tmp_path).stdout
    assert max(map(len, plain.splitlines())) > 80
    ours, theirs = pty.openpty()
    environment = {**os.environ, "COLUMNS": "80"}
    words = [sys.executable, "-m", "mlscli", "info", "m.npz"]
    done = subprocess.run(words, cwd=tmp_path, stdout=theirs, env=environment, check=False)
    os.close(theirs)
    shown = b""
    while part := _read(ours):
        shown += part
    assert done.returncode == 0
    lines = shown.decode().splitlines()
    assert max(map(len, lines)) <= 80
    # Nothing is lost: the same words in the same order.
    assert " ".join(lines).split() == plain.split()
    # No colours, and nothing else that a terminal obeys.
    assert b"\x1b" not in shown


def _read(terminal: int) -> bytes:
    try:
        return os.read(terminal, 1 << 16)
    except OSError:
        # The other side is closed.
        return b""
