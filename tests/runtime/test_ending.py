"""A signal ends the program in time, whatever it does.

Ways to pass without being right: to try it where Python takes signals anyway, between two lines of
Python; to leave half of an output.
"""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path
from threading import Thread

import pytest

from mlscli.runtime.interrupts import undisturbed
from tests.helpers.program import heed_interrupts

# Computes for minutes without a line of Python, as kernels do.
BUSY = """
import hashlib, pathlib, sys
from mlscli import cli
from mlscli.runtime.temporary import temporary_file
def work(run):
    with temporary_file(pathlib.Path(sys.argv[1]), "map.npz"):
        print("ready", flush=True)
        hashlib.pbkdf2_hmac("sha256", b"", b"", 1_000_000_000)
cli._status = work
cli.main()
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_program_that_takes_no_signal_ends_within_a_second_and_leaves_nothing(
    tmp_path: Path, number: signal.Signals
) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", BUSY, tmp_path],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=heed_interrupts,
    ) as program:
        assert program.stdout is not None
        assert program.stdout.readline() == "ready\n"
        begin = time.monotonic()
        program.send_signal(number)
        _, said = program.communicate(timeout=60)
    # A second, and what a machine with other work needs.
    assert time.monotonic() - begin < 3
    assert (program.returncode, said) == (128 + number, "mls: interrupted\n")
    assert not list(tmp_path.iterdir())


def test_the_end_waits_for_all_blocks_and_these_not_for_each_other() -> None:
    done = list[str]()

    def block() -> None:
        with undisturbed:
            done.append("block")

    with undisturbed:
        # Another thread's goes on meanwhile.
        other = Thread(target=block)
        other.start()
        other.join(10)
        assert not other.is_alive()
        waiting = Thread(target=undisturbed.when_over, args=(lambda: done.append("ended"),))
        waiting.start()
        waiting.join(0.05)
        assert done == ["block"]
    waiting.join(10)
    assert done == ["block", "ended"]
