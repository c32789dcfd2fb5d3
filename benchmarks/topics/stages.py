"""Every map stage, by patches: on a plain, where it has nothing to do, and where it has work."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from benchmarks.clouds import CELL, cloud, plain
from benchmarks.table import Row, Timer
from benchmarks.topics.patches import GAP
from mlscli.config import load, loads
from mlscli.maps.grid import Grid
from mlscli.pipeline.grouping import group
from mlscli.pipeline.stages.stage import MapStage

SIDE, SIZE, DENSITY, LEAST = 500, 10**6, 4.0, 30.0


def rows(timer: Timer) -> Iterator[Row]:
    """Yield the rate of each default map stage and of regions; then the least rate.

    Each stage takes what those before it return. The first takes the plain, or the patches of a
    cloud with many gaps and outliers, of whose points three in ten are on a level above.
    """
    stages = [
        stage
        for stage in (
            *load(None, [f"map.cell_size={CELL}"]).pipeline,
            *loads("pipeline: [regions]\n").pipeline,
        )
        if isinstance(stage, MapStage)
    ]
    levels = group(cloud(SIZE, DENSITY), Grid(CELL, GAP, CELL))
    measured = []
    for name, surface in (("a plain", plain(SIDE)), ("levels with gaps", levels)):
        for stage in stages:
            (rate,) = timer.rates(surface.size, partial(stage.apply, surface))
            what = f"{stage.name}, {surface.size:,} patches of {name}"
            measured.append(Row(what, rate, "M patches/s", least=LEAST))
            yield measured[-1]
            surface = stage.apply(surface)
    slowest = min(measured, key=lambda row: row.found)
    yield slowest._replace(what=f"slowest map stage: {slowest.what}", short=True)
