"""Points into patches, beside sorts by numpy and the maps of other libraries."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from benchmarks.clouds import CELL, cloud
from benchmarks.table import Row, Timer, Work
from mlscli.maps.grid import Grid
from mlscli.pipeline.grouping import group
from mlscli.runtime.arrays import Float64, Int64

GAP = 3 * CELL
SIZE = 10**6
# Points a cell, and how many times as fast as numpy's packed key it is to be.
LEVELS = {1.5: 4.0, 4.0: 5.0, 40.0: 3.0}


def rows(timer: Timer) -> Iterator[Row]:
    """Yield rates by the points' density; slow alternatives are tried with one density only."""
    for density, times in LEVELS.items():
        points = cloud(SIZE, density)
        works: dict[str, Work] = {"numpy's packed key": partial(packed_groups, points.xyz)}
        missing = []
        if density == 4.0:
            works["lexsort"] = partial(lexsorted, points.xyz)
            for name, found in (("Open3D", _voxels(points.xyz)), ("OctoMap", _octomap(points.xyz))):
                if found is None:
                    missing.append(name)
                else:
                    works[found[0]] = found[1]
        mine = partial(group, points, Grid(CELL, GAP, CELL))
        ours, *others = timer.rates(SIZE, mine, *works.values())
        what = f"patches of {SIZE:,} points, {density:g} a cell"
        for instead, other in zip(works, others, strict=True):
            if "packed" in instead:
                short = density == 4.0
                yield Row(what, ours, "M points/s", instead, other, times, 25.0, short=short)
            else:
                yield Row(what, ours, "M points/s", instead, other)
        for name in missing:
            yield Row(what, ours, "M points/s", f"{name} is not installed: pip install '.[bench]'")


def packed_groups(xyz: Float64) -> tuple[Float64, Float64, Float64]:
    """Return top, mean and variance of patches, (P,) each, by numpy's argsort of a packed key."""
    cells, z = np.floor(xyz[:, :2] / CELL).astype(np.int64), xyz[:, 2]
    cells -= cells.min(axis=0)
    rough = ((z - z.min()) * ((2**20 - 1) / np.ptp(z))).astype(np.int64)
    keys = cells[:, 0] << 42 | cells[:, 1] << 20 | rough
    return _summed(keys >> 20, z, np.argsort(keys))


def lexsorted(xyz: Float64) -> tuple[Float64, Float64, Float64]:
    """Return the same as `packed_groups`, by numpy's lexsort of cells and heights."""
    cells, z = np.floor(xyz[:, :2] / CELL).astype(np.int64), xyz[:, 2]
    order = np.lexsort((z, cells[:, 1], cells[:, 0]))
    cells -= cells.min(axis=0)
    return _summed(cells[:, 0] << 22 | cells[:, 1], z, order)


def _summed(cells: Int64, z: Float64, order: Int64) -> tuple[Float64, Float64, Float64]:
    """Return top, mean and variance of patches, given keys of cells, heights, and their order."""
    cells, z = cells[order], z[order]
    start = np.flatnonzero(np.r_[True, (cells[1:] != cells[:-1]) | (np.diff(z) > GAP)])
    count = np.diff(np.append(start, len(z)))
    mean = z[start] + np.add.reduceat(z - z[start].repeat(count), start) / count
    variance = np.add.reduceat((z - mean.repeat(count)) ** 2, start) / count
    return z[start + count - 1], mean, variance


def _voxels(xyz: Float64) -> tuple[str, Work] | None:
    """Return the name and work of Open3D's voxel grid of mean points; None if not installed."""
    try:
        import open3d
    except ImportError:
        return None
    points = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(xyz))
    return "Open3D's voxel grid", partial(points.voxel_down_sample, CELL)


def _octomap(xyz: Float64) -> tuple[str, Work] | None:
    """Return OctoMap's insertion of end points, no rays, and its name; None if not installed."""
    try:
        from pyoctomap import OcTree
    except ImportError:
        return None

    def insert() -> None:
        tree = OcTree(CELL)
        tree.updateNodes(xyz, True, lazy_eval=True)
        tree.updateInnerOccupancy()

    return "OctoMap, end points", insert
