"""What planners read, written of a map of a million patches."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.clouds import plain
from benchmarks.table import Row, Timer
from mlscli.io.writing.nav2 import write_nav2
from mlscli.io.writing.octomap import write_octomap
from mlscli.maps.free_space import FreeSpace
from mlscli.maps.surface_map import SurfaceMap
from mlscli.runtime.arrays import Int32

SIDE, FREE_ABOVE = 1000, 4


def rows(timer: Timer) -> Iterator[Row]:
    """Yield how long the writers take, from a map in memory until the files are on disk."""
    surface = plain(SIDE)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "map.yaml")
        (seconds,) = timer.seconds(partial(write_nav2, path, surface, overwrite=True))
        yield Row(f"nav2 of {surface.size:,} patches", seconds, "s", most=2)
        for held in (surface, replace(surface, free=_above(surface))):
            what = f"octomap of {held.size:,} patches"
            what += "" if held.free is None else f", {held.free.size:,} free voxels"
            (seconds,) = timer.seconds(partial(write_octomap, path, held, overwrite=True))
            yield Row(what, seconds, "s", most=2)


def _above(surface: SurfaceMap) -> FreeSpace:
    """Return free space of some voxels above each patch."""
    cells = surface.cells
    first = np.floor(surface.height / surface.cell_size * 2)[:, None] + 1
    iz: Int32 = (first + np.arange(FREE_ABOVE)).ravel().astype(np.int32)
    start = np.arange(len(cells.ix) + 1, dtype=np.int64) * FREE_ABOVE
    return FreeSpace(cells.ix, cells.iy, start, iz, np.full(len(iz), 9, np.uint8))
