"""Meshes as OBJ, in full precision, with groups and the materials of an `.mtl` beside it.

Coordinates are written with the fewest digits that read back exactly. The colour of a vertex
follows its coordinates, red, green and blue from 0 to 1, as MeshLab and CloudCompare read it;
programs that ignore it have a material for each group: measured, plastered, artificial and
route. A triangle, line or point is in the group of its least certain vertex.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mlscli.errors import OutputError, expect_path
from mlscli.io.writing.atomic import atomic_write, refuse_existing
from mlscli.runtime.arrays import Array, Float64, UInt8

if TYPE_CHECKING:
    from mlscli.maps.surface_map import SurfaceMap
from mlscli.mesh import Mesh, mesh_of

# Vertices are numbered from 1, and readers keep the numbers in int32.
MAX_OBJ_VERTICES = 2**31 - 1

# Lines formatted at a time, to bound memory.
CHUNK = 2**18


def write_obj(
    path: str | os.PathLike[str], mesh: Mesh | SurfaceMap, *, overwrite: bool = False
) -> None:
    """Write a mesh as OBJ and its materials beside it, both whole or neither.

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
        Where one of the files exists and `overwrite` is False, or cannot be written; the name of
        the materials cannot stand in an OBJ file, or is that of the mesh; or the mesh has too
        many vertices.
    """
    expect_path(path, "path", "the file to write")
    mesh = mesh_of(mesh)
    target = Path(path)
    materials = materials_beside(target)
    for file in (target, materials):
        refuse_existing(file, overwrite=overwrite)
    if len(mesh.vertices) > MAX_OBJ_VERTICES:
        raise OutputError(
            f"{target}: the mesh has {len(mesh.vertices)} vertices; "
            f"an OBJ file numbers at most {MAX_OBJ_VERTICES}"
        )
    before = materials.read_bytes() if materials.exists() else None
    written = False
    try:
        with atomic_write(target, overwrite=overwrite) as stream:
            stream.write(b"mtllib " + os.fsencode(materials.name) + b"\n")
            for lines in _lines(mesh):
                stream.write(lines)
            # The materials come last, so that hardly anything can still go wrong between the two.
            with atomic_write(materials, overwrite=overwrite) as material_stream:
                material_stream.write(_materials().encode("ascii"))
            written = True
    except BaseException:
        if written and before is None:
            materials.unlink(missing_ok=True)
        elif written and before is not None:
            materials.write_bytes(before)
        raise


def materials_beside(target: Path) -> Path:
    """Return the file of materials that belongs to an OBJ file.

    Raises
    ------
    OutputError
        Where its name cannot stand in an OBJ file, or is that of the mesh.
    """
    materials = target.with_suffix(".mtl")
    if materials == target:
        raise OutputError(f"{target}: is the name for the materials; end the mesh's in .obj")
    if any(character.isspace() and character != " " for character in materials.name):
        raise OutputError(f"{target}: an OBJ file cannot name {materials.name!r}; rename it")
    return materials


def _materials() -> str:
    """Return the materials: a colour for each group."""
    from mlscli.mesh import GROUPS
    from mlscli.mesh.colours import ARTIFICIAL_RED, ROUTE_GREEN, WHITE, height_scale

    measured = height_scale()[len(height_scale()) // 2]
    plastered = (measured.astype(np.uint16) + WHITE) // 2
    lines = []
    for name, colour in zip(
        GROUPS, (measured, plastered, ARTIFICIAL_RED, ROUTE_GREEN), strict=True
    ):
        diffuse = " ".join(_channel(int(value)) for value in colour)
        lines += [f"newmtl {name}", f"Kd {diffuse}", "Ka 0 0 0", "Ks 0 0 0", "illum 1", ""]
    return "\n".join(lines)


def _lines(mesh: Mesh) -> Iterator[bytes]:
    from mlscli.mesh import GROUPS

    yield from _records(b"v", [*_coordinates(mesh.vertices), *_channels(mesh.colours)])
    number = _texts(list(range(1, len(mesh.vertices) + 1)))
    elements = [
        (keyword, indices, mesh.group(indices))
        for keyword, indices in (
            (b"f", mesh.triangles),
            (b"l", mesh.lines),
            (b"p", mesh.points[:, None]),
        )
    ]
    for group, name in enumerate(GROUPS):
        if any((groups == group).any() for _, _, groups in elements):
            yield f"g {name}\nusemtl {name}\n".encode("ascii")
        for keyword, indices, groups in elements:
            columns = indices[groups == group].T
            yield from _records(keyword, [(number, column) for column in columns])


def _coordinates(vertices: Float64) -> Iterator[tuple[Array, Array]]:
    """Yield for each axis the distinct coordinates as text, and which of them each vertex has.

    The vertices of a grid share coordinates, so that few need formatting.
    """
    for axis in vertices.T:
        distinct, which = np.unique(axis, return_inverse=True)
        yield _texts(distinct.tolist()), which


def _texts(numbers: list[float] | list[int]) -> Array:
    """Return numbers as text, each in the fewest digits that read back exactly."""
    # The repr of a list formats all its numbers in one call.
    return np.array(repr(numbers)[1:-1].encode("ascii").split(b", "), dtype=np.bytes_)


def _channels(colours: UInt8) -> Iterator[tuple[Array, Array]]:
    texts = np.array([_channel(value).encode("ascii") for value in range(256)], dtype=np.bytes_)
    for channel in colours.T:
        yield texts, channel


def _channel(value: int) -> str:
    """Return a channel, 0 to 255, as a fraction that gives it back when truncated or rounded."""
    return f"{math.ceil(value / 255 * 10**4) / 10**4:g}"


def _records(keyword: bytes, columns: list[tuple[Array, Array]]) -> Iterator[bytes]:
    """Yield lines, many at a time, of a keyword and a text for each column.

    The texts are laid side by side in fields of fixed width, whose padding with zero bytes is
    then removed.

    Parameters
    ----------
    keyword : bytes
    columns : list of tuples
        For each column a table of texts (M,), and for each line an index into it, int (N,).
    """
    fields: list[tuple[str, str | np.dtype[np.bytes_]]] = [("keyword", f"S{len(keyword)}")]
    for place, (texts, _) in enumerate(columns):
        fields += [(f"space {place}", "S1"), (f"text {place}", texts.dtype)]
    layout = np.dtype([*fields, ("end", "S1")])
    size = len(columns[0][1])
    for begin in range(0, size, CHUNK):
        rows = np.empty(min(CHUNK, size - begin), dtype=layout)
        rows["keyword"], rows["end"] = keyword, b"\n"
        for place, (texts, which) in enumerate(columns):
            rows[f"space {place}"] = b" "
            rows[f"text {place}"] = texts[which[begin : begin + CHUNK]]
        yield rows.tobytes().translate(None, b"\0")
