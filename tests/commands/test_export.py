"""``mls export``: which map is taken, what is written where, and what is said.

Ways to pass without being right: to look at the exit status alone, so the files are read.
"""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path

import laspy
import numpy as np
import pytest
import trimesh
from click.testing import CliRunner, Result
from mcap.reader import make_reader

from mlscli.commands.export import command
from mlscli.errors import InputError, OutputError, UsageError
from mlscli.io.writing.npz import write_map
from mlscli.io.writing.ply import write_ply
from mlscli.maps.space import FREE, OCCUPIED, UNKNOWN
from mlscli.mesh import build_mesh
from tests.helpers.maps import Patch, map_of
from tests.helpers.meshes import house
from tests.helpers.occupancy import served
from tests.helpers.octrees import read_octree


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the current folder, which holds one map and another .npz file."""
    monkeypatch.chdir(tmp_path)
    write_map("house.npz", house())
    np.savez("other.npz", format=np.array("something else"))
    Path("broken.npz").write_bytes(b"PK no archive")
    return tmp_path


def export(*arguments: str) -> Result:
    return CliRunner().invoke(command, arguments)


def complaint(*arguments: str) -> BaseException:
    result = export(*arguments)
    assert result.exit_code != 0
    assert result.exception is not None
    assert result.output == ""
    return result.exception


def test_the_one_map_in_the_folder_becomes_a_ply(folder: Path) -> None:
    result = export()
    mesh = build_mesh(house())
    counts = f"{len(mesh.vertices)} vertices, {len(mesh.triangles)} triangles"
    assert result.stdout == f"house.ply: {counts}, {len(mesh.lines)} lines\n"
    found = trimesh.load_mesh(folder / "house.ply", process=False)
    assert found.vertices.tobytes() == mesh.vertices.tobytes()


def test_of_several_maps_one_must_be_named(folder: Path) -> None:
    write_map("barn.npz", house())
    write_map("attic.npz", house())
    for age, name in enumerate(("barn", "house", "attic")):
        os.utime(f"{name}.npz", (1e9 - age, 1e9 - age))
    error = complaint()
    assert isinstance(error, UsageError)
    assert str(error).endswith("name one of barn.npz (the newest), house.npz, attic.npz")
    assert export("barn.npz").exit_code == 0
    assert (folder / "barn.ply").exists()


def test_the_truth_beside_a_map_is_taken_only_where_it_is_alone(folder: Path) -> None:
    (folder / "house.npz").rename(folder / "house.truth.npz")
    assert export().stdout.startswith("house.truth.ply: ")
    write_map("house.npz", house())
    assert export().stdout.startswith("house.ply: ")


def test_without_any_map_it_says_so(folder: Path) -> None:
    (folder / "house.npz").unlink()
    error = complaint()
    assert isinstance(error, UsageError)
    assert "no map (.npz) in the current folder" in str(error)


def test_a_file_that_is_no_map_is_named(folder: Path) -> None:
    error = complaint("broken.npz")
    assert isinstance(error, InputError)
    assert "broken.npz" in str(error)
    assert not (folder / "broken.ply").exists()


@pytest.mark.parametrize(
    ("options", "files"),
    [
        (["--format", "obj"], {"house.obj", "house.mtl"}),
        (["-o", "a.OBJ"], {"a.OBJ", "a.mtl"}),
        (["-o", "a.ply"], {"a.ply"}),
        (["-o", "a.glb"], {"a.glb"}),
        (["-o", "a.mesh", "--format", "ply"], {"a.mesh"}),
    ],
)
def test_the_format_is_the_one_named_or_the_output_s_ending(
    options: list[str], files: set[str], folder: Path
) -> None:
    before = set(folder.iterdir())
    assert export(*options).exit_code == 0
    assert {file.name for file in set(folder.iterdir()) - before} == files
    written = (folder / options[1]) if options[0] == "-o" else folder / "house.obj"
    begins = {"obj": b"mtllib ", "glb": b"glTF"}.get(written.suffix.lower()[1:], b"ply\n")
    assert written.read_bytes().startswith(begins)


def test_an_ending_that_says_nothing_is_refused(folder: Path) -> None:
    error = complaint("-o", "a.stl")
    assert isinstance(error, UsageError)
    assert "a.stl: does not end in .ply, .obj, " in str(error)
    assert not (folder / "a.stl").exists()


@pytest.mark.usefixtures("folder")
def test_options_reach_the_mesh() -> None:
    surface = house()
    surface.meta["map_from_recording"] = [[1, 0, 0, 5], [0, 0, 1, 6], [0, -1, 0, 7], [0, 0, 0, 1]]
    write_map("house.npz", surface, overwrite=True)
    for options, mesh in (
        (["--style", "patches"], build_mesh(surface, "patches")),
        (["--max-slope", "0"], build_mesh(surface, max_slope=0)),
        (["--max-slope", "9"], build_mesh(surface, max_slope=9)),
        (["--color", "origin"], build_mesh(surface, colour="origin")),
        (["--no-artificial"], build_mesh(surface, artificial=False)),
        (["--as-recorded"], build_mesh(surface, as_recorded=True)),
    ):
        result = export("--json", "--overwrite", *options)
        write_ply("known.ply", mesh, overwrite=True)
        assert Path("house.ply").read_bytes() == Path("known.ply").read_bytes()
        assert json.loads(result.stdout) == {
            "file": "house.ply",
            "format": "ply",
            "vertices": len(mesh.vertices),
            "triangles": len(mesh.triangles),
            "lines": len(mesh.lines),
        }


def test_a_mesh_as_recorded_undoes_the_turn_of_the_map(folder: Path) -> None:
    # (x, y, z) as recorded became (x + 5, z + 6, 7 - y).
    surface = house()
    surface.meta["map_from_recording"] = [[1, 0, 0, 5], [0, 0, 1, 6], [0, -1, 0, 7], [0, 0, 0, 1]]
    write_map("turned.npz", surface)
    for name in ("ply", "obj", "glb"):
        assert export("turned.npz", "-o", f"mapped.{name}").exit_code == 0
        assert export("turned.npz", "--as-recorded", "-o", f"recorded.{name}").exit_code == 0
        mapped, recorded = (
            np.array(trimesh.load_mesh(folder / f"{frame}.{name}", process=False).vertices)
            for frame in ("mapped", "recorded")
        )
        if name == "glb":
            # y is up there: (x, z, -y).
            mapped, recorded = (each[:, [0, 2, 1]] * (1, -1, 1) for each in (mapped, recorded))
        x, y, z = mapped.T
        expected = np.column_stack((x - 5, 7 - z, y - 6))
        np.testing.assert_allclose(recorded, expected, atol=1e-4)


def test_a_turn_that_is_none_and_a_replay_as_recorded_are_refused(folder: Path) -> None:
    surface = house()
    surface.meta["map_from_recording"] = "west"
    write_map("odd.npz", surface)
    assert "map_from_recording holds west" in str(complaint("odd.npz", "--as-recorded"))
    assert export("odd.npz").exit_code == 0
    assert isinstance(complaint("house.npz", "--as-recorded", "--format", "mcap"), UsageError)
    assert not (folder / "house.mcap").exists()


def test_an_existing_output_is_refused_before_the_map_is_read(folder: Path) -> None:
    (folder / "broken.ply").write_bytes(b"mine")
    error = complaint("broken.npz")
    assert isinstance(error, OutputError)
    assert "broken.ply: exists already" in str(error)
    assert (folder / "broken.ply").read_bytes() == b"mine"


def test_overwrite_replaces_what_exists(folder: Path) -> None:
    (folder / "house.ply").write_bytes(b"mine")
    assert export("--overwrite").exit_code == 0
    assert (folder / "house.ply").read_bytes().startswith(b"ply\n")


def test_a_map_becomes_a_replay_of_its_flight(folder: Path) -> None:
    surface = house()
    assert export("house.npz", "--format", "mcap").stdout == f"house.mcap: {surface.size} patches\n"
    with (folder / "house.mcap").open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    counts = summary.statistics.channel_message_counts
    topics = {channel.topic: counts[number] for number, channel in summary.channels.items()}
    # Its patches were first seen by one keyframe, and the craft was at seven places.
    assert (topics["/mls/patches"], topics["/tf"]) == (1, 7)


@pytest.mark.usefixtures("folder")
def test_a_replay_takes_no_options_of_drawing() -> None:
    for options in (["--style", "patches"], ["--max-slope", "2"], ["--no-artificial"]):
        error = complaint("house.npz", "-o", "a.mcap", *options)
        assert isinstance(error, UsageError)
        assert "--format mcap" in str(error)


def test_storeys_and_a_flying_height_are_written_for_nav2(folder: Path) -> None:
    result = export("--format", "nav2", "--slope", "40", "--headroom", "3 cells")
    assert result.stdout.startswith("house.1.yaml: storey 1, its floor from z -0.1 to ")
    states, _ = served(folder / "house.1.yaml")
    assert set(states.values()) == {FREE, OCCUPIED, UNKNOWN}
    flown = export("-o", "fly.yaml", "--flying-height", "1.5", "--headroom", "0.3", "--json")
    (sheet,) = json.loads(flown.stdout)["sheets"]
    assert sheet["what"] == "a craft from z 1.35 to 1.65"
    assert (sheet["free"], sheet["file"]) == (0, "fly.yaml")
    assert "does not say what was seen through" in flown.stderr
    assert "--free-space" in flown.stderr


def test_space_is_written_for_octomap_and_what_is_missing_is_told(folder: Path) -> None:
    result = export("--format", "octomap", "--json")
    told = json.loads(result.stdout)
    assert (told["file"], told["free"]) == ("house.bt", 0)
    assert read_octree(folder / "house.bt").nodes == told["nodes"]
    assert "--free-space" in result.stderr
    certain = json.loads(export("-o", "certain.bt", "--no-artificial", "--json").stdout)
    assert certain["occupied"] < told["occupied"]


def test_patches_are_written_as_points_and_rounding_is_told(folder: Path) -> None:
    surface = house()
    certain = np.count_nonzero(surface.origin != 2)
    assert export("-o", "a.pcd").output == f"a.pcd: {surface.size} points\n"
    assert export("-o", "a.laz", "--no-artificial").output == f"a.laz: {certain} points\n"
    filled = json.loads(export("--format", "las", "--filled", "--json").stdout)
    assert filled["points"] == len(laspy.read(folder / "house.las").xyz) > surface.size
    write_map("far.npz", replace(surface, ix=surface.ix + 10**7))
    assert "rounded by up to 0.1" in export("far.npz", "--format", "pcd").stderr
    assert export("far.npz", "--format", "las").stderr == ""


def test_layers_are_written_for_grid_map(folder: Path) -> None:
    result = export("--format", "grid-map", "-o", "a.mcap")
    assert result.stdout.startswith("a.mcap: 29 x 9 cells, layers elevation, top, clearance, ")
    assert result.stderr == ""
    with (folder / "a.mcap").open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    assert [schema.name for schema in summary.schemas.values()] == ["grid_map_msgs/msg/GridMap"]
    tower = [Patch(0, 0, 2.0 * n, 0.0, 0, 1) for n in range(10)]
    write_map("tower.npz", map_of(tower))
    assert "2 patches above level 8" in export("tower.npz", "--format", "grid-map").stderr


def test_layers_are_written_for_numpy_and_others(folder: Path) -> None:
    told = "29 x 9 cells, layers ground, top, clearance, "
    assert export("--format", "npz").output.startswith(f"house.layers.npz: {told}")
    with np.load(folder / "house.layers.npz") as arrays:
        assert arrays["ground"].shape == (9, 29)
    # Layers are no map: the one map is still the one.
    assert export("-o", "a.nc").output.startswith(f"a.nc: {told}")
    pytest.importorskip("rasterio")
    assert "--crs says which" in export("-o", "a.tif").stderr
    named = export("-o", "b.tif", "--crs", "EPSG:32632", "--json")
    assert (named.stderr, json.loads(named.stdout)["columns"]) == ("", 29)


def test_a_world_is_written_for_gazebo(folder: Path) -> None:
    triangles = len(build_mesh(house()).triangles)
    told = f"house.sdf: a world, {triangles} triangles in house.obj\n"
    assert export("--format", "sdf").output == told
    assert {file.suffix for file in folder.glob("house.*")} == {".npz", ".sdf", ".obj", ".mtl"}
    assert "house.obj: exists already" in str(complaint("-o", "house.world"))
    fewer = json.loads(export("-o", "b.sdf", "--no-artificial", "--json").stdout)
    assert fewer["triangles"] < triangles


@pytest.mark.usefixtures("folder")
def test_options_of_other_formats_are_refused() -> None:
    for format_, options in (
        ("ply", ("--slope", "30")),
        ("nav2", ("--color", "count")),
        ("mcap", ("--step", "1")),
    ):
        error = complaint("--format", format_, *options)
        assert isinstance(error, UsageError)
        assert str(error) == f"{options[0]}: --format {format_} does not take it"
    assert "at most 60" in str(complaint("--format", "nav2", "--slope", "89"))
    assert sorted(Path().glob("house.*")) == [Path("house.npz")]


def test_an_existing_storey_is_refused_before_the_map_is_read(folder: Path) -> None:
    (folder / "broken.1.pgm").write_bytes(b"mine")
    error = complaint("broken.npz", "--format", "nav2")
    assert isinstance(error, OutputError)
    assert "broken.1.pgm: exists already" in str(error)
