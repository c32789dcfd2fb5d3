"""The clouds and the map that benchmarks use."""

from __future__ import annotations

from typing import Any

import numpy as np

from mlscli.keyframes.batches import Points
from mlscli.maps.columns import COLUMNS
from mlscli.maps.surface_map import SurfaceMap

CELL = 0.15


def cloud(size: int, density: float) -> Points:
    """Return points of hills, three in ten of them on a level above, one in ten an outlier.

    Parameters
    ----------
    size : int
        How many points there are.
    density : float
        How many of them a cell of size `CELL` holds, on average.
    """
    rng = np.random.default_rng(1)
    xy = rng.uniform(0, np.sqrt(size / density) * CELL, (size, 2))
    z = 3 * np.sin(xy[:, 0] / 7) * np.cos(xy[:, 1] / 9) + rng.normal(0, CELL / 3, size)
    z += np.where(rng.random(size) < 0.3, 2.5, 0.0)
    z += np.where(rng.random(size) < 0.1, rng.normal(0, 5 * CELL / 3, size), 0.0)
    return Points.of(np.column_stack((xy, z)), np.zeros(size, dtype=np.int32))


def plain(side: int) -> SurfaceMap:
    """Return a map of `side` by `side` cells, each with a measured patch of another height."""
    size = side * side
    ix, iy = np.divmod(np.arange(size), side)
    height = 3 * np.sin(ix / 50) * np.cos(iy / 70) + np.random.default_rng(1).normal(0, 0.02, size)
    columns: dict[str, Any] = {name: np.zeros(size, dtype) for name, dtype in COLUMNS.items()}
    columns |= {"ix": ix.astype(np.int32), "iy": iy.astype(np.int32), "height": height}
    columns |= {"top": height, "bottom": height, "mean": height}
    columns["count"][:] = 1
    return SurfaceMap(CELL, 0.5, CELL, **columns, route=np.full((1, 4), np.nan))
