"""Run a command in a process of its own, and say what it took.

``python -m benchmarks.process COMMAND...`` prints it as JSON. It is a small program, as a process
begins with the peak of memory of the one that starts it.
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
    """What a command took: wall and CPU time (s), the peak of memory (bytes), what it printed."""

    seconds: float
    cpu: float
    peak: int
    output: str


def ran(command: Sequence[str], environment: Mapping[str, str] | None = None) -> Ran:
    """Run a command, which must succeed, and return what it took."""
    program = [sys.executable, "-m", "benchmarks.process", *command]
    kept = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    done = subprocess.run(
        program, capture_output=True, text=True, check=False, env={**kept, **(environment or {})}
    )
    if done.returncode:
        raise RuntimeError(f"{' '.join(command)}: {done.stderr}")
    return Ran(*json.loads(done.stdout))


def _main(command: Sequence[str]) -> int:
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
