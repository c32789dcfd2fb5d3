"""Formats, told by content.

How these tests could be cheated: by formats told by their endings, or by refusing only the very
files that are at hand. So contents stand under wrong names, and real files are joined by the
first bytes of others.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from mlscli.errors import InputError
from mlscli.io.reading.recording import open_recording
from mlscli.io.source import rows_by_first_appearance


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("sparse/stella_map_small.msg", "binary data"),
        ("sparse/opensfm_berlin/tracks.csv", "OPENSFM_TRACKS"),
        ("sparse/euroc_orb2_KeyFrameTrajectory_tum.txt", "`route`"),
        ("multilevel/unitree_ISR_registration_metrics.json", "JSON"),
        ("hard/pcd_zero_points.pcd", "holds no points"),
        ("bags/ros1_ouster_in_mcap_zstd.mcap", "`frame` os1_sensor"),
        ("bags/ros1_no_messages.bag", "no topics"),
        ("bags/ros1_jackal_scan_pose.bag", "`pose_topic` /vrpn_client_node/jackal/pose"),
        ("bags", "name one of them"),
    ],
)
def test_what_cannot_be_read_is_refused_by_name(shared_data: Path, name: str, words: str) -> None:
    with pytest.raises(InputError, match=words) as error:
        list(open_recording(shared_data / name).keyframes())
    assert name in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "nothing"),
        (b" \n\n", "nothing"),
        (b"1 2 3\n\x00\x01\x00", "binary"),
        ("1 2 \0\n".encode("utf-16"), "binary"),
        (b"ply\nformat ascii 1.0\n", "PLY"),
        (b"VERSION .7\nFIELDS x y z\n", "PCD"),
        (b"LASF" + bytes(300), "header"),
        (b"# Image list with two lines of data per image:\n", "COLMAP"),
        (b'[{"shots": {}, "points": {}}]', "holds no points"),
        (b"#ROSBAG V1.2\n", "expected '#ROSBAG V2.0'; the tools of ROS 1 convert older bags"),
        (b"#ROSBAG V2.0\n", "holds no clouds"),
        (b"\x89MCAP0\r\n", "holds no clouds"),
        (b"SQLite format 3\x00" + bytes(100), "pages have 0 bytes"),
        (b"\x1f\x8b\x08" + bytes(20), "gzip"),
    ],
)
def test_a_file_of_another_kind_is_refused_on_one_line(
    tmp_path: Path, content: bytes, words: str
) -> None:
    path = tmp_path / "cloud.xyz"
    path.write_bytes(content)

    with pytest.raises(InputError, match=words) as error:
        list(open_recording(path).keyframes())
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("name", "points"),
    [
        ("multilevel/building_floors_cgal.ply", 100_000),
        ("multilevel/als_bridge_samp21.pcd", 12_960),
        ("multilevel/drone_odm_defect_wall.laz", 79_892),
        ("sparse/opensfm_berlin/reconstruction.json", 1_430),
        ("hard/pcd_missingheader.pcd", 10),
        ("hard/csv_named_ply.ply", 4_697),
    ],
)
def test_a_file_is_told_by_what_it_holds(
    shared_data: Path, tmp_path: Path, name: str, points: int
) -> None:
    for other in ("cloud", "cloud.bag", "cloud.las"):
        (tmp_path / other).write_bytes((shared_data / name).read_bytes())
        recording = open_recording(tmp_path / other)
        assert sum(len(keyframe.points) for keyframe in recording.keyframes()) == points


def test_a_folder_of_nothing_that_is_known_says_what_lies_there(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is an empty folder; can be read: "):
        open_recording(tmp_path)
    for name in ("b.ply", "a.txt"):
        (tmp_path / name).write_text("1 2 3\n")
    held = r"holds a\.txt, b\.ply, and is no ROS 2 bag, COLMAP model or OpenSfM reconstruction"
    with pytest.raises(InputError, match=held):
        open_recording(tmp_path)


def test_a_folder_that_may_not_be_looked_into_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(folder: Path) -> None:
        raise PermissionError(13, "Permission denied", str(folder))

    monkeypatch.setattr(Path, "iterdir", refused)
    with pytest.raises(InputError, match=rf"{tmp_path}: cannot be read: Permission denied"):
        open_recording(tmp_path)


def test_what_is_not_there_or_no_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        open_recording(tmp_path / "none.bag")
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InputError, match="neither a file nor a folder"):
        open_recording(tmp_path / "pipe")


def test_rows_are_grouped_by_label_in_order_of_first_appearance() -> None:
    groups = rows_by_first_appearance(np.array([5, -1, 5, 9, -1]))

    assert [rows.tolist() for rows in groups] == [[0, 2], [1, 4], [3]]
    assert rows_by_first_appearance(np.empty(0)) == []
