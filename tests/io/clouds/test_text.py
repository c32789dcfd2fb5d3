"""Text clouds.

How these tests could be cheated: by reading one separator well and losing empty fields of the
others, by numbers that are near the written ones, by grouping runs of rows instead of keyframes,
by line numbers that count only lines with points, or by files that fit one block. So files are
drawn at random with all of this in one, read in blocks of a few characters too, and compared bit
for bit with what was written; real files are compared with Python's own csv reader.
"""

from __future__ import annotations

import csv
import math
import random
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mlscli.errors import InputError
from mlscli.io.clouds import rows as rows_module
from mlscli.io.clouds.text import TextCloud
from tests.helpers.texts import clouds_of, one_cloud, read, text

TELLO_COLUMNS = "x,y,z,-,-,-,-,keyframe,cx,cy,cz"


# Real files


def test_the_tello_flight_has_its_keyframes_in_order_of_first_appearance(
    shared_data: Path,
) -> None:
    path = shared_data / "sparse/tello_kf_pointData.csv"
    expected: dict[str, list[list[float]]] = {}
    centres: dict[str, tuple[float, ...]] = {}
    with path.open() as file:
        for row in csv.reader(file):
            expected.setdefault(row[7], []).append([float(word) for word in row[:3]])
            centres.setdefault(row[7], tuple(float(word) for word in row[8:11]))

    clouds = list(TextCloud(path, TELLO_COLUMNS).clouds())

    assert len(clouds) == 102
    assert [cloud.points.tolist() for cloud in clouds] == list(expected.values())
    assert [cloud.position for cloud in clouds] == list(centres.values())


@pytest.mark.parametrize(
    ("name", "separator", "header"),
    [
        ("sparse/tello_ragged_trailing_commas.csv", ",", 0),
        ("sparse/tello_room1.csv", ",", 0),
        ("sparse/euroc_orb2_MapPoints.txt", None, 0),
        ("sparse/euroc_orb3_pointcloud.txt", ",", 0),
        ("sparse/euroc_orb3_ref_pointcloud.txt", ",", 1),
        ("hard/csv_named_ply.ply", ",", 1),
        ("hard/csv_single_line_no_newlines.csv", ",", 0),
    ],
)
def test_real_clouds_come_number_by_number(
    shared_data: Path, name: str, separator: str | None, header: int
) -> None:
    path = shared_data / name
    rows = path.read_text().splitlines()[header:]
    expected = [[float(word) for word in row.split(separator)[:3]] for row in rows]

    (cloud,) = TextCloud(path).clouds()

    assert cloud.points.tolist() == expected


# Numbers and separators


@st.composite
def written(draw: st.DrawFn) -> tuple[str, list[list[list[float]]]]:
    """Draw a text of x, y, z, label, and the keyframes that it holds."""
    numbers = st.floats(allow_nan=False) | st.floats(-100, 100).map(lambda v: round(v, 4))
    rows = draw(
        st.lists(st.tuples(numbers, numbers, numbers, st.integers(-3, 3)), min_size=1, max_size=12)
    )
    dice = random.Random(draw(st.integers(0, 2**32)))
    keyframes: dict[int, list[list[float]]] = {}
    lines = []
    separators = dice.choice(
        [[",", ", ", " ,"], [";", "; ", ";\t"], ["\t", "\t "], [" ", "  ", "\t", " \t"]]
    )
    for x, y, z, label in rows:
        keyframes.setdefault(label, []).append([x, y, z])
        line = dice.choice(["", " ", "\t "]) + repr(x)
        for word in (repr(y), repr(z), str(label)):
            line += dice.choice(separators) + word
        line += dice.choice(["", "", ",,", " ; ", "\t"]) + dice.choice(["", "", "# a, comment"])
        lines.append(line)
        lines += dice.choice([[], [], ["# 1 2 3 4"], [""], ["// x"], [" \t"], [",,"]])
    ending = dice.choice(["\n", "\r\n", "\r"])
    return ending.join(lines) + dice.choice(["", ending]), list(keyframes.values())


@pytest.mark.parametrize("block", [1 << 22, 5])
@given(example=written())
@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_what_was_written_is_read_bit_for_bit(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    block: int,
    example: tuple[str, list[list[list[float]]]],
) -> None:
    monkeypatch.setattr(rows_module, "BLOCK_CHARACTERS", block)
    content, expected = example

    clouds = read(tmp_path, content, "x,y,z,keyframe")

    assert len(clouds) == len(expected)
    for cloud, points in zip(clouds, expected, strict=True):
        assert cloud.points.tobytes() == np.array(points).tobytes()


def test_words_for_what_is_no_number_are_numbers(tmp_path: Path) -> None:
    (cloud,) = read(tmp_path, "nan 1 -inf\nInfinity NaN 2e3\n")

    np.testing.assert_array_equal(cloud.points, [[np.nan, 1, -np.inf], [np.inf, np.nan, 2000]])


@pytest.mark.parametrize("row", ["1,,3", "1, ,3", "1;;3", '"1","","3"', "1,,3,"])
def test_an_empty_field_is_a_missing_value(tmp_path: Path, row: str) -> None:
    (cloud,) = read(tmp_path, f"{row}\n")

    np.testing.assert_array_equal(cloud.points, [[1, np.nan, 3]])


def test_a_field_missing_at_the_start_is_a_missing_value(tmp_path: Path) -> None:
    (cloud,) = read(tmp_path, ",2,3\n")

    np.testing.assert_array_equal(cloud.points, [[np.nan, 2, 3]])


def test_a_byte_order_mark_is_no_part_of_the_first_number(tmp_path: Path) -> None:
    assert one_cloud(tmp_path, b"\xef\xbb\xbf1 2 3\n4 5 6") == [[1, 2, 3], [4, 5, 6]]


# Keyframes


@pytest.mark.parametrize("gap", ["\n", "\n\n\n", " \t\n", ",,,\n"])
@pytest.mark.parametrize("block", [1 << 22, 3])
def test_blank_lines_end_a_keyframe(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, gap: str, block: int
) -> None:
    monkeypatch.setattr(rows_module, "BLOCK_CHARACTERS", block)
    clouds = clouds_of(tmp_path, f"{gap}1 2 3\n4 5 6\n{gap}7 8 9\n{gap}")

    assert clouds == [[[1, 2, 3], [4, 5, 6]], [[7, 8, 9]]]


def test_a_comment_between_points_ends_no_keyframe(tmp_path: Path) -> None:
    assert one_cloud(tmp_path, "1 2 3\n# here\n4 5 6\n") == [[1, 2, 3], [4, 5, 6]]


def test_blank_lines_mean_nothing_where_a_column_names_the_keyframe(tmp_path: Path) -> None:
    assert one_cloud(tmp_path, "x,y,z,kf\n1,2,3,5\n\n4,5,6,5\n") == [[1, 2, 3], [4, 5, 6]]


def test_a_fourth_column_of_whole_numbers_is_the_keyframe(tmp_path: Path) -> None:
    assert clouds_of(tmp_path, "1 0 0 9\n2 0 0 4\n3 0 0 9\n") == [
        [[1, 0, 0], [3, 0, 0]],
        [[2, 0, 0]],
    ]


@pytest.mark.parametrize("last", ["0.5", "label", "nan", ""])
@pytest.mark.parametrize("block", [1 << 22, 3])
def test_a_fourth_column_of_anything_else_is_not_used_and_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, last: str, block: int
) -> None:
    monkeypatch.setattr(rows_module, "BLOCK_CHARACTERS", block)
    cloud = TextCloud(text(tmp_path, f"1 0 0 9\n2 0 0 4\n3 0 0 {last}\n"))

    assert [c.points.tolist() for c in cloud.clouds()] == [[[1, 0, 0], [2, 0, 0], [3, 0, 0]]]
    note, *others = cloud.notes
    assert "fourth column" in note
    assert "`columns`" in note
    assert ["1 of 3 rows has more or fewer columns" in note for note in others] == [True] * (
        not last
    )


def test_columns_after_the_fourth_make_none_a_keyframe_and_are_told(tmp_path: Path) -> None:
    cloud = TextCloud(text(tmp_path, "1 0 0 9 1\n2 0 0 4 1\n"))

    assert cloud.expected_keyframes == 1
    assert ["2 columns after x, y, z" in note for note in cloud.notes] == [True]


def test_the_first_row_says_when_and_where_a_keyframe_was_seen(tmp_path: Path) -> None:
    content = "1 0 0 7 10.5 1 2 3\n1 0 0 8 11 4 5 6\n1 0 0 7 99 9 9 9\n"
    clouds = read(tmp_path, content, "x,y,z,keyframe,t,cx,cy,cz")

    assert [(cloud.stamp, cloud.position) for cloud in clouds] == [
        (10.5, (1, 2, 3)),
        (11.0, (4, 5, 6)),
    ]
    assert TextCloud(tmp_path / "cloud.txt", "x,y,z,-,t").time_span() == (10.5, 99.0)


@pytest.mark.parametrize("headed", [False, True])
def test_the_first_row_says_how_the_craft_was_held(tmp_path: Path, headed: bool) -> None:
    names = "qx,qy,qz,qw,x,y,z,keyframe"
    rows = "1,2,3,4,0,0,0,7\n,,,,0,0,1,8\n9,9,9,9,0,0,2,7\n"
    first, second = read(
        tmp_path, f"{names}\n{rows}" if headed else rows, None if headed else names
    )

    assert first.attitude == (1, 2, 3, 4)
    assert (first.axes, first.has_attitude) == ("unknown", True)
    assert not second.has_attitude
    assert first.points[:, 2].tolist() == [0, 2]


def test_a_header_with_a_part_of_an_attitude_has_other_numbers_of_these_names(
    tmp_path: Path,
) -> None:
    (cloud,) = read(tmp_path, "x,y,z,qw,qx\n1,2,3,4,5\n")

    assert cloud.points.tolist() == [[1, 2, 3]]
    assert not cloud.has_attitude


def test_points_of_one_time_are_a_keyframe_where_no_column_tells(tmp_path: Path) -> None:
    content = "x,y,z,t\n1,0,0,7.5\n2,0,0,8\n\n3,0,0,7.5\n4,0,0,8\n"
    clouds = read(tmp_path, content)

    assert [cloud.stamp for cloud in clouds] == [7.5, 8.0]
    assert [cloud.points[:, 0].tolist() for cloud in clouds] == [[1, 3], [2, 4]]


def test_times_that_each_point_has_for_itself_tell_no_keyframes(tmp_path: Path) -> None:
    cloud = TextCloud(text(tmp_path, "1 0 0 7.1\n2 0 0 7.2\n\n3 0 0 7.3\n"), "x,y,z,t")

    assert [len(each.points) for each in cloud.clouds()] == [2, 1]
    assert ["a time of their own" in note for note in cloud.notes] == [True]


def test_a_trajectory_given_for_a_cloud_is_refused_unless_columns_say_otherwise(
    tmp_path: Path, shared_data: Path
) -> None:
    for name, poses in (
        ("euroc_orb2_KeyFrameTrajectory_tum.txt", 74),
        ("euroc_orb3_KeyFrameTrajectory.txt", 310),
    ):
        path = shared_data / "sparse" / name
        with pytest.raises(InputError, match="`route`"):
            list(TextCloud(path).clouds())
        (cloud,) = TextCloud(path, "-,x,y,z").clouds()
        assert len(cloud.points) == poses
    # Eight columns that do not end in quaternions, or do not begin with times.
    for row in ("1 0 0 0 0 0 0 2\n", "1 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n"):
        assert len(read(tmp_path, row)) == 1


def test_without_such_columns_time_and_place_are_not_known(tmp_path: Path) -> None:
    (cloud,) = read(tmp_path, "1 2 3\n")

    assert math.isnan(cloud.stamp)
    assert np.isnan(cloud.position).all()


@pytest.mark.parametrize(
    ("header", "row"),
    [
        ("label,x,y,z", '"P\n{n}",{0},{1},{2}'),
        ("x,y,z,label", '{0},{1},{2},"P {n}\n"'),
        ("x;label;y;z", '{0};"wall;\n\n no. {n}\n";{1};{2}'),
        ("x,y,z,label", '{0},{1},{2}, "a ""{n}""\n"'),
        # Inches.
        ("x,y,z,label", '{0},{1},{2},{n}"'),
        ("label,x,y,z", '5" {n},{0},{1},{2}'),
    ],
)
def test_a_row_whose_quotes_protect_line_breaks_is_one_and_single_marks_join_nothing(
    tmp_path: Path, header: str, row: str
) -> None:
    points = [[k + 0.5, 2.0 * k, -0.25 * k] for k in range(40)]
    rows = [
        (row.replace("\n", "") if k % 3 == 0 else row).format(*point, n=k)
        for k, point in enumerate(points)
    ]
    source = TextCloud(text(tmp_path, "\n".join([header, *rows, ""])))

    assert [cloud.points.tolist() for cloud in source.clouds()] == [points]
    assert not source.losses


@pytest.mark.parametrize("size", range(30, 90, 7))
def test_a_row_whose_quotes_protect_line_breaks_may_lie_across_blocks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, size: int
) -> None:
    monkeypatch.setattr(rows_module, "BLOCK_CHARACTERS", size)
    points = [[k + 0.5, 2.0 * k, -0.25 * k] for k in range(40)]
    breaks = ["\n" * (1 + k % 4) for k in range(40)]
    rows = [f'"wall{breaks[k]}no. {k}",{x},{y},{z}' for k, (x, y, z) in enumerate(points)]
    source = TextCloud(text(tmp_path, "\n".join(["label,x,y,z", "P,9,9,9", *rows, ""])))

    assert [cloud.points.tolist() for cloud in source.clouds()] == [[[9, 9, 9], *points]]
    assert not source.losses


@pytest.mark.parametrize(
    "content",
    [
        "1|2|3|a b\n4|5|6|c, d\n",
        "x | y | z | label\n1 | 2 | 3 | a\n4 | 5 | 6 | b\n",
        "| label | x | y | z |\n|---|---|---|---|\n| 7 | 1 | 2 | 3 |\n| 8 | 4 | 5 | 6 |\n",
        "|x|y|z\n0|1|2|3\n1|4|5|6\n",
    ],
)
def test_bars_separate_also_at_the_ends_of_rows(tmp_path: Path, content: str) -> None:
    assert one_cloud(tmp_path, content) == [[1, 2, 3], [4, 5, 6]]


def test_decimal_commas_between_bars_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="'1,5' as x, expected a number with a decimal point"):
        read(tmp_path, "1,5|2,5|3,5\n1,5|2,5|4,5\n")


def test_a_single_mark_before_a_row_on_two_lines_joins_nothing(tmp_path: Path) -> None:
    content = 'label,x,y,z\nP,0,1,2\n6",3,4,5\n"a\n",6,7,8\n7",1,1,1\n'
    source = TextCloud(text(tmp_path, content))

    assert [cloud.points.tolist() for cloud in source.clouds()] == [
        [[0, 1, 2], [3, 4, 5], [6, 7, 8], [1, 1, 1]]
    ]
    assert not source.losses


@pytest.mark.parametrize("corners", [3, 4])
@pytest.mark.parametrize(("vertices", "faces"), [(8, 12), (400, 700), (400, 20)])
def test_a_mesh_without_its_first_line_is_no_cloud(
    tmp_path: Path, vertices: int, faces: int, corners: int
) -> None:
    rng = random.Random(1)
    points = [" ".join(f"{rng.random():.3f}" for _ in range(3)) for _ in range(vertices)]
    sides = [
        " ".join(map(str, (corners, *(rng.randrange(vertices) for _ in range(corners)))))
        for _ in range(faces)
    ]
    named = f"is a mesh, an OFF without its first line: {vertices} vertices and {faces} faces"
    with pytest.raises(InputError, match=named):
        read(tmp_path, "\n".join((f"{vertices} {faces} 0", *points, *sides, "")))


def test_ragged_rows_after_three_whole_numbers_are_a_cloud(tmp_path: Path) -> None:
    rows = [f"{n} {n * n % 7} 0.5{' 9' * (n > 90)}" for n in range(100)]
    assert len(np.array(one_cloud(tmp_path, "\n".join(("60 39 0", *rows, ""))))) == 101
