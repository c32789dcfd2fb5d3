"""Every real file is mapped, or refused with a line that says what to do; docs/reading.md lists it.

How one could cheat: leave out the files that fail; take any error for the right one; document
options that nobody has tried.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from mlscli.cli import Run, commands
from mlscli.errors import MlsError, with_options

ROOT = Path(__file__).resolve().parents[2]
TELLO = "--columns x,y,z,-,-,-,-,keyframe,cx,cy,cz"
POSES = "--pose-topic /vrpn_client_node/jackal/pose"

MAPPED = [
    ("sparse/tello_kf_pointData.csv", f"{TELLO} --up auto", "102 in"),
    ("sparse/tello_room1.csv", "--up auto", "from -y"),
    ("sparse/tello_saloon.csv", "--up auto", "from -y"),
    ("sparse/tello_ragged_trailing_commas.csv", "--up auto", "8,658"),
    (
        "sparse/euroc_orb2_MapPoints.txt",
        "--up auto --route sparse/euroc_orb2_KeyFrameTrajectory_tum.txt",
        "75 in",
    ),
    (
        "sparse/euroc_orb3_pointcloud.txt",
        "--up auto --route sparse/euroc_orb3_KeyFrameTrajectory.txt",
        "311 in",
    ),
    ("sparse/euroc_orb3_ref_pointcloud.txt", "--up auto", "7,800"),
    ("sparse/colmap_pysfm", "--up -y", "11 in"),
    ("sparse/opensfm_berlin", "", "3 in"),
    (
        "bags/ros1_luminar_pc2_lz4.bag",
        "--topic /luminar_pointcloud --frame luminar_lidar",
        "5 in",
    ),
    (
        "bags/ros1_luminar_pc2_lz4.bag",
        "--topic /base_scan --pose-topic /base_pose_ground_truth --set map.cell_size=0.2",
        "450",
    ),
    ("bags/ros1_ouster_in_mcap_zstd.mcap", "--frame os1_sensor", "no return"),
    ("bags/ros1_jackal_scan_pose.bag", POSES, "189 in"),
    ("bags/ros2_jackal_scan_pose", POSES, "189 in"),
    ("bags/ros1_tilt_laser_tf.bag", "", "tilt_base"),
    ("multilevel/building_floors_cgal.ply", "", "100,000"),
    ("multilevel/als_bridge_samp21.pcd", "", "12,960"),
    ("multilevel/als_bridge_samp21_ground.pcd", "", "10,085"),
    ("multilevel/als_underpass_samp22.pcd", "", "32,706"),
    ("multilevel/als_underpass_samp22_ground.pcd", "", "22,504"),
    ("multilevel/unitree_ISR_scan_01_raw.xyz", "", "64,355"),
    ("multilevel/unitree_ISR_scan_02_raw.xyz", "", "16,596"),
    ("multilevel/unitree_ISR_scan_02_registered.xyz", "", "16,596"),
    ("multilevel/footbridge_yup_dddmr_map.pcd", "--up y", "62,445"),
    ("multilevel/drone_odm_defect_wall.laz", "", "79,892"),
    ("hard/csv_named_ply.ply", "", "4,697"),
    ("hard/csv_single_line_no_newlines.csv", "", "7,977"),
    ("hard/pcd_comma_body.pcd", "", "10"),
    ("hard/pcd_missingheader.pcd", "", "10"),
    ("hard/pcd_multi_count.pcd", "-c plain", "8"),
    ("hard/pcd_padded_underscore_viewpoint.pcd", "", "56,423"),
    ("hard/pcd_width0_height0.pcd", "", "7,729"),
    ("hard/vio_outliers_1e33.pcd", "", "30,217 beyond 1e8"),
    ("hard/ros1_unindexed.bag", "--frame base_laser", "175 in"),
]

# What is said of doubtful stamps, places, orders and headers; and where that is right.
DOUBTS = re.compile(
    r"pile up|by turns|their recording|one stamp|longitude|taken as [wx] |none of its times|"
    r"declares|byte order|outside the bounds|have hit nothing"
)
DOUBTED = "--topic /base_scan"

NO_CLOUDS = "can be mapped: sensor_msgs/msg/PointCloud2"
REFUSED = [
    ("sparse/euroc_orb2_KeyFrameTrajectory_tum.txt", "--route"),
    ("sparse/euroc_orb3_KeyFrameTrajectory.txt", "--route"),
    ("sparse/stella_map_small.msg", "can be read: "),
    ("bags/ros1_luminar_pc2_lz4.bag", "--topic picks one: /base_scan"),
    ("bags/ros1_ouster_in_mcap_zstd.mcap", "--frame os1_sensor"),
    ("bags/ros1_jackal_scan_pose.bag", POSES),
    ("bags/ros2_jackal_scan_pose", POSES),
    ("bags/ros1_tf_example.bag", NO_CLOUDS),
    ("bags/ros2_tf_example", NO_CLOUDS),
    ("bags/ros2_nav2_turtlebot.mcap", NO_CLOUDS),
    ("bags/ros1_example_bz2.bag", NO_CLOUDS),
    ("bags/ros1_no_messages.bag", "found no topics"),
    ("bags/ros1_unsorted_chunks.bag", NO_CLOUDS),
    ("multilevel/unitree_ISR_registration_metrics.json", "is a JSON file"),
    ("hard/pcd_zero_points.pcd", "holds no points"),
    ("hard/ros1_unindexed.bag", "--frame base_laser"),
]


def dry_run(source: str, options: str, tmp_path: Path) -> int:
    output = str(tmp_path / "map.npz")
    arguments = ["build", source, *options.split(), "-o", output, "--dry-run"]
    status: int = commands.main(arguments, "mls", standalone_mode=False, obj=Run())
    return status


@pytest.mark.parametrize(("source", "options", "told"), MAPPED)
def test_it_is_mapped_with_these_options_and_doubted_where_there_is_reason(
    source: str,
    options: str,
    told: str,
    shared_data: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(shared_data)
    filters = "" if "-c" in options else "-c plain"
    status = dry_run(source, f"{options} {filters}", tmp_path)
    assert status == (3 if "unindexed" in source else 0)
    said = capsys.readouterr()
    assert told in said.out
    assert bool(DOUBTS.search(said.err)) == (DOUBTED in options)


@pytest.mark.parametrize(("source", "advice"), REFUSED)
def test_it_is_refused_with_what_to_do(
    source: str, advice: str, shared_data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(shared_data)
    with pytest.raises(MlsError) as refusal:
        dry_run(source, "", tmp_path)
    assert str(refusal.value).startswith(source)
    assert advice in with_options(str(refusal.value))
    assert "\n" not in str(refusal.value)


def test_no_file_is_left_out(shared_data: Path) -> None:
    tried = {source for source, *_ in MAPPED + REFUSED}
    files = {file.relative_to(shared_data).as_posix() for file in shared_data.glob("*/*")}
    assert files == tried


def test_the_options_are_those_documented() -> None:
    rows = (ROOT / "docs/reading.md").read_text().partition("## Recordings at hand")[2]
    documented = re.sub(r"\.\.\./", "sparse/", rows)
    for source, options, _ in MAPPED:
        assert options in documented, source
