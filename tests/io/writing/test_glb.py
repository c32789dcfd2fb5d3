"""GLB files, read back by the format's rules and by other programs.

Ways to pass without being right: to look at counts alone, so coordinates are put through the nodes
above them and compared; to stay near the origin, where float32 would do by itself.
"""

from __future__ import annotations

import json
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from mlscli.errors import OutputError
from mlscli.io.writing.glb import write_glb
from mlscli.maps.grid import Grid
from mlscli.maps.surface_map import SurfaceMap
from mlscli.mesh import STYLES, Mesh, Style, build_mesh
from mlscli.runtime.arrays import Array
from tests.helpers.meshes import house, open3d, soup

TYPES = {5126: "<f4", 5125: "<u4", 5121: "u1"}
WIDTHS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}
MODES = {4: 3, 1: 2, 0: 1}


class Read:
    """A GLB file, read by the words of the specification."""

    def __init__(self, path: Path) -> None:
        data = path.read_bytes()
        magic, version, length = struct.unpack_from("<4sII", data)
        assert (magic, version, length) == (b"glTF", 2, len(data))
        size, kind = struct.unpack_from("<I4s", data, 12)
        assert kind == b"JSON"
        assert size % 4 == 0
        self.json: dict[str, Any] = json.loads(data[20 : 20 + size])
        self.bin = b""
        if len(data) > 20 + size:
            bin_size, kind = struct.unpack_from("<I4s", data, 20 + size)
            assert kind == b"BIN\0"
            self.bin = data[28 + size :]
            assert len(self.bin) == bin_size
            assert self.json["buffers"] == [{"byteLength": bin_size}]

    def accessor(self, number: int) -> Array:
        accessor = self.json["accessors"][number]
        view = self.json["bufferViews"][accessor["bufferView"]]
        width, dtype = WIDTHS[accessor["type"]], np.dtype(TYPES[accessor["componentType"]])
        assert view["byteOffset"] % dtype.itemsize == 0
        assert view["byteLength"] == accessor["count"] * width * dtype.itemsize
        flat = np.frombuffer(self.bin, dtype, accessor["count"] * width, view["byteOffset"])
        return flat.reshape(-1, width)

    def elements(self, mode: int) -> tuple[Array, Array]:
        """Return corners in the map's axes (E, K, 3) and their colours, sRGB, 0 to 1."""
        (root,) = (self.json["nodes"][n] for n in self.json["scenes"][0]["nodes"])
        for child in root.get("children", []):
            (primitive,) = self.json["meshes"][self.json["nodes"][child]["mesh"]]["primitives"]
            if primitive["mode"] == mode:
                attributes = primitive["attributes"]
                position = self.accessor(attributes["POSITION"]).astype(np.float64)
                turned = rotated(root["rotation"], position) + root["translation"]
                in_map = np.column_stack((turned[:, 0], -turned[:, 2], turned[:, 1]))
                linear = self.accessor(attributes["COLOR_0"])[:, :3] / 255
                colour = np.where(
                    linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055
                )
                corners = self.accessor(primitive["indices"]).reshape(-1, MODES[mode])
                return in_map[corners], colour[corners]
        return np.empty((0, MODES[mode], 3)), np.empty((0, MODES[mode], 3))


def rotated(quaternion: list[float], points: Array) -> Array:
    x, y, z, w = quaternion
    axis = np.array([x, y, z])
    turned: Array = points + 2 * np.cross(axis, np.cross(axis, points) + w * points)
    return turned


@pytest.fixture(params=STYLES)
def mesh(request: pytest.FixtureRequest) -> Mesh:
    style: Style = request.param
    return build_mesh(house(), style)


def test_the_file_holds_triangles_lines_and_points_where_they_are(
    mesh: Mesh, tmp_path: Path
) -> None:
    write_glb(tmp_path / "a.glb", mesh)
    found = Read(tmp_path / "a.glb")
    for mode, elements in ((4, mesh.triangles), (1, mesh.lines), (0, mesh.points[:, None])):
        corners, colours = found.elements(mode)
        assert corners == pytest.approx(mesh.vertices[elements], abs=1e-6)
        # Eight bits of linear light are coarse in the dark.
        assert colours == pytest.approx(mesh.colours[elements] / 255, abs=0.03)


def test_far_from_the_origin_coordinates_stay_exact(tmp_path: Path) -> None:
    near = build_mesh(house())
    far = replace(near, vertices=near.vertices + np.array((4e6, -7e6, 1e3)))
    write_glb(tmp_path / "a.glb", far)
    corners, _ = Read(tmp_path / "a.glb").elements(4)
    assert corners == pytest.approx(far.vertices[far.triangles], abs=1e-5, rel=0)


def test_bounds_are_those_of_the_positions_as_the_format_demands(tmp_path: Path) -> None:
    write_glb(tmp_path / "a.glb", build_mesh(house()))
    found = Read(tmp_path / "a.glb")
    for number, accessor in enumerate(found.json["accessors"]):
        if accessor["type"] == "VEC3":
            assert accessor["min"] == found.accessor(number).min(axis=0).tolist()
            assert accessor["max"] == found.accessor(number).max(axis=0).tolist()


def test_trimesh_reads_the_triangles_with_z_along_y(tmp_path: Path) -> None:
    mesh = build_mesh(house())
    write_glb(tmp_path / "a.glb", mesh)
    scene: Any = trimesh.load_scene(tmp_path / "a.glb", process=False)
    (found,) = (g for g in scene.dump() if isinstance(g, trimesh.Trimesh))
    turned = mesh.vertices[:, [0, 2, 1]] * (1, 1, -1)
    assert len(found.faces) == len(mesh.triangles)
    assert np.array(soup(found.vertices.round(4), found.faces)) == pytest.approx(
        np.array(soup(turned.round(4), mesh.triangles)), abs=2e-4
    )


def test_open3d_reads_as_many_triangles_and_vertices(tmp_path: Path) -> None:
    mesh = build_mesh(house())
    write_glb(tmp_path / "a.glb", mesh)
    found = open3d().io.read_triangle_mesh(str(tmp_path / "a.glb"))
    assert len(found.triangles) == len(mesh.triangles)
    assert len(found.vertices) == len(np.unique(mesh.triangles))


def test_an_empty_mesh_is_a_readable_file(tmp_path: Path) -> None:
    write_glb(tmp_path / "a.glb", build_mesh(SurfaceMap.of(Grid(1, 1, 1))))
    found = Read(tmp_path / "a.glb")
    assert found.bin == b""
    assert "meshes" not in found.json


def test_an_existing_file_is_replaced_only_when_told(tmp_path: Path) -> None:
    mesh, path = build_mesh(house()), tmp_path / "a.glb"
    path.write_bytes(b"mine")
    with pytest.raises(OutputError, match=r"a\.glb: exists already"):
        write_glb(path, mesh)
    assert path.read_bytes() == b"mine"
    write_glb(path, mesh, overwrite=True)
    assert path.read_bytes().startswith(b"glTF")


def test_more_than_the_format_holds_is_refused_before_any_is_written(tmp_path: Path) -> None:
    mesh = build_mesh(house())
    huge = replace(mesh, vertices=np.broadcast_to(np.zeros(3), (2**27, 3)))
    with pytest.raises(OutputError, match=r"a GLB file holds at most 4294967295"):
        write_glb(tmp_path / "a.glb", huge)
    assert list(tmp_path.iterdir()) == []
