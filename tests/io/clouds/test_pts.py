"""PTS files as clouds.

How these tests could be cheated: by one layout, by one scan, by a count taken at its word, in time
or in memory, or by text clouds that are taken away from their reader. So files are drawn at random
and written here by the format's description, with any layout, number of scans and line ends, and
read in blocks of a few characters, too; counts lie; files are cut at many places, where just the
whole points must come and the rest be told; and what was a text cloud must stay one.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mlscli.errors import InputError
from mlscli.io.clouds import rows as rows_module
from mlscli.io.reading.formats import open_source
from mlscli.runtime.arrays import Float64
from tests.helpers.damage import cut, flipped, read_damaged
from tests.helpers.meshes import open3d
from tests.helpers.texts import text

LAYOUTS = ["xyz", "xyzi", "xyzrgb", "xyzirgb"]
MARK = "\ufeff"


def read(folder: Path, content: str | bytes) -> tuple[list[Any], list[str], list[str]]:
    """Return the points of each keyframe, the notes and the losses, of a file named otherwise."""
    source = open_source(text(folder, content, "cloud.las"))
    assert source.kind == "PTS cloud"
    return [cloud.points.tolist() for cloud in source.clouds()], [*source.notes], [*source.losses]


def damaged(folder: Path, content: str | bytes) -> tuple[Float64, list[str]] | None:
    return read_damaged(text(folder, content), open_source)


def parsed(content: str) -> list[list[list[float]]]:
    """Return the points of each scan of a file without damage, by the format's description."""
    rows = [row.split() for row in content.splitlines()]
    scans, at = [], 0
    while at < len(rows):
        (count,) = rows[at]
        scan = rows[at + 1 : at + 1 + int(count)]
        scans.append([[float(word) for word in row[:3]] for row in scan])
        at += 1 + len(scan)
    return scans


def scanned(count: int, layout: str = "xyzirgb", seed: int = 1) -> str:
    """Return the lines of a scan, the first with the number of its points."""
    dice = np.random.default_rng(seed)
    rows = [f"{count}"]
    for xyz in dice.normal(size=(count, 3)) * 1e3:
        words = [f"{value:.4f}" for value in xyz]
        words += [str(dice.integers(-2048, 2048))] if "i" in layout else []
        words += [str(value) for value in dice.integers(0, 256, 3)] if "g" in layout else []
        rows.append(" ".join(words))
    return "\n".join(rows) + "\n"


# Layouts


@st.composite
def written(draw: st.DrawFn) -> tuple[str, list[list[list[float]]]]:
    """Draw a file, and the points of each of its scans."""
    layout = draw(st.sampled_from(LAYOUTS))
    coordinate = st.floats(allow_nan=False, allow_infinity=False) | st.integers(-9, 9)
    numbers = {"i": st.integers(-2048, 2047) | st.floats(0, 1)} | dict.fromkeys(
        "rgb", st.integers(0, 255)
    )
    blank = st.sampled_from([" ", "\t", "  "])
    edge = st.sampled_from(["", "", " ", "\t "])
    lines, scans = [], []
    for _ in range(draw(st.integers(1, 4))):
        rows = draw(
            st.lists(
                st.tuples(*(numbers.get(n, coordinate) for n in layout)), min_size=1, max_size=5
            )
        )
        lines.append(draw(edge) + str(len(rows)) + draw(edge))
        lines += [draw(edge) + draw(blank).join(map(repr, row)) + draw(edge) for row in rows]
        lines += draw(st.sampled_from([[], [], ["", " "]]))
        scans.append([[float(number) for number in row[:3]] for row in rows])
    ending = draw(st.sampled_from(["\n", "\r\n", "\r"]))
    start = draw(st.sampled_from(["", MARK])) + draw(st.sampled_from(["", ending]))
    return start + ending.join(lines) + draw(st.sampled_from(["", ending])), scans


@pytest.mark.parametrize("block", [1 << 22, 5])
@given(example=written())
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_what_was_written_is_read_bit_for_bit(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    block: int,
    example: tuple[str, list[list[list[float]]]],
) -> None:
    monkeypatch.setattr(rows_module, "BLOCK_CHARACTERS", block)
    content, scans = example

    source = open_source(text(tmp_path, content))
    clouds = list(source.clouds())

    assert source.kind == "PTS cloud"
    assert ([*source.notes], [*source.losses]) == ([], [])
    assert len(clouds) == len(scans)
    for cloud, points in zip(clouds, scans, strict=True):
        assert cloud.points.tobytes() == np.array(points, dtype=np.float64).tobytes()


def test_a_scan_longer_than_a_block_and_a_second_one_come_bit_for_bit(tmp_path: Path) -> None:
    content = scanned(150_000, "xyzi") + scanned(7, "xyzi")
    assert len(content) > rows_module.BLOCK_CHARACTERS

    assert read(tmp_path, content) == (parsed(content), [], [])


def test_digits_that_float32_cannot_hold_are_kept(tmp_path: Path) -> None:
    content = "1\n572273.12345 4498560.45678 36.84250641 -2048 0 128 255\n"

    assert read(tmp_path, content)[0] == [[[572273.12345, 4498560.45678, 36.84250641]]]


@pytest.mark.parametrize("coloured", [False, True])
def test_what_open3d_writes_is_read(tmp_path: Path, coloured: bool) -> None:
    o3d = open3d()
    points = np.random.default_rng(1).normal(size=(500, 3)) * 1e3
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    if coloured:
        cloud.paint_uniform_color([0.1, 0.5, 1.0])
    o3d.io.write_point_cloud(str(tmp_path / "a.pts"), cloud)

    content = (tmp_path / "a.pts").read_text()

    assert read(tmp_path, content) == (parsed(content), [], [])
    # It writes ten digits after the point.
    np.testing.assert_allclose(parsed(content)[0], points, rtol=0, atol=5.1e-11)


def test_of_widths_that_are_as_frequent_that_of_the_first_point_counts(tmp_path: Path) -> None:
    points, _, losses = read(tmp_path, "2\n1 2 3\n4 5 6 x\n")
    assert points == [[[1, 2, 3]]]
    assert "1 of 2 points is missing" in losses[0]


def test_a_scan_without_points_is_no_keyframe(tmp_path: Path) -> None:
    assert read(tmp_path, "1\n1 2 3\n0\n1\n4 5 6\n") == ([[[1, 2, 3]], [[4, 5, 6]]], [], [])


# What is a text cloud stays one


@pytest.mark.parametrize(
    "content",
    [
        "1 2 3\n4 5 6\n",
        "1 2 3\n1\n1 2 3\n",
        "# 2\n1 2 3\n4 5 6\n",
        "x y z\n1 2 3\n4 5 6\n",
        "1\n2\n3\n",
        "2",
        "2\n\n",
        "2\n1 2\n",
        "2\n1 2 3 4 5\n",
        "2\n1 2 3 4 5 6 7 8\n",
        "2\n1 2 three\n",
        "2\n1_0 2 3\n",
        "2\n1,5 2,5 3,5\n",
        "2\nx y z\n1 2 3\n",
        "+2\n1 2 3\n",
        "-2\n1 2 3\n",
        "2.0\n1 2 3\n",
        "2e3\n1 2 3\n",
        "2,\n1,2,3\n",
        "\u0662\n1 2 3\n",
        "9" * 5000 + "\n1 2 3\n",
    ],
)
def test_a_text_without_a_count_and_a_point_is_no_pts(tmp_path: Path, content: str) -> None:
    assert open_source(text(tmp_path, content, "cloud.pts")).kind == "text cloud"


NO_POINT = r"cloud.pts:1: found 1 column \('3'\), expected y"


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("3", NO_POINT),
        ("3\n", NO_POINT),
        ("3\n1 2", NO_POINT),
        ("3\n3\n1 2 3\n", NO_POINT),
        ("3\n1 2 x\n", "cloud.pts:2: found 'x' as z, expected a number"),
    ],
)
def test_where_count_or_first_point_are_none_the_line_is_named(
    tmp_path: Path, content: str, said: str
) -> None:
    with pytest.raises(InputError, match=said) as error:
        list(open_source(text(tmp_path, content, "cloud.pts")).clouds())
    assert "\n" not in str(error.value)


# Damage


@pytest.mark.parametrize("count", [2, 10**12, 10**39])
def test_a_promise_that_the_file_cannot_hold_is_a_loss(tmp_path: Path, count: int) -> None:
    found = damaged(tmp_path, f"{count}\n1 2 3\n")

    assert found is not None
    assert found[0].tolist() == [[1, 2, 3]]
    (loss,) = found[1]
    assert f"{count - 1:,} of {count:,} points " in loss
    assert "missing: the file ends before them" in loss


def test_points_beyond_the_count_are_read_and_noted(tmp_path: Path) -> None:
    for ending in ("", "\n"):
        clouds, notes, losses = read(tmp_path, f"1\n1 2 3\n4 5 6\n2\n7 8 9\n1 1 1\n2 2 2{ending}")
        assert clouds == [[[1, 2, 3], [4, 5, 6]], [[7, 8, 9], [1, 1, 1], [2, 2, 2]]]
        assert losses == []
        (note,) = notes
        assert "declares 3 points, and there are 5; all are taken" in note


def test_points_beyond_one_count_make_not_up_for_those_another_scan_lacks(tmp_path: Path) -> None:
    clouds, notes, losses = read(tmp_path, "3\n1 2 3\n1\n4 5 6\n7 8 9\n1 1 1\n")

    assert [len(points) for points in clouds] == [1, 3]
    assert "declares 1 point, and there are 3; all are taken" in notes[0]
    assert "2 of 6 points are missing: scan 1 ends before them" in losses[0]


@pytest.mark.parametrize("block", [1 << 22, 3])
@pytest.mark.parametrize(
    ("broken", "found"),
    [
        ("4 5 6", "'4 5 6'"),
        ("4.", "'4.'"),
        ("-4", "'-4'"),
        ("4 5 6 7 8", "'4 5 6 7 8'"),
        ("4 5 6 7 8 9 9 8", "'4 5 6 7 8 9 9 8'"),
        ("4 5 x 6", "'4 5 x 6'"),
        ("4 5 6 x", "'4 5 6 x'"),
        ("4,5 6 7 8", "'4,5 6 7 8'"),
        ("4 5 6 7 # 8", "'4 5 6 7 # 8'"),
        ("4 5 6 1_0", "'4 5 6 1_0'"),
        ("4 5 6 7\0", r"'4 5 6 7\x00'"),
    ],
)
def test_broken_lines_are_left_out_and_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, broken: str, found: str, block: int
) -> None:
    monkeypatch.setattr(rows_module, "BLOCK_CHARACTERS", block)
    content = f"3\n1 2 3 4\n\n{broken}\n7 8 9 9\n1\n{broken}\n1 1 1 1\n"

    clouds, notes, losses = read(tmp_path, content)

    assert clouds == [[[1, 2, 3], [7, 8, 9]], [[1, 1, 1]]]
    assert notes == []
    (loss,) = losses
    assert f"2 of 5 points are missing: the first is line 4, found {found}, expected 4 num" in loss


def test_a_first_point_that_is_cut_sets_no_measure(tmp_path: Path) -> None:
    clouds, _, losses = read(tmp_path, "3\n1 2 3 4\n" + "1 2 3 4 5 6 7\n" * 2)

    assert clouds == [[[1, 2, 3], [1, 2, 3]]]
    assert "1 of 3 points is missing: the first is line 2, found '1 2 3 4', exp" in losses[0]


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("ending", ["\n", "\r\n"])
def test_of_a_cut_file_the_whole_points_come(tmp_path: Path, layout: str, ending: str) -> None:
    content = (scanned(40, layout) + scanned(30, layout, seed=2)).replace("\n", ending).encode()
    first, second = parsed(content.decode())
    rows = content.splitlines(keepends=True)
    begins = [sum(map(len, rows[:number])) for number in range(len(rows))]
    # Where lines end for a reader that takes CR for the end of a line, too.
    ends = [begin + len(row.rstrip()) + 1 for begin, row in zip(begins, rows, strict=True)]
    for part in cut(content, 150):
        found = damaged(tmp_path, part)
        if any(begins[last] < len(part) < ends[last] for last in (40, 71)):
            continue  # The last row of a scan may lack its line's end.
        whole = sum(end <= len(part) for end in (*ends[1:41], *ends[42:]))
        if found is None:
            assert whole == 0
            continue
        assert found[0].tolist() == (first + second)[:whole]
        # Between two scans nothing shows the cut.
        assert bool(found[1]) == (whole < 70 and len(part) not in (ends[40], begins[41]))


def test_a_cut_count_is_a_loss_and_a_cut_coordinate_no_count(tmp_path: Path) -> None:
    clouds, _, losses = read(tmp_path, "1\n1 2 3\n20")
    assert clouds == [[[1, 2, 3]]]
    assert "20 of 21 points are missing: the file ends before them" in losses[0]

    clouds, _, losses = read(tmp_path, "3\n1 2 3\n20")
    assert clouds == [[[1, 2, 3]]]
    assert "2 of 3 points are missing: the file ends before them" in losses[0]


def test_a_flipped_bit_is_an_error_a_loss_a_note_or_one_wrong_number(tmp_path: Path) -> None:
    content = (scanned(40) + scanned(20, seed=2)).encode()
    expected = np.concatenate(parsed(content.decode()))
    for part in flipped(content, 300, 60):
        found = damaged(tmp_path, part)
        if found is None:
            continue
        points, losses = found
        if len(points) < 60:
            assert losses
        elif not losses:
            assert np.count_nonzero(np.any(points != expected, axis=1)) <= 1


def test_many_counts_take_no_time(tmp_path: Path) -> None:
    found = damaged(tmp_path, "1\n1 2 3\n" + "7\n" * 300_000)

    assert found is not None
    assert found[0].tolist() == [[1, 2, 3]]
    assert "2,100,000 of 2,100,001 points are missing: scan 2 ends before them" in found[1][0]
