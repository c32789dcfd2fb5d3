"""Every map stage, in patches: on a plain where it finds nothing to do, and where it has work."""

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
    """Yield rates for each map stage of the defaults, and for regions; then the least.

    Each is given what those before leave: the plain, or the patches of a cloud in which a third of
    the points are a level above, many gaps and many outliers.
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
