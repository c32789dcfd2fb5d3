"""Levels and heights of many places at once."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from benchmarks.clouds import plain
from benchmarks.table import Row, Timer
from mlscli.queries.levels import height_at, levels_at

SIDE, PLACES = 1000, 10**6


def rows(timer: Timer) -> Iterator[Row]:
    """Yield the rates at which places that lie anywhere on a map are asked for."""
    surface = plain(SIDE)
    side = SIDE * surface.cell_size
    places = np.random.default_rng(1).uniform(0, side, (PLACES, 2))
    works = (partial(height_at, surface, places), partial(levels_at, surface, places))
    rates = timer.rates(PLACES, *works)
    for name, rate in zip(("heights", "levels"), rates, strict=True):
        what = f"{name} of {PLACES:,} places, {surface.size:,} patches"
        yield Row(what, rate, "M places/s", least=1)
