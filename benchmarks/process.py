"""Run a command in a new process, and measure its time and memory.

``python -m benchmarks.process COMMAND...`` prints them as JSON. A program of its own starts the
command, as a process inherits the peak of memory of the one that starts it: this one is small.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from typing import NamedTuple


class Ran(NamedTuple):
    """Time, memory and output of a command.

    Attributes
    ----------
    seconds : float
        Wall time.
    cpu : float
        CPU time (s), in user and system mode.
    peak : int
        The greatest resident size, in bytes.
    output : str
        Its standard output.
    """

    seconds: float
    cpu: float
    peak: int
    output: str


def ran(command: Sequence[str], environment: Mapping[str, str] | None = None) -> Ran:
    """Run a command and measure it.

    Parameters
    ----------
    command : sequence of str
        The program and its arguments.
    environment : mapping of str to str, optional
        Variables added to the environment.

    Raises
    ------
    RuntimeError
        Where the command fails.
    """
    program = [sys.executable, "-m", "benchmarks.process", *command]
    kept = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    done = subprocess.run(
        program, capture_output=True, text=True, check=False, env={**kept, **(environment or {})}
    )
    if done.returncode:
        raise RuntimeError(f"{' '.join(command)}: {done.stderr}")
    return Ran(*json.loads(done.stdout))


def _main(command: Sequence[str]) -> int:
    """Run a command, print its measures as JSON, and return its exit status."""
    begin = time.perf_counter()
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        output = process.stdout.read()
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    seconds = time.perf_counter() - begin
    cpu = used.ru_utime + used.ru_stime
    sys.stdout.write(json.dumps([seconds, cpu, used.ru_maxrss * 1024, output]))
    return process.returncode


if __name__ == "__main__":
    sys.exit(_main(sys.argv[1:]))
