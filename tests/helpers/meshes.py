"""Maps to make meshes of, meshes taken apart, and the programs that read them back."""

from __future__ import annotations

import warnings
from collections import defaultdict
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest

from mlscli.maps.surface_map import SurfaceMap
from mlscli.mesh import Mesh
from mlscli.runtime.arrays import Array, Float64
from tests.helpers.maps import Patch, map_of

Column = tuple[int, int, float, float]


def a_map(*columns: Column, cell_size: float = 1.0) -> SurfaceMap:
    """Return a map of measured patches (ix, iy, height, depth)."""
    patches = [Patch(ix, iy, float(z), float(depth), 0, 1) for ix, iy, z, depth in columns]
    return map_of(patches, cell_size=cell_size)


def plane(width: int, length: int, height: float = 0.0) -> list[Column]:
    return [(x, y, height, 0.0) for x, y in product(range(width), range(length))]


def house() -> SurfaceMap:
    """Return a floor with a room on it, its walls pieced together, of all origins, and a route."""
    patches = []
    for x, y in product(range(-4, 7), range(-3, 6)):
        z = 0.1 * np.sin(3 * x + y)
        is_wall = (x in (0, 4) and 0 <= y <= 3) or (y in (0, 3) and 0 <= x <= 4)
        if not is_wall:
            patches.append(Patch(x, y, z, 0.0, int(x > 5), int(x <= 5)))
        elif x == 2:
            for top, depth, origin in ((1.0, 1.0, 0), (2.0, 1.0, 2), (3.0, 1.0, 0)):
                patches.append(Patch(x, y, top, depth, origin, int(origin == 0)))
        else:
            patches.append(Patch(x, y, 3 + z / 7, 3.0, 0, 5))
    patches += [Patch(20, 2, 5.1, 0.0, 0, 1), Patch(24, 2, 4.3, 2.1, 0, 1)]
    route = [(t, 0.3 * t - 1, 0.7 - 0.1 * t, 6.0) for t in range(7)]
    return replace(map_of(patches, cell_size=0.3), route=np.array(route))


def soup(vertices: Array, triangles: Array) -> list[tuple[float, ...]]:
    """Return the triangles by their corners' coordinates, whatever the order and numbering."""
    corners = np.asarray(vertices, dtype=np.float64)[np.asarray(triangles)]
    turned = [sorted(map(tuple, triangle.tolist())) for triangle in corners]
    return sorted(sum(triangle, ()) for triangle in turned)


def areas(mesh: Mesh) -> Float64:
    a, b, c = np.moveaxis(mesh.vertices[mesh.triangles], 1, 0)
    area: Float64 = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    return area


def open3d() -> Any:
    """Return the open3d package, or skip where it or a system library of it is missing."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            import open3d
        except (ImportError, OSError) as error:
            pytest.skip(f"open3d cannot be imported: {error}")
    return open3d


def shared_edges(mesh: Mesh) -> list[list[int]]:
    """Return for each edge the directions, 1 or -1, in which triangles run through it."""
    return list(shared_edges_of(mesh).values())


def shared_edges_of(mesh: Mesh) -> dict[tuple[int, int], list[int]]:
    """Return the directions, 1 or -1, in which triangles run through each edge, by its ends."""
    found = defaultdict[tuple[int, int], list[int]](list)
    for corners in mesh.triangles.tolist():
        for i in range(3):
            begin, end = corners[i], corners[(i + 1) % 3]
            found[min(begin, end), max(begin, end)].append(1 if begin < end else -1)
    return found
