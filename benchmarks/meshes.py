"""Time the PLY and OBJ writers on a mesh of a million vertices: ``python benchmarks/meshes.py``.

The mesh is a hilly plain, built from its map; the times are the best of five, with the disk's
share, as files are forced to it before they take their name.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import click
import numpy as np

from mlscli.io.obj import write_obj
from mlscli.io.ply import write_ply
from mlscli.mesh import Mesh, build_mesh
from mlscli.surface_map import COLUMNS, SurfaceMap


def plain(side: int) -> SurfaceMap:
    """Return a map of side x side measured patches whose heights all differ."""
    size = side * side
    ix, iy = np.divmod(np.arange(size), side)
    height = 3 * np.sin(ix / 50) * np.cos(iy / 70) + np.random.default_rng(1).normal(0, 0.02, size)
    columns: dict[str, Any] = {name: np.zeros(size, dtype) for name, dtype in COLUMNS.items()}
    columns |= {"ix": ix.astype(np.int32), "iy": iy.astype(np.int32), "height": height}
    columns |= {"top": height, "bottom": height, "mean": height}
    columns["count"][:] = 1
    return SurfaceMap(0.15, 0.5, 0.15, **columns, route=np.full((1, 4), np.nan))


def best(work: Callable[[], object]) -> float:
    """Return the least wall time (s) of five calls."""
    times = []
    for _ in range(5):
        begin = time.perf_counter()
        work()
        times.append(time.perf_counter() - begin)
    return min(times)


def main() -> None:
    """Build the mesh, write it in both formats, and print the times."""
    surface = plain(1000)
    mesh: Mesh = build_mesh(surface)
    click.echo(f"{len(mesh.vertices)} vertices, {len(mesh.triangles)} triangles")
    click.echo(f"build_mesh {best(lambda: build_mesh(surface)):.3f} s")
    with tempfile.TemporaryDirectory() as folder:
        for write in (write_ply, write_obj):
            path = Path(folder, f"mesh.{write.__name__[-3:]}")
            seconds = best(partial(write, path, mesh, overwrite=True))
            click.echo(f"{write.__name__} {seconds:.3f} s, {path.stat().st_size / 1e6:.0f} MB")


if __name__ == "__main__":
    main()
