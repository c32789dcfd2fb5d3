"""Every map stage, in patches."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from benchmarks.clouds import CELL
from benchmarks.meshes import plain
from benchmarks.table import Row, Timer
from mlscli.config import load, loads
from mlscli.pipeline.stage import MapStage

SIDE, LEAST = 500, 30.0


def rows(timer: Timer) -> Iterator[Row]:
    """Yield a rate for each map stage of the defaults, and for regions; then the least."""
    surface = plain(SIDE)
    stages = load(None, [f"map.cell_size={CELL}"]).pipeline
    measured = []
    for stage in (*stages, *loads("pipeline: [regions]\n").pipeline):
        if isinstance(stage, MapStage):
            (rate,) = timer.rates(surface.size, partial(stage.apply, surface))
            what = f"{stage.name}, {surface.size:,} patches"
            measured.append(Row(what, rate, "M patches/s", least=LEAST))
            yield measured[-1]
    slowest = min(measured, key=lambda row: row.found)
    yield slowest._replace(what=f"slowest map stage: {slowest.what}", short=True)
