"""Meshes as GLB: binary glTF 2.0, for browsers, Blender and viewers of every kind.

The format has y up and positions in float32. The nodes for triangles, lines and points hold
positions relative to the middle of the mesh, in the axes of the map; the node above them turns z up
into y up and moves them to their place, by numbers in JSON. So coordinates are as exact as float32
is over the extent of the mesh, however far it lies from the origin.

References
----------
Khronos Group, *glTF 2.0 Specification*, ISO/IEC 12113:2022.
"""

from __future__ import annotations

import json
import os
import struct
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from mlscli.errors import OutputError
from mlscli.io.writing.atomic import atomic_write, refuse_existing
from mlscli.runtime.arrays import Array, Int32, UInt8

if TYPE_CHECKING:
    from mlscli.maps.surface_map import SurfaceMap
from mlscli.mesh import Mesh, mesh_of

# Lengths in the file's headers are uint32.
MAX_GLB_BYTES = 2**32 - 1

_FLOAT, _UINT32, _UINT8 = 5126, 5125, 5121
_VERTICES, _INDICES = 34962, 34963
_MODES = {"triangles": 4, "lines": 1, "points": 0}

# From the map's axes to the format's: (x, y, z) becomes (x, z, -y).
_SIN_45 = 0.5**0.5
_Y_UP = (-_SIN_45, 0.0, 0.0, _SIN_45)


class _Primitive(NamedTuple):
    """Elements of one kind, with the vertices that they use.

    Attributes
    ----------
    name : str
        The kind: a key of `_MODES`.
    positions : float32 (V, 3)
        Relative to the middle of the mesh, in the axes of the map.
    colours : uint8 (V, 4)
        Red, green, blue in linear values, and opacity.
    indices : uint32 (I,)
        The vertices of one element after the other.
    """

    name: str
    positions: Array
    colours: Array
    indices: Array


def write_glb(
    path: str | os.PathLike[str], mesh: Mesh | SurfaceMap, *, overwrite: bool = False
) -> None:
    """Write a mesh as GLB, whole or not at all.

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
        Where the file exists and `overwrite` is False, it cannot be written, or the mesh takes
        more than the 4 GiB that a GLB file can hold.
    """
    mesh = mesh_of(mesh)
    refuse_existing(path, overwrite=overwrite)
    elements = (mesh.triangles, mesh.lines, mesh.points)
    at_most = sum(indices.size for indices in elements) * 4 + len(mesh.vertices) * 3 * 16
    if at_most > MAX_GLB_BYTES:
        raise OutputError(
            f"{os.fspath(path)}: the mesh takes up to {at_most} bytes; "
            f"a GLB file holds at most {MAX_GLB_BYTES}: write PLY, or crop the map"
        )
    low, high = (
        (mesh.vertices.min(axis=0), mesh.vertices.max(axis=0))
        if len(mesh.vertices)
        else (np.zeros(3), np.zeros(3))
    )
    middle = low / 2 + high / 2
    pieces = [
        _piece(name, mesh, indices, middle)
        for name, indices in zip(_MODES, elements, strict=True)
        if indices.size
    ]
    blocks = [block for piece in pieces for block in piece[1:]]
    document = json.dumps(_document(pieces, middle.tolist()), separators=(",", ":")).encode()
    document += b" " * (-len(document) % 4)
    size = sum(block.nbytes for block in blocks)
    with atomic_write(path, overwrite=overwrite) as stream:
        total = 12 + 8 + len(document) + (8 + size if size else 0)
        stream.write(struct.pack("<4sII", b"glTF", 2, total))
        stream.write(struct.pack("<I4s", len(document), b"JSON"))
        stream.write(document)
        if size:
            stream.write(struct.pack("<I4s", size, b"BIN\0"))
        for block in blocks:
            stream.write(block.view(np.uint8).data)


def _piece(name: str, mesh: Mesh, indices: Int32, middle: Array) -> _Primitive:
    """Return elements with only the vertices that they use, renumbered.

    Parameters
    ----------
    name : str
        The kind of the elements: a key of `_MODES`.
    mesh : Mesh
    indices : int32 (E, K) or (E,)
        The vertices of each element.
    middle : float64 (3,)
        The middle of the mesh, in the map frame.
    """
    is_used = np.zeros(len(mesh.vertices), dtype=np.bool_)
    is_used[indices] = True
    used, number = np.flatnonzero(is_used), np.cumsum(is_used) - 1
    colours = np.full((len(used), 4), 255, dtype=np.uint8)
    # The format's colours are linear.
    colours[:, :3] = _linear()[mesh.colours[used]]
    return _Primitive(
        name,
        (mesh.vertices[used] - middle).astype("<f4"),
        colours,
        number[indices].reshape(-1).astype("<u4"),
    )


def _linear() -> UInt8:
    """Return the linear value, 0 to 255, of each sRGB value."""
    encoded = np.arange(256) / 255
    linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    channel: UInt8 = np.rint(linear * 255).astype(np.uint8)
    return channel


def _document(pieces: list[_Primitive], middle: list[float]) -> dict[str, Any]:
    """Return the JSON that describes the blocks of binary data."""
    x, y, z = middle
    document: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": "mls"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"name": "map", "rotation": _Y_UP, "translation": (x, z, -y + 0.0)}],
    }
    if not pieces:
        return document
    document["nodes"][0]["children"] = list(range(1, len(pieces) + 1))
    views: list[dict[str, int]] = []
    accessors: list[dict[str, Any]] = []
    offset = 0
    for piece in pieces:
        for block, target in zip(piece[1:], (_VERTICES, _VERTICES, _INDICES), strict=True):
            views.append(
                {"buffer": 0, "byteOffset": offset, "byteLength": block.nbytes, "target": target}
            )
            offset += block.nbytes
        accessors += _accessors(piece, len(accessors))
    document["nodes"] += [
        {"name": piece.name, "mesh": number} for number, piece in enumerate(pieces)
    ]
    document["meshes"] = [
        {
            "name": piece.name,
            "primitives": [
                {
                    "attributes": {"POSITION": 3 * number, "COLOR_0": 3 * number + 1},
                    "indices": 3 * number + 2,
                    "mode": _MODES[piece.name],
                    "material": 0,
                }
            ],
        }
        for number, piece in enumerate(pieces)
    ]
    # Both sides of a surface are visible, as from under a bridge.
    matt = {"metallicFactor": 0.0, "roughnessFactor": 1.0}
    document["materials"] = [{"pbrMetallicRoughness": matt, "doubleSided": True}]
    document["accessors"] = accessors
    document["bufferViews"] = views
    document["buffers"] = [{"byteLength": offset}]
    return document


def _accessors(piece: _Primitive, first: int) -> list[dict[str, Any]]:
    """Return what the three blocks of a piece hold; their views are numbered from `first`."""
    return [
        {
            "bufferView": first,
            "componentType": _FLOAT,
            "count": len(piece.positions),
            "type": "VEC3",
            "min": piece.positions.min(axis=0).tolist(),
            "max": piece.positions.max(axis=0).tolist(),
        },
        {
            "bufferView": first + 1,
            "componentType": _UINT8,
            "normalized": True,
            "count": len(piece.colours),
            "type": "VEC4",
        },
        {
            "bufferView": first + 2,
            "componentType": _UINT32,
            "count": len(piece.indices),
            "type": "SCALAR",
        },
    ]
