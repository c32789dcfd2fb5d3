"""Levels, heights and free space of many places at once, and the clearance along a way."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from benchmarks.clouds import plain
from benchmarks.table import Row, Timer
from mlscli.maps.free_space import FreeSpace
from mlscli.maps.space import space_at
from mlscli.maps.surface_map import SurfaceMap
from mlscli.queries.clearance import clearance
from mlscli.queries.levels import height_at, levels_at

SIDE, PLACES, LANES = 1000, 10**6, 9
# So many voxels are seen through above each cell.
HIGH = 24


def rows(timer: Timer) -> Iterator[Row]:
    """Yield the rates at which places anywhere on a map are asked for, and a way is flown."""
    surface = plain(SIDE)
    side = SIDE * surface.cell_size
    places = np.random.default_rng(1).uniform(0, side, (PLACES, 2))
    works = (partial(height_at, surface, places), partial(levels_at, surface, places))
    rates = timer.rates(PLACES, *works)
    for name, rate in zip(("heights", "levels"), rates, strict=True):
        what = f"{name} of {PLACES:,} places, {surface.size:,} patches"
        yield Row(what, rate, "M places/s", least=1)
    seen = replace(surface, free=_seen(surface))
    at = np.column_stack((places, np.random.default_rng(2).uniform(0, 2, PLACES)))
    (rate,) = timer.rates(PLACES, partial(space_at, seen, at))
    yield Row(
        f"free space of {PLACES:,} places, {surface.size:,} cells", rate, "M places/s", least=1
    )
    y = np.linspace(0.1, 0.9, LANES) * side
    x = np.where(np.arange(LANES) % 2, 0.9, 0.1) * side
    way = np.column_stack((x, y, np.full(LANES, 1.0)))
    length = np.linalg.norm(np.diff(way, axis=0), axis=1).sum()
    craft = 5 * surface.cell_size
    (seconds,) = timer.seconds(partial(clearance, seen, way, craft, craft))
    what = (
        f"clearance along {length:,.0f}, {length / surface.cell_size:,.0f} cells, a craft of 5 x 5"
    )
    yield Row(what, seconds * 1e3, "ms", most=100)


def _seen(surface: SurfaceMap) -> FreeSpace:
    """Return free space above the ground of all cells."""
    cells = surface.cells
    count = len(cells.ix)
    return FreeSpace(
        cells.ix,
        cells.iy,
        np.arange(count + 1) * HIGH,
        np.tile(np.arange(HIGH, dtype=np.int32), count),
        np.full(count * HIGH, 3, dtype=np.uint8),
    )
