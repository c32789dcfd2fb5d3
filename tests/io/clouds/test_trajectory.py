"""Trajectories.

How these tests could be cheated: by columns split at blanks only, by time stamps taken for
seconds wherever they stand, or by lines counted without comments. Real files are compared with
Python's own reading of their numbers.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mlscli.errors import InputError
from mlscli.io.clouds.opening import read_opening
from mlscli.io.clouds.posecolumns import are_poses_of_a_craft
from mlscli.io.clouds.trajectory import Trajectory, read_trajectory
from tests.helpers.texts import text


def read(tmp_path: Path, content: str | bytes) -> Trajectory:
    return read_trajectory(text(tmp_path, content, "traj.txt"))


@pytest.mark.parametrize(
    ("name", "unit", "count"),
    [
        ("euroc_orb2_KeyFrameTrajectory_tum.txt", 1.0, 74),
        ("euroc_orb3_KeyFrameTrajectory.txt", 1e9, 310),
    ],
)
def test_real_trajectories_come_number_by_number(
    shared_data: Path, name: str, unit: float, count: int
) -> None:
    path = shared_data / "sparse" / name
    rows = [[float(word) for word in line.split()] for line in path.read_text().splitlines()]

    trajectory = read_trajectory(path)

    assert len(rows) == count
    assert trajectory.stamps.tolist() == [row[0] / unit for row in rows]
    assert trajectory.positions.tolist() == [row[1:4] for row in rows]
    assert trajectory.attitudes is not None
    np.testing.assert_allclose(trajectory.attitudes, [row[4:] for row in rows], atol=1e-6)
    assert trajectory.route.tolist() == [[row[0] / unit, *row[1:4]] for row in rows]
    # EuRoC was recorded on 24 and 25 June 2014.
    assert 1_403_568_000 < trajectory.stamps[0] < 1_403_740_800
    assert ["nanoseconds" in note for note in trajectory.notes] == [True] * (unit > 1)


@pytest.mark.parametrize(
    "content",
    [
        "1 2 3 4 0 0 0 1\n2 5 6 7 0 0 0 1\n",
        "# t x y z\n1,2,3,4,0,0,0,1\n\n2,5,6,7,0,0,0,1,\n",
        "stamp;x;y;z;qx;qy;qz;qw\r\n1;2;3;4;0;0;0;2\r\n2;5;6;7;0;0;0;1 # the end",
        b"\xef\xbb\xbf1\t2\t3\t4\t0\t0\t0\t1\r2\t5\t6\t7\t0\t0\t0\t1\r",
    ],
)
def test_a_trajectory_may_be_parted_and_commented_in_any_way(
    tmp_path: Path, content: str | bytes
) -> None:
    trajectory = read(tmp_path, content)

    assert trajectory.stamps.tolist() == [1, 2]
    assert trajectory.positions.tolist() == [[2, 3, 4], [5, 6, 7]]
    assert trajectory.attitudes is not None
    assert trajectory.attitudes.tolist() == [[0, 0, 0, 1]] * 2
    assert trajectory.notes == ()


def test_without_quaternions_the_attitude_is_not_known(tmp_path: Path) -> None:
    trajectory = read(tmp_path, "1 2 3 4\n2 5 6 7\n")

    assert trajectory.attitudes is None
    assert trajectory.at(np.array([1.5])).tolist() == [[3.5, 4.5, 5.5]]


def test_poses_are_in_the_order_of_time_and_the_last_of_a_time_counts(tmp_path: Path) -> None:
    trajectory = read(tmp_path, "3 1 0 0\n1 2 0 0\n3 4 0 0\n2 5 -0.0 0\n")

    assert trajectory.route.tolist() == [[1, 2, 0, 0], [2, 5, 0, 0], [3, 4, 0, 0]]
    assert not np.signbit(trajectory.route).any()
    again = "".join(f"{number % 7} {number} 0 0\n" for number in range(700))
    assert read(tmp_path, again).positions[:, 0].tolist() == list(range(693, 700))


def test_positions_between_are_interpolated_and_hold_for_half_a_period(tmp_path: Path) -> None:
    trajectory = read(tmp_path, "10 0 0 0\n11 1 0 0\n12 4 0 0\n")

    found = trajectory.at(np.array([9.5, 10.25, 11.5, 12.5, 9.4, 12.6, np.nan]))

    assert found[:4, 0].tolist() == [0, 0.25, 2.5, 4]
    assert np.isnan(found[4:]).all()


@pytest.mark.parametrize(
    ("last", "seconds"),
    [("99999999999", 99999999999.0), ("100000000000", 100.0), ("1.4e18", 1.4e9)],
)
def test_the_unit_of_time_is_told_by_its_size(tmp_path: Path, last: str, seconds: float) -> None:
    assert read(tmp_path, f"0 0 0 0\n{last} 1 1 1\n").stamps.tolist() == [0, seconds]


def test_lines_that_tell_no_pose_are_left_out_and_told(tmp_path: Path) -> None:
    trajectory = read(tmp_path, "1 0 0 0 0 0 0 1\n2 nan 0 0 0 0 0 1\n3 0 0 0 0 0 0 0\n")

    assert trajectory.stamps.tolist() == [1]
    (note,) = trajectory.notes
    assert "2 of 3 lines" in note


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("", "holds no poses"),
        ("# 1 2 3 4\n\n", "holds no poses"),
        ("stamp x y z\n", "holds no poses"),
        ("1 2 3\n", "3 columns"),
        ("1 2 3 4 5 6 7 8 9\n", "9 columns"),
        ("nan nan nan nan\n", "holds no poses"),
        ("# here\n1 2 3 4\n\n1 2 x 4\n", "traj.txt:4: found 'x' as y"),
        ("1 2 3 4 0 0 0 1\n2 3 4 5 0 0 0\n", "traj.txt:2: found 7 columns"),
        ("stamp x y z\n1 2 3 4\na b c d\n", "traj.txt:3: found 'a' as stamp"),
        (bytes(range(256)) * 10, "traj.txt"),
    ],
)
def test_what_is_no_trajectory_is_refused_on_one_line(
    tmp_path: Path, content: str | bytes, words: str
) -> None:
    with pytest.raises(InputError, match=words) as error:
        read(tmp_path, content)
    assert "\n" not in str(error.value)
    assert str(tmp_path) in str(error.value)


def test_a_trajectory_cut_anywhere_gives_its_whole_lines_or_one_error(
    shared_data: Path, tmp_path: Path
) -> None:
    whole = (shared_data / "sparse/euroc_orb2_KeyFrameTrajectory_tum.txt").read_bytes()[:2000]
    expected = whole.decode().splitlines()
    for size in range(1, len(whole), 7):
        lines = whole[:size].count(b"\n")
        try:
            trajectory = read(tmp_path, whole[:size])
        except InputError as error:
            assert "\n" not in str(error)  # noqa: PT017
            continue
        assert trajectory.stamps[:lines].tolist() == [
            float(line.split()[0]) for line in expected[:lines]
        ]


def test_what_cannot_be_read_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        read_trajectory(tmp_path / "none.txt")
    with pytest.raises(InputError, match="cannot be read"):
        read_trajectory(tmp_path)
    huge = tmp_path / "huge.txt"
    with huge.open("wb") as file:
        file.truncate(1 << 31)
    with pytest.raises(InputError, match="at most 1 GB"):
        read_trajectory(huge)


@pytest.mark.parametrize(
    "stamps_and_first_of_quaternion",
    [[("1", "1e300")], [("-inf", "0"), ("-inf", "0")], [("-1.7e308", "0"), ("1.7e308", "1e200")]],
)
def test_numbers_beyond_all_measure_are_no_trajectory_and_no_warning(
    tmp_path: Path, stamps_and_first_of_quaternion: list[tuple[str, str]]
) -> None:
    rows = [[stamp, *"000", x, *"001"] for stamp, x in stamps_and_first_of_quaternion]
    path = tmp_path / "a.txt"
    path.write_text("\n".join(" ".join(row) for row in rows))
    assert not are_poses_of_a_craft(read_opening(path))
    rows.append(["3", *"000", *"0001"])
    path.write_text("\n".join(" ".join(row) for row in rows))
    assert len(read_trajectory(tmp_path / "a.txt").stamps) > 0
