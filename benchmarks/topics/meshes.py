"""Meshes of maps, and their files, beside Open3D and trimesh."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.clouds import plain
from benchmarks.table import Row, Timer, Work
from mlscli.io.writing.obj import write_obj
from mlscli.io.writing.ply import write_ply
from mlscli.maps.surface_map import SurfaceMap
from mlscli.mesh import Mesh, build_mesh

SIDE = 700
# Of so many patches a slow one shows its rate.
SIDE_OF_FEWER = 150

Writer = Callable[[Path], object]


def rows(timer: Timer) -> Iterator[Row]:
    """Yield the rates at which a mesh is built and written; mls waits until files are on disk."""
    surface = plain(SIDE)
    mesh = build_mesh(surface)
    (built,) = timer.rates(surface.size, partial(build_mesh, surface))
    fewer = plain(SIDE_OF_FEWER)
    (delaunay,) = timer.rates(fewer.size, partial(triangulated, fewer))
    what = f"mesh of {surface.size:,} patches"
    yield Row(what, built, "M patches/s", f"scipy's Delaunay of {fewer.size:,}", delaunay, least=8)
    others = _others(mesh)
    with tempfile.TemporaryDirectory() as folder:
        for kind, write in (("ply", write_ply), ("obj", write_obj)):
            mine = partial(write, Path(folder, f"mls.{kind}"), mesh, overwrite=True)
            works: list[Work] = [mine]
            works += [
                partial(writer, Path(folder, f"{name}.{kind}")) for name, writer in others.items()
            ]
            ours, *theirs = timer.rates(len(mesh.vertices), *works)
            what = f"{kind.upper()} of {len(mesh.vertices):,} vertices"
            for name, rate in zip(others, theirs, strict=True):
                times = 1.2 if (kind, name) == ("ply", "trimesh") else None
                yield Row(what, ours, "M vertices/s", name, rate, times)
            sizes = {name: Path(folder, f"{name}.{kind}").stat().st_size for name in others}
            own = Path(folder, f"mls.{kind}").stat().st_size
            for name, size in sizes.items():
                yield Row(f"{what}: on disk", own / 1e6, "MB", name, size / 1e6)


def triangulated(surface: SurfaceMap) -> object:
    """Triangulate the middles of patches in x and y, as one does with a cloud of one level."""
    from scipy.spatial import Delaunay

    return Delaunay(np.column_stack((surface.ix, surface.iy)) * surface.cell_size).simplices


def _others(mesh: Mesh) -> dict[str, Writer]:
    """Return the other writers of vertices, colours and triangles that are installed, by name."""
    others: dict[str, Writer] = {}
    try:
        import open3d
    except ImportError:
        pass
    else:
        utility = open3d.utility
        same = open3d.geometry.TriangleMesh(
            utility.Vector3dVector(mesh.vertices), utility.Vector3iVector(mesh.triangles)
        )
        same.vertex_colors = utility.Vector3dVector(mesh.colours / 255)
        others["Open3D"] = lambda path: open3d.io.write_triangle_mesh(path, same)
    try:
        import trimesh
    except ImportError:
        pass
    else:
        equal = trimesh.Trimesh(
            mesh.vertices, mesh.triangles, vertex_colors=mesh.colours, process=False
        )
        others["trimesh"] = lambda path: equal.export(path)
    return others
