"""``mls completion`` from outside: what shells are answered.

Ways to pass without being right: to print a script that no shell can run, so bash runs it; to
answer the same whatever stands on the line, so topics come from a recording there.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.helpers.bags import Sent, write_bag
from tests.helpers.program import mls


def completions(*words: str, cwd: Path | None = None) -> list[str]:
    """Return what bash is told for the last of some words; files are ``file,`` and the word."""
    line = " ".join(("mls", *words))
    asked = {"_MLS_COMPLETE": "bash_complete", "COMP_WORDS": line, "COMP_CWORD": str(len(words))}
    done = mls(cwd=cwd, env=asked)
    assert done.stderr == ""
    return [line.removeprefix("plain,") for line in done.stdout.splitlines() if line]


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("export", "m"), ["file,m"]),
        (("build", "a.bag", "--scratch", "a"), ["dir,a"]),
        (("build", "a.bag", "-c", "th"), ["thesis"]),
        (("build", "--set", "plaster.max_gap_"), ["plaster.max_gap_enhanced="]),
        (("synth", "--type", "tun"), ["tunnel"]),
        (("config", "init", "--preset", "pl"), ["plain"]),
    ],
)
def test_a_word_is_completed_to_what_can_stand_there(
    words: tuple[str, ...], expected: list[str]
) -> None:
    assert completions(*words) == expected


def test_topics_are_those_of_the_recording_on_the_line(tmp_path: Path) -> None:
    cloud = Sent(np.zeros((3, 3)))
    write_bag(tmp_path / "a.bag", [cloud], topics=("/front", "/rear"))
    assert completions("build", "a.bag", "--topic", "/", cwd=tmp_path) == ["/front", "/rear"]
    assert completions("build", "a.bag", "--pose-topic", "/", cwd=tmp_path) == []
    assert completions("build", "absent.bag", "--topic", "/", cwd=tmp_path) == []


@pytest.mark.skipif(not shutil.which("bash"), reason="needs bash")
def test_bash_runs_the_script_and_sets_no_space_behind_the_equals_sign(tmp_path: Path) -> None:
    program = tmp_path / "mls"
    program.write_text(f'#!/bin/sh\nexec {sys.executable} -m mlscli "$@"\n')
    program.chmod(0o755)
    script = f"""
        PATH="{tmp_path}:$PATH"
        eval "$(mls completion bash)"
        compopt() {{ echo "compopt $*"; }}
        COMP_WORDS=(mls build --set plaster.slope) COMP_CWORD=3
        _mls_completion mls
        echo "${{COMPREPLY[*]}}"
    """
    done = subprocess.run(
        ["bash", "-c", script], capture_output=True, text=True, timeout=60, check=True
    )
    assert done.stdout.split() == ["compopt", "-o", "nospace", "plaster.slope_reach="]


@pytest.mark.skipif(not shutil.which("fish"), reason="needs fish")
def test_fish_runs_the_script(tmp_path: Path) -> None:
    program = tmp_path / "mls"
    program.write_text(f'#!/bin/sh\nexec {sys.executable} -m mlscli "$@"\n')
    program.chmod(0o755)
    script = f"""
        set -x PATH {tmp_path} $PATH
        mls completion fish | source
        complete -C "mls synth --type tun"
    """
    env = {"HOME": str(tmp_path), "PATH": os.environ["PATH"]}
    done = subprocess.run(
        ["fish", "-c", script], capture_output=True, text=True, timeout=60, check=True, env=env
    )
    assert done.stdout.split("\t")[0] == "tunnel"
