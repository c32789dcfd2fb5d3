"""A map as a world for Gazebo: an SDF file, with the mesh as OBJ beside it."""

from __future__ import annotations

import os
import re
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np

from mlscli.errors import OutputError, UsageError, expect_path
from mlscli.io.writing.atomic import write_together
from mlscli.io.writing.obj import materials_beside, write_obj
from mlscli.maps.surface_map import SurfaceMap
from mlscli.mesh import Mesh, mesh_of
from mlscli.runtime.arrays import Float64, Int32
from mlscli.runtime.temporary import temporary_folder

VERSION = "1.7"
WORLD, MODEL = "map", "surface"

# Characters that XML 1.0 cannot hold.
_NOT_IN_XML = re.compile("[^\t\n\r -\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


class World(NamedTuple):
    """What was written.

    Attributes
    ----------
    files : list of Path
        The world, the mesh and its materials.
    triangles : int
    place : tuple of float
        Where the mesh stands in the world: its coordinates are about its middle.
    """

    files: list[Path]
    triangles: int
    place: tuple[float, float, float]


def write_sdf(
    path: str | os.PathLike[str], mesh: Mesh | SurfaceMap, *, overwrite: bool = False
) -> World:
    """Write a world that holds a mesh as a static model, whole or not at all.

    The mesh is what is seen and what collides. Its lines, the route and such, are left out. In the
    world, coordinates are those of the mesh.

    Parameters
    ----------
    path
        Ends in ``.sdf`` or ``.world``; ``.obj`` and ``.mtl`` lie beside it.
    mesh : Mesh or SurfaceMap
        Of a map, the mesh that `build_mesh` makes by default.
    overwrite : bool

    Returns
    -------
    World

    Raises
    ------
    TypeError
        It is neither a mesh nor a map.
    UsageError
        Where it has no triangles.
    OutputError
        Where the name does not end so; one of the files exists and `overwrite` is False, or cannot
        be written.
    """
    expect_path(path, "path", "the file to write")
    mesh = mesh_of(mesh)
    target = Path(path)
    if target.suffix.lower() not in (".sdf", ".world"):
        raise OutputError(f"{target}: Gazebo reads worlds as .sdf or .world; end the name so")
    if _NOT_IN_XML.search(target.name):
        raise OutputError(f"{target}: an SDF file cannot name its mesh so; rename it")
    if not len(mesh.triangles):
        raise UsageError("the map has no surface; there is nothing to make a world of")
    used = np.unique(mesh.triangles)
    vertices = mesh.vertices[used]
    middle = np.floor((vertices.min(axis=0) + vertices.max(axis=0)) / 2)
    shown = _only(mesh, used, vertices - middle)
    place = float(middle[0]), float(middle[1]), float(middle[2])
    shape = target.with_suffix(".obj")
    files = [target, shape, materials_beside(shape)]
    with temporary_folder(None, "sdf") as folder:
        made = Path(folder, files[1].name)
        write_obj(made, shown)
        contents = [_world(files[1].name, place), *(
            made.with_suffix(ending).read_bytes() for ending in (".obj", ".mtl")
        )]  # fmt: skip
    write_together(dict(zip(files, contents, strict=True)), overwrite=overwrite)
    return World(files, len(mesh.triangles), place)


def _only(mesh: Mesh, used: Int32, vertices: Float64) -> Mesh:
    """Return the triangles of a mesh alone, with new coordinates of the vertices they use."""
    number = np.zeros(len(mesh.vertices), dtype=np.int32)
    number[used] = np.arange(len(used), dtype=np.int32)
    return replace(
        mesh,
        vertices=vertices,
        colours=mesh.colours[used],
        origin=mesh.origin[used],
        patch=mesh.patch[used],
        triangles=number[mesh.triangles],
        lines=np.empty((0, 2), dtype=np.int32),
        points=np.empty(0, dtype=np.int32),
    )


def _world(mesh: str, place: tuple[float, float, float]) -> bytes:
    """Return the SDF file of a world with a mesh, by its name, at a place."""
    sdf = ElementTree.Element("sdf", version=VERSION)
    world = ElementTree.SubElement(sdf, "world", name=WORLD)
    light = ElementTree.SubElement(world, "light", type="directional", name="sun")
    for name, text in (
        ("cast_shadows", "true"),
        ("pose", "0 0 100 0 0 0"),
        ("diffuse", "0.9 0.9 0.9 1"),
        ("specular", "0.1 0.1 0.1 1"),
        ("direction", "-0.45 0.35 -0.82"),
    ):
        ElementTree.SubElement(light, name).text = text
    model = ElementTree.SubElement(world, "model", name=MODEL)
    ElementTree.SubElement(model, "static").text = "true"
    ElementTree.SubElement(model, "pose").text = " ".join(map(repr, (*place, 0, 0, 0)))
    link = ElementTree.SubElement(model, "link", name="link")
    for kind in ("collision", "visual"):
        shape = ElementTree.SubElement(link, kind, name=kind)
        geometry = ElementTree.SubElement(shape, "geometry")
        ElementTree.SubElement(ElementTree.SubElement(geometry, "mesh"), "uri").text = mesh
    ElementTree.indent(sdf)
    written: bytes = ElementTree.tostring(sdf, encoding="utf-8", xml_declaration=True)
    return written + b"\n"
