"""Stages that do what no real one does; workers of a cluster import them from here."""

from __future__ import annotations

import os
import signal
import time
from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from mlscli.keyframes.batches import Points
from mlscli.pipeline.stages.stage import Evaluated, PointStage
from mlscli.runtime.arrays import Bool


@dataclass(frozen=True)
class Onlooker(PointStage):
    """Changes nothing."""

    def reach(self, cell_size: float) -> int:  # noqa: ARG002
        return 0

    def evaluate(
        self,
        points: Points,
        cell_size: float,  # noqa: ARG002
        asked: Bool | None = None,  # noqa: ARG002
        progress: Callable[[int], None] | None = None,  # noqa: ARG002
    ) -> Evaluated:
        self.look_at(points)
        return Evaluated(points.xyz, np.zeros(points.size), points.noise)

    @abstractmethod
    def look_at(self, points: Points) -> None:
        """Do what the test is about."""


@dataclass(frozen=True)
class Fatal(Onlooker):
    """Kills the process that it is applied in, as often as there are files left in a folder."""

    name: ClassVar[str] = "fatal"
    folder: str

    def look_at(self, points: Points) -> None:  # noqa: ARG002
        for life in Path(self.folder).iterdir():
            life.unlink(missing_ok=True)
            os.kill(os.getpid(), signal.SIGKILL)


called: list[Callable[[], object]] = []
"""What `Hooked` calls, once each."""


@dataclass(frozen=True)
class Hooked(Onlooker):
    """Calls what a test of the same process left for it, and waits a moment."""

    name: ClassVar[str] = "hooked"

    def look_at(self, points: Points) -> None:  # noqa: ARG002
        while called:
            called.pop()()
            time.sleep(0.5)
