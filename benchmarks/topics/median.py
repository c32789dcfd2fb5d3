"""The median filter, beside neighbour searches that a user would build it from."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from benchmarks.clouds import CELL, cloud
from benchmarks.table import Row, Timer, Work
from mlscli.pipeline.stages.median import Median
from mlscli.runtime.arrays import Float64

RADIUS, NEAREST, LEAST = 0.45, 16, 8
MEDIAN = Median(RADIUS, NEAREST, LEAST)


def rows(timer: Timer) -> Iterator[Row]:
    """Yield rates by the number of points and their density."""
    for size, density in ((10**5, 4.0), (10**6, 4.0), (10**5, 200.0)):
        points = cloud(size, density)
        by_cell = points.xyz[np.lexsort(np.floor(points.xyz[:, :2] / CELL).T)]
        works: list[Work] = [partial(MEDIAN.apply, points, CELL), partial(tree_median, by_cell)]
        removal = _outlier_removal(by_cell)
        works += [] if removal is None else [removal]
        ours, tree, *open3d = timer.rates(size, *works)
        what = f"median, {size:,} points, {density:g} a cell"
        dense = density > 100
        by_tree, by_open3d = (3.0, 2.0) if dense else (6.0, 4.0)
        yield Row(what, ours, "M points/s", "cKDTree + numpy", tree, by_tree, short=not dense)
        if open3d:
            yield Row(what, ours, "M points/s", "Open3D's outlier removal", open3d[0], by_open3d)


def tree_median(xyz: Float64) -> Float64:
    """Return median heights by cKDTree and numpy, of points (N, 3) sorted by cell."""
    from scipy.spatial import cKDTree

    distances, near = cKDTree(xyz).query(
        xyz, NEAREST + 1, distance_upper_bound=np.nextafter(RADIUS, np.inf), workers=2
    )
    heights = np.sort(np.append(xyz[:, 2], np.inf)[near], axis=1)
    found = np.isfinite(distances).sum(axis=1)
    return np.asarray(heights[np.arange(len(xyz)), found // 2][found > LEAST])


def _outlier_removal(xyz: Float64) -> Work | None:
    """Return Open3D's statistical outlier removal, as many neighbours; None if not installed."""
    try:
        import open3d
    except ImportError:
        return None
    points = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(xyz))
    return partial(points.remove_statistical_outlier, NEAREST, 2.0)
