"""Every map stage, by patches: on a plain, where it has nothing to do, and where it has work."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from benchmarks.clouds import CELL, cloud, plain
from benchmarks.table import Row, Timer, Work
from benchmarks.topics.patches import GAP
from mlscli.config import load, loads
from mlscli.maps.grid import Grid
from mlscli.maps.surface_map import SurfaceMap
from mlscli.pipeline.grouping import group
from mlscli.pipeline.stages.stage import MapStage
from mlscli.runtime.arrays import Float64

SIDE, SIZE, DENSITY, LEAST = 500, 10**6, 4.0, 30.0
GAPPY = "levels with gaps"
LEAST_OF_GAPS = {"plaster": 20.0, "walls": 20.0}
# As far from a cell lies the middle of the widest gap that the default plaster closes.
HALF_GAP = 2.5


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
    for name, surface in (("a plain", plain(SIDE)), (GAPPY, levels)):
        for stage in stages:
            least = LEAST_OF_GAPS.get(stage.name, LEAST) if name == GAPPY else LEAST
            works: list[Work] = [partial(stage.apply, surface)]
            instead = ""
            if stage.name == "plaster":
                works.append(partial(nearest_filled, surface, HALF_GAP))
                instead = "scipy's distance transform, one level"
            rate, *others = timer.rates(surface.size, *works)
            what = f"{stage.name}, {surface.size:,} patches of {name}"
            other = others[0] if others else None
            measured.append(Row(what, rate, "M patches/s", instead, other, least=least))
            yield measured[-1]
            surface = stage.apply(surface)
    slowest = min(measured, key=lambda row: row.found)
    what = f"slowest map stage: {slowest.what}"
    yield Row(what, slowest.found, slowest.unit, least=slowest.least, short=True)


def nearest_filled(surface: SurfaceMap, reach: float) -> Float64:
    """Return the tops of a map as an array by cell, gaps of up to twice `reach` cells filled.

    Each takes the height of the nearest cell, as one fills an elevation map by scipy; a map of
    several levels is flattened.
    """
    from scipy.ndimage import distance_transform_edt

    ix, iy = surface.ix - surface.ix.min(), surface.iy - surface.iy.min()
    heights = np.full((int(ix.max()) + 1, int(iy.max()) + 1), np.nan)
    heights[ix, iy] = surface.height
    empty = np.isnan(heights)
    distances, near = distance_transform_edt(empty, return_indices=True)
    fillable = empty & (distances <= reach)
    heights[fillable] = heights[tuple(near[:, fillable])]
    return heights
