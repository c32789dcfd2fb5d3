"""Meshes as PLY: binary little-endian, coordinates in float64.

Vertices have ``x y z`` (double), ``red green blue`` (uchar) and ``origin`` (int): 0 measured,
1 plastered, 2 artificial, 3 the route. Triangles are the element ``face``, lines the element
``edge``; a vertex that neither uses is a point.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from mlscli.errors import OutputError
from mlscli.io.writing.atomic import atomic_write, refuse_existing
from mlscli.runtime.arrays import Array

if TYPE_CHECKING:
    from mlscli.maps.surface_map import SurfaceMap
from mlscli.mesh import Mesh, mesh_of

# Face and edge elements count vertices in int32.
MAX_PLY_VERTICES = 2**31 - 1

# Numbers that stand together are moved as one, in a third of the time.
VERTEX = np.dtype([("xyz", "V24"), ("rgb", "V3"), ("origin", "<i4")])
FACE = np.dtype([("corners", "u1"), ("vertices", "V12")])
EDGE = np.dtype([("vertices", "V8")])

_NUMBERS = {"xyz": "<f8", "rgb": "u1", "vertices": "<i4"}

# Records that are made at a time: they stay in the cache until they are written.
_BLOCK = 1 << 14


def write_ply(
    path: str | os.PathLike[str], mesh: Mesh | SurfaceMap, *, overwrite: bool = False
) -> None:
    """Write a mesh as PLY, whole or not at all.

    Parameters
    ----------
    path
    mesh : Mesh or SurfaceMap
        Of a map, the mesh that `build_mesh` makes by default is written.
    overwrite : bool

    Raises
    ------
    TypeError
        It is neither a mesh nor a map.
    OutputError
        Where the file exists and `overwrite` is False, it cannot be written, or the mesh has
        more vertices than PLY's int can number.
    """
    mesh = mesh_of(mesh)
    refuse_existing(path, overwrite=overwrite)
    if len(mesh.vertices) > MAX_PLY_VERTICES:
        raise OutputError(
            f"{os.fspath(path)}: the mesh has {len(mesh.vertices)} vertices; "
            f"a PLY file numbers at most {MAX_PLY_VERTICES}"
        )
    with atomic_write(path, overwrite=overwrite) as stream:
        stream.write(_header(mesh).encode("ascii"))
        for records in _elements(mesh):
            stream.write(records.view(np.uint8).data)


def _header(mesh: Mesh) -> str:
    lines = [
        "ply",
        "format binary_little_endian 1.0",
        f"element vertex {len(mesh.vertices)}",
        *(f"property double {axis}" for axis in "xyz"),
        *(f"property uchar {colour}" for colour in ("red", "green", "blue")),
        "property int origin",
        f"element face {len(mesh.triangles)}",
        "property list uchar int vertex_indices",
        f"element edge {len(mesh.lines)}",
        "property int vertex1",
        "property int vertex2",
        "end_header",
    ]
    return "\n".join(lines) + "\n"


def _elements(mesh: Mesh) -> Iterator[Array]:
    """Yield the records of each element, in the order of the header, a block at a time."""
    yield from _records(VERTEX, {"xyz": mesh.vertices, "rgb": mesh.colours, "origin": mesh.origin})
    yield from _records(FACE, {"corners": np.array(3), "vertices": mesh.triangles})
    yield from _records(EDGE, {"vertices": mesh.lines})


def _records(dtype: np.dtype[np.void], columns: Mapping[str, Array]) -> Iterator[Array]:
    """Yield records of columns; one without rows is the same in all."""
    size = max(len(column) for column in columns.values() if column.ndim)
    for begin in range(0, size, _BLOCK):
        records = np.empty(min(_BLOCK, size - begin), dtype)
        for name, column in columns.items():
            some = column[begin : begin + _BLOCK] if column.ndim else column
            if column.ndim == 2:
                number = _NUMBERS[name]
                some = np.ascontiguousarray(some, dtype=number).view(dtype[name])[:, 0]
            records[name] = some
        yield records
