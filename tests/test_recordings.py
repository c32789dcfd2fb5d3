"""Recordings of others, from the file to points in the map frame and to the map.

How these tests could be cheated: by maps that are equal because both are empty, by a transform
that is the identity, by a laser whose scans are stacked without being turned, or by counting as
whole what a cut file still declares. So maps have to have so many patches, transforms are chains,
the laser's heights are compared with those of flat scans, and what lies whole before a cut is
told by rosbags' and mcap's own readers.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mlscli
from mlscli.errors import InputError, MlsError
from mlscli.io.reading.recording import Recording, open_recording
from mlscli.io.writing.flight_bag import write_bag as write_flight
from mlscli.maps.surface_map import SurfaceMap
from mlscli.runtime.arrays import Float64
from mlscli.scenes.flight import Flight, fly
from mlscli.scenes.presets import make
from mlscli.scoring import compare_maps
from tests.helpers.bags import Told, write_told
from tests.helpers.broken import Sent, whole_in_mcap, whole_in_ros1
from tests.helpers.ros import header, vector

JACKAL_POSES = "/vrpn_client_node/jackal/pose"


def built(recording: Recording, cell_size: float, preset: str = "plain") -> SurfaceMap:
    return mlscli.build_map(
        recording, mlscli.load_parameters(preset, [f"map.cell_size={cell_size}"])
    )


def differing(a: SurfaceMap, b: SurfaceMap, tolerance: float) -> float:
    """Return which share of the patches of two maps is in one only or differs in height."""
    total = compare_maps(a, b, tolerance).total
    return (total.only_a + total.only_b + total.heights.beyond) / max(a.size, b.size)


# The office


def test_a_scan_and_its_transform_make_the_registered_scan(
    shared_data: Path, tmp_path: Path
) -> None:
    folder = shared_data / "multilevel"
    raw = np.loadtxt(folder / "unitree_ISR_scan_02_raw.xyz")
    registered = np.loadtxt(folder / "unitree_ISR_scan_02_registered.xyz")
    metrics = json.loads((folder / "unitree_ISR_registration_metrics.json").read_text())
    registration = metrics["scans"]["scan_02"]["registration_to_scan_01"]
    whole = np.array(registration["transform_source_to_scan01"])
    # A chain of three whose product it is: two of any kind, and what is left of it.
    parts = [transform((3, -2, 1), (20, -50, 110)), transform((0.5, 4, -1), (-70, 10, 5))]
    parts.append(np.linalg.inv(parts[0] @ parts[1]) @ whole)
    frames = ["map", "base_link", "mast", "lidar"]
    tree = [
        {
            "header": header(100, 0, parent),
            "child_frame_id": child,
            "transform": {
                "translation": vector(*part[:3, 3]),
                "rotation": vector(*Rotation.from_matrix(part[:3, :3]).as_quat()),
            },
        }
        for parent, child, part in zip(frames[:-1], frames[1:], parts, strict=True)
    ]
    # In the middle of the scan, the craft is where it is said to be before and after.
    later = [{**tree[0], "header": header(102, 0, "map")}]
    field_ = [{"name": n, "offset": 8 * k, "datatype": 8, "count": 1} for k, n in enumerate("xyz")]
    cloud = {
        "header": header(101, 0, "lidar"), "height": 1, "width": len(raw), "point_step": 24,
        "row_step": 24 * len(raw), "fields": field_, "data": np.frombuffer(raw.tobytes(), np.uint8),
    }  # fmt: skip
    tf, point_cloud = "tf2_msgs/msg/TFMessage", "sensor_msgs/msg/PointCloud2"
    bag = write_told(
        tmp_path / "office.bag",
        [
            Told("/tf", tf, {"transforms": tree[:1]}, 1),
            Told("/tf", tf, {"transforms": later}, 2),
            Told("/tf_static", tf, {"transforms": tree[1:]}, 3),
            Told("/points", point_cloud, cloud, 4),
        ],
    )
    recording = open_recording(bag)
    (keyframe,) = recording.keyframes()

    assert np.abs(raw - registered).max() > 1
    np.testing.assert_allclose(keyframe.points, registered, rtol=0, atol=1e-5)
    other = open_recording(folder / "unitree_ISR_scan_02_registered.xyz")
    for preset in ("plain", "default"):
        ours, theirs = built(recording, 0.1, preset), built(other, 0.1, preset)
        assert min(ours.size, theirs.size) > 1000
        assert differing(ours, theirs, 1e-4) < 0.01


def transform(shift: tuple[float, float, float], angles: tuple[float, float, float]) -> Float64:
    whole = np.eye(4)
    whole[:3, :3] = Rotation.from_euler("xyz", angles, degrees=True).as_matrix()
    whole[:3, 3] = shift
    return whole


# Recorded flights


def test_a_recording_gives_the_same_map_from_ros_1_and_from_ros_2(shared_data: Path) -> None:
    names = ["ros1_jackal_scan_pose.bag", "ros2_jackal_scan_pose"]
    one, two = (
        built(open_recording(shared_data / "bags" / name, pose_topic=JACKAL_POSES), 0.1)
        for name in names
    )

    assert one == two
    assert one.size > 100
    assert np.array_equal(one.route, two.route, equal_nan=True)
    assert np.isfinite(one.route).all()
    assert len(one.route) > 180


def test_a_tilting_laser_becomes_a_map_of_three_dimensions(shared_data: Path) -> None:
    bag = shared_data / "bags/ros1_tilt_laser_tf.bag"
    flat = np.concatenate(
        [keyframe.points for keyframe in open_recording(bag, frame="laser").keyframes()]
    )
    recording = open_recording(bag)
    assert all(keyframe.is_ranged for keyframe in recording.keyframes())
    points = np.concatenate([keyframe.points for keyframe in recording.keyframes()])
    surface = built(open_recording(bag), 0.2)

    assert np.ptp(flat[:, 2]) == 0
    assert recording.frame_id == "tilt_base"
    assert np.ptp(np.percentile(points[:, 2], [5, 95])) > 2
    # The first scan was taken before the first transform.
    assert (recording.tally.keyframes, recording.tally.unplaced) == (178, 1)
    assert np.count_nonzero(np.diff(surface.cells.start) > 1) > 500


# Synthetic flights


@pytest.fixture(scope="module")
def flight() -> Flight:
    return fly(make("bridge"), 0.2, seed=1)


@pytest.mark.parametrize("kind", ["ros1", "ros2", "mcap"])
def test_a_flight_in_the_frame_of_its_camera_gives_the_map_of_the_same_in_the_map_frame(
    flight: Flight, tmp_path: Path, kind: Any
) -> None:
    there, seen = tmp_path / "map", tmp_path / "camera"
    write_flight(there, flight.keyframes, flight.attitudes, kind)
    write_flight(seen, flight.keyframes, flight.attitudes, kind, sensor_frame=True)
    straight, moved = open_recording(there), open_recording(seen)

    assert any("taken as they are" in note for note in straight.notes)
    assert any("from 'camera' into 'map' by the transforms" in note for note in moved.notes)
    by_poses = open_recording(seen, pose_topic="/odom")
    for one, two, three in zip(
        straight.keyframes(), moved.keyframes(), by_poses.keyframes(), strict=True
    ):
        for other in (two, three):
            np.testing.assert_allclose(other.points, one.points, rtol=0, atol=1e-9)
            np.testing.assert_allclose(other.position, one.position, rtol=0, atol=1e-9)
    one_map, other_map = built(straight, 0.3), built(moved, 0.3)
    assert one_map.size > 200
    assert differing(one_map, other_map, 1e-9) < 0.001
    np.testing.assert_allclose(one_map.route, other_map.route, rtol=0, atol=1e-9)


# Cut recordings


@pytest.mark.parametrize(
    ("name", "topic", "options", "whole"),
    [
        (
            "bags/ros1_luminar_pc2_lz4.bag",
            "/luminar_pointcloud",
            {"topic": "/luminar_pointcloud", "frame": "luminar_lidar"},
            whole_in_ros1,
        ),
        (
            "bags/ros1_ouster_in_mcap_zstd.mcap",
            "/os1_cloud_node/points",
            {"frame": "os1_lidar"},
            whole_in_mcap,
        ),
        ("bags/ros1_jackal_scan_pose.bag", "/scan", {"frame": "velodyne"}, whole_in_ros1),
        (
            "bags/ros2_jackal_scan_pose/test_2026-02-19-11-53-31.db3",
            "/scan",
            {"frame": "velodyne"},
            None,
        ),
        ("bags/ros1_tilt_laser_tf.bag", "/scan", {}, None),
        ("hard/ros1_unindexed.bag", "pointcloud2d", {"frame": "base_laser"}, None),
    ],
)
def test_a_cut_recording_yields_the_keyframes_that_lie_whole_before_the_cut(
    shared_data: Path,
    tmp_path: Path,
    name: str,
    topic: str,
    options: dict[str, Any],
    whole: Callable[[Path], Callable[[int], list[Sent]]] | None,
) -> None:
    path = shared_data / name
    data = path.read_bytes()
    whole_before = whole(path) if whole else lambda _: []
    part = tmp_path / path.name
    last = 0
    for place in range(12):
        size = len(data) * place // 12
        part.write_bytes(data[:size])
        found = 0
        try:
            recording = open_recording(part, **options)
            for _ in recording.keyframes():
                found += 1
            assert recording.losses
        except MlsError as error:
            assert "\n" not in str(error)  # noqa: PT017
        expected = sum(message.topic == topic for message in whole_before(size))
        assert found >= max(expected, last), f"cut at byte {size}"
        last = found
    assert last > 0


# Up


def level_axis(attitudes: Float64) -> Float64:
    """Return the direction across which cameras hold their rows, which pilots keep level."""
    rows = Rotation.from_quat(attitudes).as_matrix()[:, :, 0]
    return np.asarray(np.linalg.eigh(np.einsum("ni,nj->ij", rows, rows))[1][:, 0])


def degrees_apart(axis: Float64, other: Float64) -> float:
    return float(np.degrees(np.arccos(np.clip(axis @ other, -1, 1))))


def found_up(path: Path, **options: Any) -> Float64:
    """Return the axis that became z, as the points that came out of the recording tell."""
    plain = next(iter(open_recording(path, **options).keyframes())).points[:50]
    recording = open_recording(path, up="auto", **options)
    turned = next(iter(recording.keyframes())).points[:50]
    assert any(note.startswith("`up` auto: up is") and "%" in note for note in recording.notes)
    return np.asarray(np.linalg.lstsq(plain, turned[:, 2], rcond=None)[0])


def test_up_is_found_where_cameras_tell_what_is_level(shared_data: Path) -> None:
    sparse = shared_data / "sparse"
    tello = sparse / "tello_kf_pointData.csv"
    columns = "x,y,z,-,-,-,-,keyframe,cx,cy,cz"
    cases: list[tuple[Path, dict[str, Any], Float64]] = [
        (tello, {"columns": columns}, np.loadtxt(tello, delimiter=",")[:, 3:7])
    ]
    for cloud, tum in (
        ("euroc_orb2_MapPoints.txt", "euroc_orb2_KeyFrameTrajectory_tum.txt"),
        ("euroc_orb3_pointcloud.txt", "euroc_orb3_KeyFrameTrajectory.txt"),
    ):
        cases.append((sparse / cloud, {"route": sparse / tum}, np.loadtxt(sparse / tum)[:, 4:8]))
    for path, options, attitudes in cases:
        axis, level = found_up(path, **options), level_axis(attitudes)
        # In a camera's frame y points down.
        assert degrees_apart(axis, -level if level[1] > 0 else level) < 10, path.name


@pytest.mark.parametrize(
    ("name", "axis"),
    [
        # The README lists y down and y up; the floors of building and office lie across z.
        ("sparse/colmap_pysfm", (0, -1, 0)),
        ("multilevel/footbridge_yup_dddmr_map.pcd", (0, 1, 0)),
        ("multilevel/building_floors_cgal.ply", (0, 0, 1)),
        ("multilevel/unitree_ISR_scan_02_registered.xyz", (0, 0, 1)),
    ],
)
def test_up_is_found_where_the_scene_tells(
    shared_data: Path, name: str, axis: tuple[float, float, float]
) -> None:
    assert degrees_apart(found_up(shared_data / name), np.array(axis, dtype=float)) < 10


def test_two_axes_that_are_supported_alike_are_an_error_that_names_both(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    sides = [np.insert(rng.uniform(-1, 1, (800, 2)), axis, side, 1)
             for axis in range(3) for side in (-1.0, 1.0)]  # fmt: skip
    cube = tmp_path / "cube.xyz"
    np.savetxt(cube, np.concatenate(sides))

    with pytest.raises(InputError, match=r"two axes .* expected `up` .*(x|y|z) or `up` .*(x|y|z)"):
        open_recording(cube, up="auto")


# Every file


@dataclass(frozen=True)
class Given:
    """A file, how it is read, and what comes of it: points, or the words of an error."""

    name: str
    outcome: int | str
    options: dict[str, Any] = field(default_factory=dict)
    told: str = ""


TELLO = {"columns": "x,y,z,-,-,-,-,keyframe,cx,cy,cz", "up": "-y"}
NO_CLOUDS = "holds no clouds, found .*; can be mapped: sensor_msgs"
FILES = [
    Given("sparse/tello_kf_pointData.csv", 13_859, TELLO),
    Given("sparse/tello_room1.csv", 4_000, {"up": "-y"}),
    Given("sparse/tello_saloon.csv", 4_000, {"up": "-y"}),
    Given("sparse/tello_ragged_trailing_commas.csv", 2_000, {"up": "-y"}),
    Given("sparse/euroc_orb2_MapPoints.txt", 6_300),
    Given("sparse/euroc_orb3_pointcloud.txt", 4_492),
    Given("sparse/euroc_orb3_ref_pointcloud.txt", 7_800),
    Given("sparse/colmap_pysfm", 14_073, {"up": "-y"}),
    Given("sparse/opensfm_berlin", 1_430),
    Given("sparse/opensfm_berlin/reconstruction.json", 1_430),
    Given("sparse/stella_map_small.msg", "binary data of no known format; can be read: ROS 1 bags"),
    Given("bags/ros1_luminar_pc2_lz4.bag", "of which `topic` picks one: /base_scan"),
    Given(
        "bags/ros1_luminar_pc2_lz4.bag",
        "180,822 no transform at their time",
        {"topic": "/luminar_pointcloud", "pose_topic": "/base_pose_ground_truth"},
    ),
    Given(
        "bags/ros1_luminar_pc2_lz4.bag",
        150_000,
        {"topic": "/luminar_pointcloud", "frame": "luminar_lidar"},
    ),
    Given("bags/ros1_ouster_in_mcap_zstd.mcap", "`frame` os1_sensor says so"),
    Given("bags/ros1_ouster_in_mcap_zstd.mcap", 80_000, {"frame": "os1_sensor"}),
    Given("bags/ros1_jackal_scan_pose.bag", f"`pose_topic` {JACKAL_POSES} moves them"),
    Given("bags/ros1_jackal_scan_pose.bag", 20_000, {"pose_topic": JACKAL_POSES}),
    Given("bags/ros2_jackal_scan_pose", 20_000, {"pose_topic": JACKAL_POSES}),
    Given("bags/ros1_tilt_laser_tf.bag", 118_000),
    Given("bags/ros1_tf_example.bag", NO_CLOUDS),
    Given("bags/ros2_tf_example", NO_CLOUDS),
    Given("bags/ros2_nav2_turtlebot.mcap", NO_CLOUDS),
    Given("bags/ros1_example_bz2.bag", NO_CLOUDS),
    Given("bags/ros1_no_messages.bag", NO_CLOUDS),
    Given("bags/ros1_unsorted_chunks.bag", NO_CLOUDS),
    Given("multilevel/building_floors_cgal.ply", 100_000),
    Given("multilevel/als_bridge_samp21.pcd", 1_000),
    Given("multilevel/als_bridge_samp21_ground.pcd", 1_000),
    Given("multilevel/als_underpass_samp22.pcd", 1_000),
    Given("multilevel/als_underpass_samp22_ground.pcd", 1_000),
    Given("multilevel/unitree_ISR_scan_01_raw.xyz", 64_355),
    Given("multilevel/unitree_ISR_scan_02_raw.xyz", 16_596),
    Given("multilevel/unitree_ISR_scan_02_registered.xyz", 16_596),
    Given("multilevel/unitree_ISR_registration_metrics.json", "can be read: ROS 1 bags"),
    Given("multilevel/footbridge_yup_dddmr_map.pcd", 62_445, {"up": "y"}),
    Given("multilevel/drone_odm_defect_wall.laz", 79_892),
    Given("hard/csv_named_ply.ply", 1_000),
    # Its lines end as they did on the first Macintosh.
    Given("hard/csv_single_line_no_newlines.csv", 7_977),
    Given("hard/pcd_comma_body.pcd", 1),
    Given("hard/pcd_missingheader.pcd", 1),
    Given("hard/pcd_multi_count.pcd", 1),
    Given("hard/pcd_padded_underscore_viewpoint.pcd", 1_000),
    Given("hard/pcd_width0_height0.pcd", 1_000),
    Given("hard/pcd_zero_points.pcd", "holds no points"),
    Given("hard/ros1_unindexed.bag", "`frame` base_laser says so"),
    Given("hard/ros1_unindexed.bag", 10_000, {"frame": "base_laser"}, told="index"),
    Given("hard/vio_outliers_1e33.pcd", 3_000),
]


@pytest.mark.parametrize("given", FILES, ids=lambda given: given.name)
def test_every_file_is_mapped_or_refused_with_what_to_do(shared_data: Path, given: Given) -> None:
    path = shared_data / given.name
    if isinstance(given.outcome, str):
        with pytest.raises(MlsError, match=given.outcome) as refused:
            list(open_recording(path, **given.options).keyframes())
        assert "\n" not in str(refused.value)
        return
    recording = open_recording(path, **given.options)
    points = np.concatenate([keyframe.points for keyframe in recording.keyframes()])

    assert len(points) >= given.outcome
    assert len(points) == recording.tally.points_read - sum(recording.tally.dropped.values())
    assert np.abs(points).max() <= 1e8
    assert given.told in "; ".join(recording.losses)
    assert bool(given.told) == bool(recording.losses)


def test_no_file_is_left_out(shared_data: Path) -> None:
    folders = {"sparse/colmap_pysfm", "sparse/opensfm_berlin"}
    aside = {"README.md", "SHA256SUMS"}
    trajectories = {name for name in map(str, shared_data.rglob("*")) if "Trajectory" in name}
    named = {given.name for given in FILES}
    for path in shared_data.rglob("*"):
        name = path.relative_to(shared_data).as_posix()
        parents = {parent.as_posix() for parent in Path(name).parents}
        if path.is_file() and name not in aside and str(path) not in trajectories:
            assert name in named or parents & (named | folders), name
