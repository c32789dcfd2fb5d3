"""PLY files, read back by their own rule and by other programs.

Ways to pass without being right: to read with what wrote, so the reader here goes by the header
alone; to compare with a tolerance, so coordinates are compared bit for bit.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from mlscli.errors import OutputError
from mlscli.io.writing.ply import write_ply
from mlscli.maps.grid import Grid
from mlscli.maps.surface_map import SurfaceMap
from mlscli.mesh import Mesh, Style, build_mesh
from mlscli.runtime.arrays import Array
from tests.helpers.meshes import house, open3d

TYPES = {"double": "<f8", "uchar": "u1", "int": "<i4"}


@pytest.fixture(params=["surface", "patches"])
def mesh(request: pytest.FixtureRequest) -> Mesh:
    style: Style = request.param
    return build_mesh(house(), style)


def read(path: Path) -> dict[str, Array]:
    """Read the elements of a PLY file whose lists all have three entries."""
    header, _, body = path.read_bytes().partition(b"end_header\n")
    lines = [line.split() for line in header.decode("ascii").splitlines()]
    assert lines[:2] == [["ply"], ["format", "binary_little_endian", "1.0"]]
    layouts: dict[tuple[str, int], list[Any]] = {}
    for line in lines[2:]:
        if line[0] == "element":
            layouts[line[1], int(line[2])] = fields = []
        elif line[1] == "list":
            fields += [("size", TYPES[line[2]]), (line[4], TYPES[line[3]], 3)]
        else:
            fields.append((line[2], TYPES[line[1]]))
    elements, offset = {}, 0
    for (name, count), fields in layouts.items():
        elements[name] = np.frombuffer(body, np.dtype(fields), count, offset)
        offset += elements[name].nbytes
    assert offset == len(body)
    return elements


def test_the_file_holds_the_mesh_bit_for_bit(mesh: Mesh, tmp_path: Path) -> None:
    write_ply(tmp_path / "a.ply", mesh)
    found = read(tmp_path / "a.ply")
    vertex, face, edge = found["vertex"], found["face"], found["edge"]
    assert np.column_stack([vertex[n] for n in "xyz"]).tobytes() == mesh.vertices.tobytes()
    colours = np.column_stack([vertex[n] for n in ("red", "green", "blue")])
    assert colours.tolist() == mesh.colours.tolist()
    assert vertex["origin"].tolist() == mesh.origin.tolist()
    assert face["vertex_indices"].tolist() == mesh.triangles.tolist()
    assert (face["size"] == 3).all()
    assert np.column_stack((edge["vertex1"], edge["vertex2"])).tolist() == mesh.lines.tolist()
    assert len(edge) > 0


def test_an_empty_mesh_is_a_readable_file(tmp_path: Path) -> None:
    write_ply(tmp_path / "a.ply", build_mesh(SurfaceMap.of(Grid(1, 1, 1))))
    assert [len(element) for element in read(tmp_path / "a.ply").values()] == [0, 0, 0]


def test_trimesh_reads_vertices_triangles_and_colours(tmp_path: Path) -> None:
    mesh = build_mesh(house())
    write_ply(tmp_path / "a.ply", mesh)
    found: Any = trimesh.load_mesh(tmp_path / "a.ply", process=False)
    assert found.vertices.tobytes() == mesh.vertices.tobytes()
    assert found.faces.tolist() == mesh.triangles.tolist()
    assert found.visual.vertex_colors[:, :3].tolist() == mesh.colours.tolist()


def test_open3d_reads_vertices_triangles_and_colours(tmp_path: Path) -> None:
    mesh = build_mesh(house())
    write_ply(tmp_path / "a.ply", mesh)
    found = open3d().io.read_triangle_mesh(str(tmp_path / "a.ply"))
    assert np.asarray(found.vertices).tobytes() == mesh.vertices.tobytes()
    assert np.asarray(found.triangles).tolist() == mesh.triangles.tolist()
    colours = np.rint(np.asarray(found.vertex_colors) * 255).astype(int)
    assert colours.tolist() == mesh.colours.tolist()


def test_open3d_reads_lines_and_points(tmp_path: Path) -> None:
    mesh = build_mesh(house(), "patches")
    write_ply(tmp_path / "a.ply", mesh)
    lines = open3d().io.read_line_set(str(tmp_path / "a.ply"))
    assert np.asarray(lines.points).tobytes() == mesh.vertices.tobytes()
    assert np.asarray(lines.lines).tolist() == mesh.lines.tolist()
    points = open3d().io.read_point_cloud(str(tmp_path / "a.ply"))
    assert np.asarray(points.points).tobytes() == mesh.vertices.tobytes()


def test_an_existing_file_is_replaced_only_when_told(tmp_path: Path) -> None:
    mesh, path = build_mesh(house()), tmp_path / "a.ply"
    path.write_bytes(b"mine")
    with pytest.raises(OutputError, match=r"a\.ply: exists already"):
        write_ply(path, mesh)
    assert path.read_bytes() == b"mine"
    write_ply(path, mesh, overwrite=True)
    assert len(read(path)["vertex"]) == len(mesh.vertices)


def test_more_vertices_than_int_can_number_are_refused_before_any_is_written(
    tmp_path: Path,
) -> None:
    mesh = build_mesh(house())
    huge = replace(mesh, vertices=np.broadcast_to(np.zeros(3), (2**31, 3)))
    with pytest.raises(OutputError, match=r"2147483648 vertices; a PLY file .* at most 2147483647"):
        write_ply(tmp_path / "a.ply", huge)
    assert list(tmp_path.iterdir()) == []
