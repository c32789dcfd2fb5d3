"""Trajectories.

How these tests could be cheated: by columns split at blanks only, by time stamps taken for
seconds wherever they stand, or by lines counted without comments. Real files are compared with
Python's own reading of their numbers.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from mlscli.errors import InputError
from mlscli.io.clouds.opening import read_opening
from mlscli.io.clouds.posecolumns import are_poses_of_a_craft
from mlscli.io.clouds.text import TextCloud
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
        ("stamp,lat,lon,alt\n1,47,8,400\n2,47,8,401\n", "stamp,lat,lon,alt', which names no x, y"),
        ("# t lat lon alt\n1 47 8 400\n2 47 8 401\n", "names no x, y and z"),
        ("1 0 0 0 0.1 0.2 3 7\n2 0 0 0 0.1 0 1 7\n", "lengths from 7.07. to 7.61. in columns 5"),
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


# The formats in use


def turned(n: int) -> list[float]:
    """Return the quaternion x y z w of a craft that yaws by a degree each time."""
    return [0.0, 0.0, np.sin(n / 115), np.cos(n / 115)]


def written(form: str, count: int = 6) -> str:
    """Return a pose on each line: fields t, ns, n, p (x, y, z) and q (x, y, z, w)."""
    lines = []
    for n in range(count):
        t = 1403636580 + n / 4
        position, q = [n / 2, n % 2 + 0.25, 1.5], turned(n)
        ns = 1403636580 * 10**9 + n * 250_000_000
        lines.append(form.format(t=t, ns=ns, n=n, p=position, q=q))
    return "\n".join(lines) + "\n"


XYZ, XYZW, WXYZ = (
    "{p[0]} {p[1]} {p[2]}",
    "{q[0]} {q[1]} {q[2]} {q[3]}",
    "{q[3]} {q[0]} {q[1]} {q[2]}",
)
ROSTOPIC = (
    "%time,field.header.seq,field.header.stamp,field.header.frame_id,field.pose.position.x,"
    "field.pose.position.y,field.pose.position.z,field.pose.orientation.x,"
    "field.pose.orientation.y,field.pose.orientation.z,field.pose.orientation.w\n"
)
FORMATS = {
    "TUM": written(f"{{t}} {XYZ} {XYZW}"),
    "OpenVINS": "# timestamp(s) tx ty tz qx qy qz qw Pr11 Pr12 Pr13 Pr22 Pr23 Pr33\n"
    + written(f"{{t}} {XYZ} {XYZW} 0.01 0 0 0.01 0 0.01 "),
    "OpenVINS without its header": written(f"{{t}} {XYZ} {XYZW} 0.01 0 0 0.01 0 0.01 "),
    "RTAB-Map": "#timestamp x y z qx qy qz qw id\n" + written(f"{{t}} {XYZ} {XYZW} {{n}}"),
    "EuRoC": "#timestamp [ns], p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], "
    "q_RS_y [], q_RS_z [], v_RS_R_x [m s^-1], v_RS_R_y [m s^-1], v_RS_R_z [m s^-1]\n"
    + written(f"{{ns}} {XYZ} {WXYZ} 9 9 9").replace(" ", ","),
    "Kimera": "#timestamp,x,y,z,qw,qx,qy,qz,vx,vy,vz,bgx,bgy,bgz,bax,bay,baz\n"
    + written(f"{{ns}} {XYZ} {WXYZ} 1 2 3 4 5 6 7 8 9").replace(" ", ","),
    "OKVIS": "timestamp, p_WS_W_x, p_WS_W_y, p_WS_W_z, q_WS_x, q_WS_y, q_WS_z, q_WS_w\n"
    + written(f"{{ns}} {XYZ} {XYZW}").replace(" ", ", "),
    "VINS": written(f"{{ns}} {XYZ} {WXYZ} 0.1 0.2 0.3").replace(" ", ",").replace("\n", ",\n"),
    "a printed topic": ROSTOPIC
    + written(f"{{ns}} {{n}} {{ns}} map {XYZ} {XYZW}").replace(" ", ","),
    "attitudes before positions": written(f"{{ns}} {WXYZ} {XYZ}").replace(" ", ","),
    "attitudes before positions, in seconds": written(f"{{t}} {XYZW} {XYZ}"),
    "seconds and nanoseconds": "header.stamp.sec|header.stamp.nanosec|x|y|z|qx|qy|qz|qw\n"
    + re.sub(r"(?m)^(\d{10})", r"\1|", written(f"{{ns}} {XYZ} {XYZW}")).replace(" ", "|"),
    "microseconds": "t;x;y;z;qw;qx;qy;qz\n"
    + written(f"{{ns}} {XYZ} {WXYZ}").replace("000 ", " ").replace(" ", ";"),
}


@pytest.mark.parametrize("name", FORMATS)
def test_each_format_is_read_as_a_route_and_refused_as_a_cloud(tmp_path: Path, name: str) -> None:
    trajectory = read(tmp_path, FORMATS[name])

    # float64 holds nanoseconds since 1970 to a quarter of a microsecond.
    expected = [1403636580 + n / 4 for n in range(6)]
    np.testing.assert_allclose(trajectory.stamps, expected, rtol=0, atol=1e-6)
    assert trajectory.positions.tolist() == [[n / 2, n % 2 + 0.25, 1.5] for n in range(6)]
    assert trajectory.attitudes is not None
    np.testing.assert_allclose(trajectory.attitudes, [turned(n) for n in range(6)], atol=1e-12)
    assert trajectory.is_timed
    with pytest.raises(
        InputError, match="holds no cloud but a trajectory; name the cloud, and thi"
    ):
        list(TextCloud(tmp_path / "traj.txt").clouds())


@pytest.mark.parametrize("name", [*FORMATS, "KITTI"])
def test_the_columns_that_a_refused_trajectory_names_read_its_positions(
    tmp_path: Path, name: str
) -> None:
    content = "".join(map(kitti, range(6))) if name == "KITTI" else FORMATS[name]
    path = text(tmp_path, content)
    with pytest.raises(InputError, match="after `route`, or `columns`") as caught:
        list(TextCloud(path).clouds())
    columns = str(caught.value).split("`columns` ")[1].split()[0]

    points = np.concatenate([each.points for each in TextCloud(path, columns).clouds()])

    assert points.tolist() == [[n / 2, n % 2 + 0.25, 1.5] for n in range(6)]


@pytest.mark.parametrize(
    ("content", "order"),
    [
        (FORMATS["TUM"], "x y z w"),
        (FORMATS["OpenVINS"], ""),
        (FORMATS["VINS"], "w x y z"),
        # VINS-Fusion with its loops closed, and ground truth of motion capture without its header.
        (written(f"{{ns}} {XYZ} {WXYZ}").replace(" ", ",").replace("\n", ",\n"), "w x y z"),
        (written(f"{{ns}} {XYZ} {WXYZ}").replace(" ", ","), "w x y z"),
        (written(f"{{ns}} {XYZ} {XYZW}"), "x y z w"),
        (written(f"{{ns}} {WXYZ} {XYZ}").replace(" ", ","), "w x y z"),
        (written(f"{{t}} {XYZW} {XYZ}"), "x y z w"),
        (written(f"{{t}} {XYZ} {XYZW}").replace(" ", ","), "x y z w"),
        ("# stamp x y z qw qx qy qz\n" + written(f"{{t}} {XYZ} {WXYZ}"), ""),
        (written(f"{{t}} {XYZ}"), ""),
    ],
)
def test_the_order_of_a_quaternion_without_names_is_that_of_the_programs_that_write_so(
    tmp_path: Path, content: str, order: str
) -> None:
    trajectory = read(tmp_path, content)

    assert trajectory.order == order
    if trajectory.attitudes is not None:
        expected = [turned(n) for n in range(6)]
        np.testing.assert_allclose(trajectory.attitudes, expected, atol=1e-12)
    assert ["w x y z" in note for note in trajectory.notes if "taken as w" in note] == [True] * (
        order == "w x y z"
    )


def test_rounded_quaternions_are_read_and_named_ones_of_other_lengths_are_no_attitudes(
    tmp_path: Path,
) -> None:
    rounded = read(tmp_path, "1 0 0 0 0.38 0 0 0.92\n2 0 0 0 0.5 0.5 0.5 0.5\n")
    named = read(tmp_path, "stamp x y z qx qy qz qw\n1 1 2 3 0 0 0 5\n2 1 2 3 0 0 4 3\n")

    assert rounded.attitudes is not None
    np.testing.assert_allclose(rounded.attitudes[0], [0.38177, 0, 0, 0.92427], atol=1e-4)
    assert named.attitudes is None
    assert named.positions.tolist() == [[1, 2, 3]] * 2
    assert "lengths from 5 to 5 and not 1" in named.notes[0]


def test_a_matrix_that_was_cut_is_a_loss(tmp_path: Path) -> None:
    trajectory = read(tmp_path, matrix(0) + matrix(1) + "\n".join(matrix(2).split("\n")[:2]))

    assert len(trajectory.positions) == 2
    assert "the last matrix has 2 of 4 rows" in trajectory.losses[0]


@pytest.mark.parametrize("names", ["#name,x,y,z,heading,pitch,roll", "label,x,y,z,yaw,pitch,roll"])
def test_places_of_images_are_no_cloud_unless_images_have_many_points(
    tmp_path: Path, names: str
) -> None:
    rows = [f"{n}.JPG,{n},2,3,0,0,{n}" for n in range(6)]

    with pytest.raises(InputError, match="holds no cloud but a trajectory"):
        list(TextCloud(text(tmp_path, "\n".join([names, *rows]))).clouds())
    (cloud,) = TextCloud(text(tmp_path, "\n".join([names, *rows, *rows]))).clouds()
    assert len(cloud.points) == 12


def test_attitudes_before_positions_are_told_unless_names_say_so(tmp_path: Path) -> None:
    content = written(f"{{t}} {XYZW} {XYZ}")

    for header, told in (("", True), ("# stamp qx qy qz qw x y z\n", False)):
        notes = read(tmp_path, header + content).notes
        assert ["stand before the positions" in note for note in notes] == [True] * told


def kitti(n: int) -> str:
    c, s = np.cos(n / 57.5), np.sin(n / 57.5)
    return f"{c} {-s} 0 {n / 2} {s} {c} 0 {n % 2 + 0.25} 0 0 1 1.5\n"


def matrix(n: int) -> str:
    rows = [*kitti(n).split(), *"0001"]
    return "".join(" ".join(rows[k : k + 4]) + "\n" for k in (0, 4, 8, 12))


UNTIMED = {
    "KITTI": "".join(map(kitti, range(6))),
    "KITTI, 4 x 4": "".join(kitti(n)[:-1] + " 0 0 0 1\n" for n in range(6)),
    "a matrix on four lines": "".join(map(matrix, range(6))),
    "a matrix on four lines, after its numbers": "".join(
        f"{n} {n} 6\n{matrix(n)}" for n in range(6)
    ),
    "g2o": "EDGE_SE3:QUAT 0 1 1 2 3\n" + written(f"VERTEX_SE3:QUAT {{n}} {XYZ} {XYZW}") + "FIX 0\n",
    "positions and quaternions": written(f"{XYZ} {XYZW}"),
    "quaternions and positions": written(f"{XYZW} {XYZ}"),
}


@pytest.mark.parametrize("name", UNTIMED)
def test_poses_without_times_are_a_route_that_places_nothing(tmp_path: Path, name: str) -> None:
    trajectory = read(tmp_path, UNTIMED[name])

    assert trajectory.positions.tolist() == [[n / 2, n % 2 + 0.25, 1.5] for n in range(6)]
    assert trajectory.attitudes is not None
    np.testing.assert_allclose(trajectory.attitudes, [turned(n) for n in range(6)], atol=1e-9)
    assert not trajectory.is_timed
    assert np.isnan(trajectory.at(np.array([0.0, 1.0]))).all()
    assert sum("its poses have no times" in note for note in trajectory.notes) == 1
    cloud = TextCloud(tmp_path / "traj.txt")
    if "positions" in name:
        # Points with normals and their curvature look the same.
        assert len(list(cloud.clouds())) == 1
    else:
        with pytest.raises(InputError, match="holds no cloud but a trajectory"):
            list(cloud.clouds())


def test_flat_poses_of_a_graph_turn_about_z(tmp_path: Path) -> None:
    trajectory = read(tmp_path, "VERTEX_SE2 0 1 2 0\nVERTEX_SE2 1 3 4 1.5707963267948966\n")

    assert trajectory.positions.tolist() == [[1, 2, 0], [3, 4, 0]]
    assert trajectory.attitudes is not None
    np.testing.assert_allclose(trajectory.attitudes[1], [0, 0, 0.5**0.5, 0.5**0.5])
    with pytest.raises(
        InputError, match=r"traj.txt:2: found 'VERTEX_SE2 1 3', expected VERTEX_SE2"
    ):
        read(tmp_path, "VERTEX_SE2 0 1 2 0\nVERTEX_SE2 1 3\n")


def test_points_beside_the_pose_that_saw_them_are_points(tmp_path: Path) -> None:
    # Three points of each time; and points whose normal and curvature have length 1.
    seen = "t,x,y,z,qx,qy,qz,qw\n" + "".join(f"{n // 3},{n},0.5,1,0,0,0,1\n" for n in range(9))
    assert len(list(TextCloud(text(tmp_path, seen)).clouds())) == 3
    normals = "".join(f"{n % 4}.5 {n % 3} 2 0 0 1 0\n" for n in range(9))
    assert len(list(TextCloud(text(tmp_path, normals)).clouds())) == 1


def test_a_trajectory_cut_in_its_last_line_is_read_up_to_there(tmp_path: Path) -> None:
    trajectory = read(tmp_path, "1 2 3 4 0 0 0 1\n2 3 4 5 0 0 0 1\n3 4 5 6 0")

    assert trajectory.stamps.tolist() == [1, 2]
    (loss,) = trajectory.losses
    assert "traj.txt:3: found 5 columns" in loss
    assert "cut there, and 1 row is left out" in loss
    assert not trajectory.notes
