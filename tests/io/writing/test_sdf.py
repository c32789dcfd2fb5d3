"""Worlds for Gazebo: read by its own parser where that is installed, the mesh by trimesh.

How one could cheat: to write XML that is well-formed and no SDF; to name a mesh that is not there;
to move the mesh and not say where it stands.
"""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import trimesh

from mlscli.errors import OutputError, UsageError
from mlscli.io.writing.sdf import write_sdf
from mlscli.mesh import build_mesh
from mlscli.runtime.arrays import Float64
from tests.helpers.maps import map_of
from tests.helpers.meshes import a_map, house, plane, soup

# Prints what Gazebo's parser finds: the model, whether it is static, its place, and the meshes.
READER = r"""
#include <iostream>
#include <sdf/sdf.hh>
int main(int, char **argv) {
  sdf::Root root;
  for (const auto &error : root.Load(argv[1])) std::cout << "error " << error.Message() << "\n";
  if (root.WorldCount() != 1) return 1;
  const auto *model = root.WorldByIndex(0)->ModelByIndex(0);
  const auto *link = model->LinkByIndex(0);
  const auto at = model->RawPose().Pos();
  std::cout.precision(17);
  std::cout << model->Name() << " " << model->Static() << "\n"
            << at.X() << " " << at.Y() << " " << at.Z() << "\n"
            << link->CollisionByIndex(0)->Geom()->MeshShape()->Uri() << "\n"
            << link->VisualByIndex(0)->Geom()->MeshShape()->Uri() << "\n";
}
"""


def triangles(mesh: trimesh.Trimesh, place: tuple[float, float, float]) -> Float64:
    """Return the corners of all triangles in the world, sorted, float64 (T, 9)."""
    return np.array(soup(np.asarray(mesh.vertices) + np.array(place), mesh.faces))


def test_the_world_has_the_mesh_of_the_map_where_the_map_has_it(tmp_path: Path) -> None:
    surface = house()
    far = surface.take(surface.origin == 0)
    for name, each in (("a b&c.sdf", surface), ("far.world", far)):
        world = write_sdf(tmp_path / name, each)
        assert {file.suffix for file in world.files} == {Path(name).suffix, ".obj", ".mtl"}
        root = ElementTree.parse(tmp_path / name).getroot()
        uris = [str(uri.text) for uri in root.iter("uri")]
        assert uris == [f"{Path(name).stem}.obj"] * 2
        pose = root.find("world/model/pose")
        assert pose is not None
        assert [float(number) for number in (pose.text or "").split()] == [*world.place, 0, 0, 0]
        found = trimesh.load_mesh(tmp_path / uris[0], process=False)
        expected = build_mesh(each)
        assert len(found.faces) == len(expected.triangles) == world.triangles
        corners = np.array(soup(expected.vertices, expected.triangles))
        np.testing.assert_allclose(triangles(found, world.place), corners, atol=1e-9)
        content = (tmp_path / uris[0]).read_text()
        assert "\nl " not in content
        assert "\np " not in content


def test_a_mesh_far_away_is_near_its_own_origin(tmp_path: Path) -> None:
    far = a_map(*((x + 5_000_000, y - 400_000, z, d) for x, y, z, d in plane(4, 4, 7.25)))
    world = write_sdf(tmp_path / "a.sdf", far)
    assert world.place == (5_000_002.0, -399_998.0, 7.0)
    found = trimesh.load_mesh(tmp_path / "a.obj", process=False)
    assert np.abs(found.vertices).max() < 3


def test_gazebo_s_parser_finds_a_static_model_with_the_mesh(tmp_path: Path) -> None:
    compiler = shutil.which("g++")
    options = "for n in 12 13 14 15; do pkg-config --cflags --libs sdformat$n && exit; done; exit 1"
    flags = subprocess.run(["sh", "-c", options], capture_output=True, text=True, check=False)
    if compiler is None or flags.returncode:
        pytest.skip("needs g++ and Gazebo's parser: apt-get install libsdformat-dev pkg-config")
    world = write_sdf(tmp_path / "a.sdf", house())
    (tmp_path / "reader.cpp").write_text(READER)
    build = [compiler, "-std=c++17", "-O0", "reader.cpp", "-o", "reader", *flags.stdout.split()]
    subprocess.run(build, cwd=tmp_path, check=True)
    told = subprocess.run(
        ["./reader", "a.sdf"], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    model, place, *uris = told.stdout.splitlines()
    assert model == "surface 1"
    assert [float(number) for number in place.split()] == list(world.place)
    assert uris == ["a.obj", "a.obj"]


def test_what_cannot_be_is_refused_and_nothing_is_left(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"end the name so"):
        write_sdf(tmp_path / "a.xml", house())
    for name in ("a\udcff.sdf", "a\x1b[31m.sdf", "a\x01.sdf"):
        with pytest.raises(OutputError, match="cannot name its mesh"):
            write_sdf(tmp_path / name, house())
    beside = re.escape(f"{tmp_path / 'a'}\nb.obj: an OBJ file cannot name")
    with pytest.raises(OutputError, match=beside):
        write_sdf(tmp_path / "a\nb.sdf", house())
    with pytest.raises(UsageError, match="no surface"):
        write_sdf(tmp_path / "a.sdf", map_of([]))
    (tmp_path / "a.mtl").write_bytes(b"mine")
    with pytest.raises(OutputError, match=r"a\.mtl: exists already"):
        write_sdf(tmp_path / "a.sdf", house())
    assert [file.name for file in tmp_path.iterdir()] == ["a.mtl"]
