"""Runs the program as a user does, through its real entry point."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path


def mls(
    *arguments: object, cwd: Path | None = None, env: Mapping[str, str] | None = None
) -> subprocess.CompletedProcess[str]:
    """Run ``mls`` with arguments in a folder, and return status, output and errors.

    That a first run compiles kernels is left out of the errors: it is no matter of the command.
    """
    command = [sys.executable, "-m", "mlscli", *map(str, arguments)]
    done = subprocess.run(
        command,
        cwd=cwd,
        env={**os.environ, **(env or {})},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    said = done.stderr.splitlines(keepends=True)
    done.stderr = "".join(line for line in said if not line.startswith("mls: compiling kernels"))
    return done


def heed_interrupts() -> None:
    """Let a program that is about to start be interrupted, also if the tests run in the background.

    There a shell has interrupts ignored, which programs inherit.
    """
    signal.signal(signal.SIGINT, signal.SIG_DFL)
