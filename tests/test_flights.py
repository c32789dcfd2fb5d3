"""Real recordings, from the file to the map.

How one could cheat: bags written from the map instead of the recording; equality of maps that are
empty; symmetry on a map without gaps. The Tello flight has 102 keyframes whose rows are
interleaved, and its map has patches of every origin.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import mlscli
from mlscli.building.builder import MapBuilder
from mlscli.keyframes.batches import Points
from mlscli.keyframes.keyframe import Keyframe
from mlscli.maps.surface_map import SurfaceMap
from mlscli.runtime.arrays import Float64
from tests.helpers.bags import Sent, write_bag
from tests.helpers.maps import symmetries, turned_map, turned_points

COLUMNS = "x,y,z,-,-,-,-,keyframe,cx,cy,cz"
CELL_SIZE = 0.029


@pytest.fixture(scope="module")
def tello(shared_data: Path) -> Path:
    return shared_data / "sparse/tello_kf_pointData.csv"


@pytest.fixture(scope="module")
def clouds(tello: Path) -> list[Float64]:
    """Return the clouds of the flight as recorded, y down."""
    return [
        keyframe.points for keyframe in mlscli.open_recording(tello, columns=COLUMNS).keyframes()
    ]


@pytest.fixture(scope="module")
def tello_map(tello: Path) -> SurfaceMap:
    return mlscli.build_map(mlscli.open_recording(tello, columns=COLUMNS, up="-y"))


@pytest.fixture(scope="module")
def unplaced_map(tello: Path) -> SurfaceMap:
    """Return the map where it is not said from where points were seen, as in bags of clouds."""
    columns = "x,y,z,-,-,-,-,keyframe,-,-,-"
    return mlscli.build_map(mlscli.open_recording(tello, columns=columns, up="-y"))


def test_the_tello_flight_has_walls_levels_and_patches_of_every_origin(
    tello_map: SurfaceMap,
) -> None:
    tello_map.check()
    assert tello_map.meta["points"]["read"] == 13_859
    assert len(tello_map.route) == 102
    assert np.isfinite(tello_map.route[:, 1:]).all()
    assert set(tello_map.origin.tolist()) == {0, 1, 2}
    assert np.count_nonzero(tello_map.depth > 0) > 200
    # Walls are about a cell thick: they lie under few other levels.
    assert np.count_nonzero(np.diff(tello_map.cells.start) > 1) > 100


@pytest.mark.parametrize("kind", ["ros1", "ros2", "mcap"])
def test_a_bag_of_the_flight_gives_the_map_of_the_csv(
    clouds: list[Float64], unplaced_map: SurfaceMap, tmp_path: Path, kind: str
) -> None:
    sent = [Sent(cloud, nanoseconds=10**8 * number) for number, cloud in enumerate(clouds)]
    bag = write_bag(tmp_path / ("flight.bag" if kind == "ros1" else "flight"), sent, kind)
    assert mlscli.build_map(mlscli.open_recording(bag, up="-y")) == unplaced_map


@pytest.mark.parametrize("kind", ["ros1", "ros2", "mcap"])
def test_a_bag_of_float32_gives_the_map_of_the_csv_rounded(
    clouds: list[Float64], unplaced_map: SurfaceMap, tmp_path: Path, kind: str
) -> None:
    rounded = [cloud.astype(np.float32).astype(np.float64) for cloud in clouds]
    rows = [
        ",".join([*map(repr, point), str(number)])
        for number, cloud in enumerate(rounded)
        for point in cloud.tolist()
    ]
    csv = tmp_path / "rounded.csv"
    csv.write_text("\n".join(rows))
    expected = mlscli.build_map(mlscli.open_recording(csv, columns="x,y,z,keyframe", up="-y"))
    sent = [Sent(cloud) for cloud in clouds]
    bag = tmp_path / ("flight.bag" if kind == "ros1" else "flight")
    write_bag(bag, sent, kind, dtype="<f4")
    assert mlscli.build_map(mlscli.open_recording(bag, up="-y")) == expected
    assert expected != unplaced_map


def built(points: Points) -> SurfaceMap:
    builder = MapBuilder(mlscli.Parameters().with_cell_size(CELL_SIZE))
    for number in range(int(points.keyframe.max()) + 1):
        builder.add(Keyframe(points.xyz[points.keyframe == number]))
    return builder.finish()


def test_shuffling_and_turning_the_flight_shuffles_and_turns_the_map(
    tello: Path, unplaced_map: SurfaceMap
) -> None:
    keyframes = list(mlscli.open_recording(tello, columns=COLUMNS, up="-y").keyframes())
    numbers = np.arange(len(keyframes), dtype=np.int32)
    points = Points.of(
        np.concatenate([keyframe.points for keyframe in keyframes]),
        np.repeat(numbers, [len(keyframe.points) for keyframe in keyframes]),
    )
    cells = points.xyz[:, :2] / CELL_SIZE
    off_edges = (cells != np.floor(cells)).all(axis=1)
    points = Points.of(points.xyz[off_edges], points.keyframe[off_edges])
    surface = built(points)
    if off_edges.all():
        assert surface == unplaced_map
    order = np.random.default_rng(1).permutation(points.size)
    assert built(Points.of(points.xyz[order], points.keyframe[order])) == surface
    for symmetry in symmetries():
        assert built(turned_points(points, symmetry)) == turned_map(surface, symmetry)


def test_the_storeys_of_a_building_are_levels(shared_data: Path, tmp_path: Path) -> None:
    lines = (shared_data / "multilevel/building_floors_cgal.ply").read_text().splitlines()
    text = tmp_path / "building.xyz"
    rows = lines[lines.index("end_header") + 1 :]
    text.write_text("\n".join(" ".join(row.split()[:3]) for row in rows))
    sets = ["map.cell_size=0.5", "map.gap_size=1.5"]
    surface = mlscli.build_map(mlscli.open_recording(text), mlscli.load_parameters(None, sets))
    surface.check()
    levels = np.diff(surface.cells.start)
    assert np.count_nonzero(levels >= 2) / len(levels) >= 0.4


@pytest.mark.parametrize(
    ("name", "up"),
    [
        ("tello_room1.csv", "-y"),
        ("tello_saloon.csv", "-y"),
        ("tello_ragged_trailing_commas.csv", "-y"),
        ("euroc_orb2_MapPoints.txt", "z"),
        ("euroc_orb3_pointcloud.txt", "z"),
        ("euroc_orb3_ref_pointcloud.txt", "z"),
    ],
)
def test_sparse_maps_are_built_without_configuration(shared_data: Path, name: str, up: str) -> None:
    path = shared_data / "sparse" / name
    for preset in ("default", "thesis", "plain"):
        parameters = mlscli.load_parameters(preset, ["map.cell_size=auto"])
        surface = mlscli.build_map(mlscli.open_recording(path, up=up), parameters)
        surface.check()
        account = surface.meta["points"]
        assert account["read"] == account["kept"] + sum(account["dropped"].values())
        assert account["kept"] > 0.7 * account["read"]
