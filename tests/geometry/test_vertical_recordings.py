"""The vertical of real recordings.

How these tests could be cheated: by axes that are told by the names of the files, or by attitudes
that say what the points say, too. So what is vertical comes from the attitudes of real cameras,
which are not told.
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mlscli.runtime.arrays import Float64
from tests.geometry.test_vertical import degrees_between, found


def turning_axis(attitudes: Float64) -> Float64:
    """Return the direction that cameras with y down see the least from another side."""
    matrices = Rotation.from_quat(attitudes).as_matrix()
    across = np.einsum("nij,nkj->ik", matrices[:, :, :1], matrices[:, :, :1])
    axis = np.linalg.eigh(across)[1][:, 0]
    return np.asarray(axis * -np.sign(matrices[:, :, 1].mean(axis=0) @ axis))


def test_the_tello_flight_has_y_down_by_its_points_alone_and_with_its_route(
    shared_data: Path,
) -> None:
    table = np.loadtxt(shared_data / "sparse/tello_kf_pointData.csv", delimiter=",")
    _, first = np.unique(table[:, 7], return_index=True)
    route, attitudes = table[first, 8:], table[first, 3:7]
    vertical = turning_axis(attitudes)

    assert degrees_between(vertical, np.array([0.0, -1.0, 0.0])) < 12
    for up in (
        found(table[:, :3]),
        found(table[:, :3], route),
        found(table[:, :3], route, attitudes),
    ):
        assert degrees_between(up.axis, vertical) < 5
        assert "from -y" in up.summary


@pytest.mark.parametrize("name", ["room1", "saloon", "ragged_trailing_commas"])
def test_other_rooms_that_the_tello_saw_have_y_down(shared_data: Path, name: str) -> None:
    path = shared_data / f"sparse/tello_{name}.csv"
    points = np.loadtxt(path, delimiter=",", usecols=(0, 1, 2))

    # The camera is mounted looking down a little, as in the flight with poses.
    assert degrees_between(found(points).axis, np.array([0.0, -0.98, -0.2])) < 5


@pytest.mark.parametrize(
    ("cloud", "trajectory", "skipped"),
    [
        ("euroc_orb2_MapPoints", "euroc_orb2_KeyFrameTrajectory_tum", 0),
        ("euroc_orb3_pointcloud", "euroc_orb3_KeyFrameTrajectory", 0),
        ("euroc_orb3_ref_pointcloud", "euroc_orb3_KeyFrameTrajectory", 1),
    ],
)
def test_the_euroc_flights_have_the_vertical_about_which_they_turned(
    shared_data: Path, cloud: str, trajectory: str, skipped: int
) -> None:
    text = (shared_data / f"sparse/{cloud}.txt").read_text().replace(",", " ")
    points = np.array([line.split() for line in text.splitlines()[skipped:]], dtype=np.float64)
    poses = np.loadtxt(shared_data / f"sparse/{trajectory}.txt")
    vertical = turning_axis(poses[:, 4:])

    for up in (
        found(points),
        found(points, poses[:, 1:4]),
        found(points, poses[:, 1:4], poses[:, 4:]),
    ):
        assert degrees_between(up.axis, vertical) < 7


def colmap(folder: Path) -> tuple[Float64, Float64, Float64]:
    """Return the points, the places and the attitudes of the cameras of a COLMAP model."""
    data, points = (folder / "points3D.bin").read_bytes(), []
    at = 8
    for _ in range(struct.unpack_from("<Q", data)[0]):
        points.append(struct.unpack_from("<3d", data, at + 8))
        at += 51 + 8 * struct.unpack_from("<Q", data, at + 43)[0]
    data, places, attitudes = (folder / "images.bin").read_bytes(), [], []
    at = 8
    for _ in range(struct.unpack_from("<Q", data)[0]):
        w, x, y, z, *translation = struct.unpack_from("<7d", data, at + 4)
        to_world = Rotation.from_quat([x, y, z, w]).inv()
        places.append(-to_world.apply(translation))
        attitudes.append(to_world.as_quat())
        at = data.index(b"\0", at + 64) + 1
        at += 8 + 24 * struct.unpack_from("<Q", data, at)[0]
    return np.array(points), np.array(places), np.array(attitudes)


def test_the_colmap_model_has_y_down_by_its_cameras(shared_data: Path) -> None:
    up = found(*colmap(shared_data / "sparse/colmap_pysfm"))

    assert degrees_between(up.axis, np.array([0.0, -1.0, 0.0])) < 5


@pytest.mark.parametrize(
    ("name", "skipped", "axis"),
    [
        ("footbridge_yup_dddmr_map.pcd", 11, (0, 1, 0)),
        ("building_floors_cgal.ply", 12, (0, 0, 1)),
        ("unitree_ISR_scan_01_raw.xyz", 0, (0, 0, 1)),
        ("unitree_ISR_scan_02_raw.xyz", 0, (0, 0, 1)),
        ("unitree_ISR_scan_02_registered.xyz", 0, (0, 0, 1)),
    ],
)
def test_scans_without_a_route_have_their_vertical(
    shared_data: Path, name: str, skipped: int, axis: tuple[float, float, float]
) -> None:
    path = shared_data / "multilevel" / name
    points = np.loadtxt(path, skiprows=skipped, usecols=(0, 1, 2))

    up = found(points)

    assert degrees_between(up.axis, np.array(axis)) < 5
