"""Meshes of points as a user would make them with other programs.

All but the voxels begin with Open3D's statistical outlier removal, with the values of its tutorial:
20 neighbours, 2 standard deviations. Lengths follow from the cell of the points that are given
(`benchmarks.scans.cell_of`). Of several values tried on seed 1 of `benchmarks/real.py`, those here
have the best F-scores in the mean.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from mlscli.mesh import Mesh
from mlscli.runtime.arrays import Array, Float64, Int64

NORMALS_FROM = 16
ALPHA = 0.75
RADII = (0.5, 0.75, 1.0, 1.5)
POISSON_CELL = 0.5
# Poisson's surface is closed: what lies farther than this from all points is taken away.
POISSON_TRIM = 1.0
LONGEST_EDGE = 2.0

# Corners of the faces of a voxel, by axis: least side and greatest side.
_SQUARE = np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
_TWO_TRIANGLES = np.array([(0, 1, 2), (0, 2, 3)])


def mesh(vertices: Array, triangles: Array) -> Mesh:
    """Return a mesh of vertices (V, 3) and triangles (T, 3), all of them measured."""
    size = len(vertices)
    return Mesh(
        vertices=np.asarray(vertices, dtype=np.float64).reshape(-1, 3),
        colours=np.zeros((size, 3), dtype=np.uint8),
        origin=np.zeros(size, dtype=np.uint8),
        triangles=np.asarray(triangles, dtype=np.int32).reshape(-1, 3),
        lines=np.empty((0, 2), dtype=np.int32),
        points=np.empty(0, dtype=np.int32),
        patch=np.zeros(size, dtype=np.int32),
    )


def _filtered(points: Float64) -> Any:
    """Return Open3D's cloud of points without outliers."""
    import open3d

    open3d.utility.set_verbosity_level(open3d.utility.VerbosityLevel.Error)
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
    return cloud.remove_statistical_outlier(nb_neighbors=20, std_ratio=2.0)[0]


def _with_normals(points: Float64) -> Any:
    import open3d

    cloud = _filtered(points)
    cloud.estimate_normals(open3d.geometry.KDTreeSearchParamKNN(NORMALS_FROM))
    cloud.orient_normals_consistent_tangent_plane(NORMALS_FROM)
    return cloud


def _of(made: Any, middle: Float64) -> Mesh:
    return mesh(np.asarray(made.vertices).reshape(-1, 3) + middle, np.asarray(made.triangles))


def poisson(points: Float64, cell: float) -> Mesh:
    """Return Open3D's Poisson surface, its voxels half a cell wide, cut one cell from the points.

    Kazhdan, Hoppe, Screened Poisson surface reconstruction, 2013, doi:10.1145/2487228.2487237.
    """
    import open3d
    from scipy.spatial import cKDTree

    middle = points.mean(axis=0)
    cloud = _with_normals(points - middle)
    kept = np.asarray(cloud.points)
    # Open3D reconstructs in a cube 1.1 times as wide as the cloud.
    width = 1.1 * np.ptp(kept, axis=0).max()
    depth = math.ceil(math.log2(width / (POISSON_CELL * cell)))
    make = open3d.geometry.TriangleMesh.create_from_point_cloud_poisson
    # With several threads, each run makes another surface.
    made, _ = make(cloud, depth=depth, n_threads=1)
    apart, _ = cKDTree(kept).query(np.asarray(made.vertices))
    made.remove_vertices_by_mask(apart > POISSON_TRIM * cell)
    return _of(made, middle)


def alpha_shape(points: Float64, cell: float) -> Mesh:
    """Return Open3D's alpha shape, alpha three quarters of a cell."""
    import open3d

    middle = points.mean(axis=0)
    make = open3d.geometry.TriangleMesh.create_from_point_cloud_alpha_shape
    return _of(make(_filtered(points - middle), ALPHA * cell), middle)


def ball_pivoting(points: Float64, cell: float) -> Mesh:
    """Return Open3D's ball pivoting, with balls of half a cell to one and a half.

    Bernardini et al., The ball-pivoting algorithm, 1999, doi:10.1109/2945.817351.
    """
    import open3d

    middle = points.mean(axis=0)
    make = open3d.geometry.TriangleMesh.create_from_point_cloud_ball_pivoting
    radii = open3d.utility.DoubleVector([radius * cell for radius in RADII])
    return _of(make(_with_normals(points - middle), radii), middle)


def delaunay(points: Float64, cell: float) -> Mesh:
    """Return the Delaunay triangulation in x and y, without edges longer than two cells there."""
    from scipy.spatial import Delaunay

    middle = points.mean(axis=0)
    kept = np.asarray(_filtered(points - middle).points)
    triangles = Delaunay(kept[:, :2]).simplices
    corners = kept[triangles, :2]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    return mesh(kept + middle, triangles[longest <= LONGEST_EDGE * cell])


def voxels(points: Float64, cell: float) -> Mesh:
    """Return the outer faces of the voxels, a cell wide, that hold a point.

    As OctoMap has them by default, where one hit makes a voxel occupied: Hornung et al., 2013,
    doi:10.1007/s10514-012-9321-0. What rays have freed is not known here.
    """
    held: Int64 = np.unique(np.floor(points / cell).astype(np.int64), axis=0)
    known = {tuple(voxel) for voxel in held.tolist()}
    faces = []
    for axis in range(3):
        for side in (0, 1):
            step = np.zeros(3, dtype=np.int64)
            step[axis] = 2 * side - 1
            is_outer = [tuple(beyond) not in known for beyond in (held + step).tolist()]
            corners = np.full((4, 3), side)
            corners[:, np.arange(3) != axis] = _SQUARE
            faces.append(held[is_outer][:, None] + corners)
    corners = np.concatenate(faces)
    first = 4 * np.arange(len(corners))[:, None, None]
    return mesh(corners.reshape(-1, 3) * cell, (first + _TWO_TRIANGLES).reshape(-1, 3))


INSTEAD: dict[str, Callable[[Float64, float], Mesh]] = {
    "Poisson": poisson,
    "alpha shape": alpha_shape,
    "ball pivoting": ball_pivoting,
    "2.5D Delaunay": delaunay,
    "voxels": voxels,
}
