"""What planners read, written of a map of a million patches."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path

from benchmarks.clouds import plain
from benchmarks.table import Row, Timer
from mlscli.io.writing.nav2 import write_nav2

SIDE = 1000


def rows(timer: Timer) -> Iterator[Row]:
    """Yield how long the writers take, from a map in memory until the files are on disk."""
    surface = plain(SIDE)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "map.yaml")
        (seconds,) = timer.seconds(partial(write_nav2, path, surface, overwrite=True))
        yield Row(f"nav2 of {surface.size:,} patches", seconds, "s", most=2)
