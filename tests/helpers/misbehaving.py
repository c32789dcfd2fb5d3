"""Programs that do what no run may do, and what the judges of hostile input find in them.

Run as a program of its own, which forks: ``python -m tests.helpers.misbehaving``.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import NoReturn

import numpy as np

from fuzz.child import Limits, new_folder, run
from fuzz.judging import judge, listed

LIMITS = Limits(seconds=0.3, memory=1 << 26)


def fail(*lines: str, status: int = 1) -> NoReturn:
    sys.stderr.write("".join(f"{line}\n" for line in lines))
    sys.exit(status)


def trace() -> None:
    raise KeyError("lost")


def internal() -> None:
    fail("mls: internal error: KeyError: 'lost'; run again as 'mls --debug ...' for the traceback")


def warn() -> None:
    warnings.warn("overflow encountered in add", RuntimeWarning, stacklevel=1)


def crash() -> None:
    os.kill(os.getpid(), signal.SIGSEGV)


def spin() -> None:
    while True:
        pass


def wait() -> None:
    time.sleep(100)


def fill() -> None:
    np.ones(1 << 24)


def ask_too_much() -> None:
    np.zeros(1 << 40, dtype=np.uint8)


def write_beside() -> None:
    Path("beside.txt").write_text("there")


def write_far_away() -> None:
    path = Path(tempfile.gettempdir()).parents[1] / f"misbehaving-{os.getpid()}"
    path.write_text("there")
    path.unlink()


def change_an_input() -> None:
    with os.fdopen(os.open("in/file", os.O_WRONLY | os.O_APPEND), "wb") as file:
        file.write(b"more")


def start_a_program() -> None:
    import subprocess

    subprocess.run(["true"], check=True)


def end_oddly() -> None:
    fail("mls: it is odd", status=5)


def write_and_fail() -> None:
    Path("out/map.npz").write_text("half of it")
    fail("mls: in/file: is broken")


def leave_a_part() -> None:
    Path("out/.map.npz.mls-12345678").write_text("half of it")


def leave_scratch() -> None:
    Path(os.environ["TMPDIR"], "blocks").write_text("points")


def say_two_lines() -> None:
    fail("mls: in/file: is broken", "at its end")


def say_nothing() -> None:
    fail()


def say_what_a_terminal_obeys() -> None:
    fail("mls: topic \x1b[31mred: is empty")


def write_an_unsound_map() -> None:
    np.savez("out/map.npz", format=np.array("mls-map"))


def refuse() -> None:
    fail("mls: in/file: is broken", status=2)


def succeed() -> None:
    Path("out/map.txt").write_text("a map")
    sys.stdout.write("done\n")


KINDS: dict[Callable[[], None], str] = {
    trace: "traceback",
    internal: "internal error",
    warn: "warning",
    crash: "signal",
    spin: "hang",
    wait: "hang",
    fill: "memory",
    ask_too_much: "memory",
    write_beside: "elsewhere",
    write_far_away: "elsewhere",
    change_an_input: "elsewhere",
    start_a_program: "elsewhere",
    end_oddly: "status",
    write_and_fail: "output of an error",
    leave_a_part: "left behind",
    leave_scratch: "left behind",
    say_two_lines: "lines",
    say_nothing: "no word",
    say_what_a_terminal_obeys: "control character",
    write_an_unsound_map: "unsound map",
    refuse: "",
    succeed: "",
}
"""Programs, and the kind of finding that each is; nothing for those that are right."""


def main() -> None:
    """Print what is found in each, as JSON: names to kinds."""
    # What runs of the program have loaded before they fork.
    import mlscli.io.writing.npz  # noqa: F401

    found = {}
    with new_folder() as whole:
        for program in KINDS:
            folder = whole / program.__name__
            for name in ("in", "out", "tmp"):
                (folder / name).mkdir(parents=True)
            (folder / "in" / "file").write_text("some")
            before, answers = listed(folder), frozenset({0, 3})
            ended = run([], folder, LIMITS, program)
            kinds = {each.kind for each in judge(ended, answers, LIMITS, folder, before)}
            found[program.__name__] = sorted(kinds)
            assert folder.is_dir()
    sys.stdout.write(json.dumps(found))


if __name__ == "__main__":
    main()
