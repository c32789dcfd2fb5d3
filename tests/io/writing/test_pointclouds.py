"""Patches as PCD, LAS and LAZ, read back by Open3D and laspy, with the numbers that the map holds.

How one could cheat: to shift points by half a cell, to number levels by map and not by cell, to
lose what is NaN or beyond 8 bits, or to write what our own readers alone understand.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest

import mlscli
from mlscli.errors import OutputError, UsageError
from mlscli.io.writing import pointcloud
from mlscli.io.writing.clouds import write_cloud
from mlscli.maps.surface_map import SurfaceMap
from mlscli.runtime.arrays import Array, Float64
from tests.helpers.maps import Patch, map_of
from tests.helpers.meshes import house, open3d

Read = Callable[[Path], dict[str, Array]]


def by_open3d(path: Path) -> dict[str, Array]:
    cloud: Any = open3d().t.io.read_point_cloud(str(path))
    fields = {name: cloud.point[name].numpy() for name in cloud.point if name != "positions"}
    return {"xyz": cloud.point.positions.numpy()} | {
        name: values.ravel() for name, values in fields.items()
    }


def by_laspy(path: Path) -> dict[str, Array]:
    cloud = laspy.read(path)
    fields = {name: np.asarray(cloud[name]) for name in cloud.point_format.extra_dimension_names}
    return {"xyz": np.asarray(cloud.xyz)} | fields


WRITERS = [
    ("a.pcd", by_open3d),
    ("a.las", by_laspy),
    ("a.laz", by_laspy),
]
every_writer = pytest.mark.parametrize(("name", "read"), WRITERS)


def expected(surface: SurfaceMap) -> tuple[Float64, dict[str, list[float]]]:
    """Return the points and fields of a map, patch by patch."""
    size = surface.cell_size
    rows = zip(surface.ix.tolist(), surface.iy.tolist(), surface.height.tolist(), strict=True)
    xyz = np.array([((x + 0.5) * size, (y + 0.5) * size, z) for x, y, z in rows])
    cells = list(zip(surface.ix.tolist(), surface.iy.tolist(), strict=True))
    fields = {
        "level": [cells[:n].count(cell) for n, cell in enumerate(cells)],
        "origin": surface.origin.tolist(),
        "count": surface.count.tolist(),
        "depth": surface.depth.tolist(),
        "variance": surface.variance.tolist(),
        "uncertainty": np.sqrt(surface.height_variance).tolist(),
    }
    return xyz, fields


@every_writer
def test_another_program_finds_every_patch_with_its_fields(
    name: str, read: Read, tmp_path: Path
) -> None:
    surface = house()
    surface = surface.with_columns(count=np.where(surface.count > 0, surface.count + 10**6, 0))
    surface = replace(surface, count=surface.count.astype(np.uint32))
    points, off = write_cloud(tmp_path / name, surface)
    found = read(tmp_path / name)
    xyz, fields = expected(surface)
    assert points == len(found["xyz"]) == surface.size
    assert 0 < off < surface.cell_size / 1000
    np.testing.assert_allclose(found.pop("xyz"), xyz, atol=off * 1.0001)
    assert found.keys() == fields.keys()
    assert len(set(fields["level"])) > 1
    for field, values in fields.items():
        np.testing.assert_array_equal(found[field], np.array(values, dtype=found[field].dtype))


@every_writer
def test_walls_are_filled_down_to_their_feet(name: str, read: Read, tmp_path: Path) -> None:
    wall = map_of([Patch(0, 0, 2.0, 1.1, 0, 5), Patch(1, 0, 0.5, 0.0, 0, 1)], cell_size=1.0)
    assert write_cloud(tmp_path / name, wall, filled=True)[0] == 5
    heights = read(tmp_path / name)["xyz"][:, 2]
    np.testing.assert_allclose(heights, [2.0, 2 - 1.1 / 3, 2 - 2.2 / 3, 0.9, 0.5], atol=1e-3)


@every_writer
def test_artificial_patches_can_be_left_out_and_the_turn_undone(
    name: str, read: Read, tmp_path: Path
) -> None:
    surface = house()
    surface.meta["map_from_recording"] = [[1, 0, 0, 5], [0, 0, 1, 6], [0, -1, 0, 7], [0, 0, 0, 1]]
    write_cloud(tmp_path / name, surface, artificial=False, as_recorded=True)
    found = read(tmp_path / name)
    x, y, z = expected(surface.take(surface.origin != 2))[0].T
    np.testing.assert_allclose(found["xyz"], np.column_stack((x - 5, 7 - z, y - 6)), atol=1e-3)
    assert 2 not in found["origin"]


@every_writer
def test_what_was_written_is_read_as_a_cloud_again(name: str, read: Read, tmp_path: Path) -> None:
    write_cloud(tmp_path / name, house(), filled=True)
    (keyframe,) = list(mlscli.open_recording(tmp_path / name))
    np.testing.assert_allclose(keyframe.points, read(tmp_path / name)["xyz"], atol=1e-6)


def test_far_maps_are_rounded_and_by_how_much_is_told(tmp_path: Path) -> None:
    far = map_of([Patch(10**8, 5, 300.0, 0.0, 0, 1), Patch(10**8 + 9, 5, 0.0, 0.0, 0, 1)])
    assert write_cloud(tmp_path / "a.pcd", far)[1] == 0.75
    assert write_cloud(tmp_path / "a.las", far)[1] < far.cell_size / 1000
    wide = far.union(map_of([Patch(0, 0, 0.0, 0.0, 0, 1)]))
    assert 0.0 <= write_cloud(tmp_path / "b.las", wide)[1] <= 0.0501
    np.testing.assert_allclose(by_laspy(tmp_path / "b.las")["xyz"], expected(wide)[0], atol=0.06)


def test_the_same_map_gives_the_same_bytes(tmp_path: Path) -> None:
    for name in ("pcd", "las"):
        contents = []
        for copy in "ab":
            write_cloud(tmp_path / f"{copy}.{name}", house())
            contents.append((tmp_path / f"{copy}.{name}").read_bytes())
        assert contents[0] == contents[1]
    assert laspy.read(tmp_path / "a.las").header.creation_date is None


def test_what_cannot_be_written_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert write_cloud(tmp_path / "none.pcd", map_of([])) == (0, 0.0)
    with pytest.raises(UsageError, match="empty"):
        write_cloud(tmp_path / "none.las", map_of([]))
    with pytest.raises(UsageError, match=r"`kind`: is 'xyz'; expected pcd or las"):
        write_cloud(tmp_path / "a.xyz", house())
    monkeypatch.setattr(pointcloud, "MOST_POINTS", 50)
    with pytest.raises(UsageError, match=r"`filled`.*at most 50"):
        write_cloud(tmp_path / "a.pcd", house(), filled=True)
    with pytest.raises(OutputError, match="exists already"):
        write_cloud(tmp_path / "none.pcd", house())
    assert [file.name for file in tmp_path.iterdir()] == ["none.pcd"]
