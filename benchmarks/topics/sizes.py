"""`cell_size: auto`, beside the median filter and what a user would ask of scipy's tree."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from benchmarks.clouds import CELL, cloud
from benchmarks.table import Row, Timer
from benchmarks.topics.median import MEDIAN
from mlscli.building.sizes import auto_cell_size
from mlscli.geometry.spacing import NEIGHBOUR
from mlscli.runtime.arrays import Float64

SIZE = 10**6


def rows(timer: Timer) -> Iterator[Row]:
    """Yield how fast the size of cells is found, and for what share of the median's time."""
    points = cloud(SIZE, 4.0)
    found, median, tree = timer.seconds(
        partial(auto_cell_size, points.xyz),
        partial(MEDIAN.apply, points, CELL),
        partial(tree_size, points.xyz),
    )
    what = f"cell_size: auto, {SIZE:,} points"
    yield Row(what, SIZE / found / 1e6, "M points/s", "cKDTree + numpy", SIZE / tree / 1e6)
    yield Row(f"{what}: times the median filter of them", found / median, "", most=0.1)


def tree_size(xyz: Float64) -> float:
    """Return twice the median distance of points (N, 3) to their fourth neighbour, by cKDTree."""
    from scipy.spatial import cKDTree

    distances, _ = cKDTree(xyz).query(xyz, [NEIGHBOUR + 1], workers=2)
    return 2 * float(np.median(distances))
