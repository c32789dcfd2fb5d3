"""The program, killed while it keeps what a build has evaluated."""

from __future__ import annotations

import atexit
import os
import signal
import sys
from types import FrameType
from typing import Any

from mlscli.building import large
from mlscli.cli import main as program
from mlscli.pipeline.tilewise import tiles

MOMENT = "MLS_KILLED_AT"
"""The environment's name for when: at the so-manyth call of a function that keeps or writes."""

CALLS = "calls after the moment:"

_KEEPING = ("tilewise/checkpoint.py", "writing/atomic.py", "runtime/temporary.py")


def main() -> None:
    """Run the program on small tiles, and kill it at its moment, if it has one."""
    tiles.WORTHWHILE_POINTS = 1
    setattr(large, "COMFORTABLE_POINTS", 600)  # noqa: B010
    left = int(os.environ[MOMENT])
    atexit.register(lambda: sys.stdout.write(f"{CALLS} {-left}\n"))

    def count(frame: FrameType, event: str, _: Any) -> None:
        nonlocal left
        if event == "call" and frame.f_code.co_filename.endswith(_KEEPING):
            left -= 1
            if not left:
                os.kill(os.getpid(), signal.SIGKILL)

    sys.setprofile(count)
    program()
