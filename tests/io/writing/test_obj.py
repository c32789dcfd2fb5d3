"""OBJ files and their materials, read back by a plain parser and by other programs.

Ways to pass without being right: coordinates that agree to a few digits, so they are compared bit
for bit; a pair of files of which one half stays after a fault, so faults are made to happen.
"""

from __future__ import annotations

import errno
import os
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from mlscli.errors import OutputError
from mlscli.io.writing.obj import write_obj
from mlscli.maps.grid import Grid
from mlscli.maps.surface_map import SurfaceMap
from mlscli.mesh import GROUPS, Mesh, Style, build_mesh
from mlscli.mesh.colours import ARTIFICIAL_RED
from mlscli.runtime.arrays import Array
from tests.helpers.meshes import house, open3d, soup


@pytest.fixture(params=["surface", "patches"])
def mesh(request: pytest.FixtureRequest) -> Mesh:
    style: Style = request.param
    return build_mesh(house(), style)


def statements(path: Path) -> Iterator[tuple[str, list[str]]]:
    for line in path.read_text(encoding="ascii").splitlines():
        if line:
            keyword, *values = line.split(" ")
            yield keyword, values


def test_coordinates_read_back_bit_for_bit_and_colours_exactly(mesh: Mesh, tmp_path: Path) -> None:
    write_obj(tmp_path / "a.obj", mesh)
    rows = [values for keyword, values in statements(tmp_path / "a.obj") if keyword == "v"]
    vertices = np.array([[float(value) for value in row[:3]] for row in rows])
    assert vertices.tobytes() == mesh.vertices.tobytes()
    colours = np.array([[float(value) for value in row[3:]] for row in rows]) * 255
    assert np.rint(colours).tolist() == mesh.colours.tolist()
    # Programs that cut off instead of rounding see the same colours.
    assert np.floor(colours.astype(np.float32)).tolist() == mesh.colours.tolist()


def test_every_channel_value_survives(tmp_path: Path) -> None:
    ramp = np.repeat(np.arange(256, dtype=np.uint8)[:, None], 3, axis=1)
    none = np.empty((0, 3), dtype=np.int32)
    origin = np.zeros(256, dtype=np.uint8)
    mesh = Mesh(np.zeros((256, 3)), ramp, origin, none, none[:, :2], none[:, 0], none[:, 0])
    write_obj(tmp_path / "a.obj", mesh)
    rows = [values for keyword, values in statements(tmp_path / "a.obj") if keyword == "v"]
    assert [int(float(row[3]) * 255) for row in rows] == list(range(256))
    assert max(float(row[3]) for row in rows) == 1


def test_elements_are_in_their_groups_with_their_materials(mesh: Mesh, tmp_path: Path) -> None:
    write_obj(tmp_path / "a.obj", mesh)
    found: dict[str, list[tuple[int, list[int]]]] = {"f": [], "l": [], "p": []}
    group = material = ""
    for keyword, values in statements(tmp_path / "a.obj"):
        if keyword == "g":
            (group,) = values
        elif keyword == "usemtl":
            (material,) = values
        elif keyword in found:
            assert group == material
            found[keyword].append((GROUPS.index(group), [int(value) - 1 for value in values]))
    for keyword, elements in (
        ("f", mesh.triangles),
        ("l", mesh.lines),
        ("p", mesh.points[:, None]),
    ):
        expected = zip(mesh.group(elements).tolist(), elements.tolist(), strict=True)
        assert sorted(found[keyword]) == sorted(expected)
    assert any(found.values())


def test_the_materials_beside_it_are_those_that_it_uses(mesh: Mesh, tmp_path: Path) -> None:
    write_obj(tmp_path / "my map.v2.obj", mesh)
    _, library = next(statements(tmp_path / "my map.v2.obj"))
    materials = dict[str, list[float]]()
    name = ""
    for keyword, values in statements(tmp_path / " ".join(library)):
        if keyword == "newmtl":
            (name,) = values
        elif keyword == "Kd":
            materials[name] = [float(value) for value in values]
    assert tuple(materials) == GROUPS
    assert np.rint(np.array(materials["artificial"]) * 255).tolist() == list(ARTIFICIAL_RED)


def test_an_empty_mesh_is_a_pair_of_files(tmp_path: Path) -> None:
    write_obj(tmp_path / "a.obj", build_mesh(SurfaceMap.of(Grid(1, 1, 1))))
    assert list(statements(tmp_path / "a.obj")) == [("mtllib", ["a.mtl"])]
    assert (tmp_path / "a.mtl").exists()


def coloured(vertices: Array, colours: Array) -> set[tuple[float, ...]]:
    """Return the vertices with their colours, each once."""
    rgb = np.rint(np.asarray(colours)[:, :3] * 255)
    return set(map(tuple, np.column_stack((vertices, rgb)).tolist()))


def test_trimesh_reads_the_triangles_with_their_colours(tmp_path: Path) -> None:
    mesh = build_mesh(house())
    write_obj(tmp_path / "a.obj", mesh)
    scene = trimesh.load_scene(tmp_path / "a.obj", process=False)
    # It makes a part of each group.
    assert set(scene.geometry) == {"measured", "plastered", "artificial"}
    for group, name in enumerate(GROUPS[:3]):
        part: Any = scene.geometry[name]
        chosen = mesh.triangles[mesh.group(mesh.triangles) == group]
        assert soup(part.vertices, part.faces) == soup(mesh.vertices, chosen)
        used = np.unique(chosen)
        assert coloured(part.vertices, part.vertex_attributes["color"]) == coloured(
            mesh.vertices[used], mesh.colours[used] / 255
        )


def test_open3d_reads_the_triangles_with_their_colours(tmp_path: Path) -> None:
    mesh = build_mesh(house())
    write_obj(tmp_path / "a.obj", mesh)
    found = open3d().io.read_triangle_mesh(str(tmp_path / "a.obj"))
    # It reads OBJ in single precision.
    single = mesh.vertices.astype(np.float32)
    assert soup(found.vertices, found.triangles) == soup(single, mesh.triangles)
    used = np.unique(mesh.triangles)
    assert coloured(found.vertices, found.vertex_colors) == coloured(
        single[used], mesh.colours[used] / 255
    )


@pytest.mark.parametrize("existing", ["a.obj", "a.mtl"])
def test_nothing_is_written_where_one_of_the_files_exists(existing: str, tmp_path: Path) -> None:
    (tmp_path / existing).write_bytes(b"mine")
    with pytest.raises(OutputError, match=f"{existing}: exists already"):
        write_obj(tmp_path / "a.obj", build_mesh(house()))
    assert [file.read_bytes() for file in tmp_path.iterdir()] == [b"mine"]
    write_obj(tmp_path / "a.obj", build_mesh(house()), overwrite=True)
    assert b"mine" not in [file.read_bytes() for file in tmp_path.iterdir()]


@pytest.mark.parametrize("overwrite", [False, True])
@pytest.mark.parametrize("failing", ["a.mtl", "a.obj"])
def test_no_half_of_the_pair_stays_after_a_fault(
    failing: str, overwrite: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if overwrite:
        for name in ("a.obj", "a.mtl"):
            (tmp_path / name).write_text(f"my {name}")
    before = {file.name: file.read_text() for file in tmp_path.iterdir()}

    def full_disk_for_one(take_name: Callable[[Path, Path], object]) -> Callable[..., object]:
        def take_name_or_fail(source: Path, target: Path) -> object:
            if Path(target).name == failing:
                raise OSError(errno.ENOSPC, "No space left on device")
            return take_name(source, target)

        return take_name_or_fail

    # The two ways in which a finished file takes its name.
    monkeypatch.setattr(os, "link", full_disk_for_one(os.link))
    monkeypatch.setattr(Path, "replace", full_disk_for_one(Path.replace))
    with pytest.raises(OutputError, match=f"{failing}: cannot be written: No space left"):
        write_obj(tmp_path / "a.obj", build_mesh(house()), overwrite=overwrite)
    assert {file.name: file.read_text() for file in tmp_path.iterdir()} == before


@pytest.mark.parametrize(
    ("name", "complaint"),
    [("a.mtl", "is the name for the materials"), ("a\nb.obj", "an OBJ file cannot name")],
)
def test_names_that_cannot_be_are_refused(name: str, complaint: str, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=complaint):
        write_obj(tmp_path / name, build_mesh(house()))
    assert list(tmp_path.iterdir()) == []


def test_more_vertices_than_int_can_number_are_refused_before_any_is_written(
    tmp_path: Path,
) -> None:
    huge = replace(build_mesh(house()), vertices=np.broadcast_to(np.zeros(3), (2**31, 3)))
    with pytest.raises(
        OutputError, match=r"2147483648 vertices; an OBJ file .* at most 2147483647"
    ):
        write_obj(tmp_path / "a.obj", huge)
    assert list(tmp_path.iterdir()) == []
