"""Columns by what stands before the first row, and doubts about columns by position.

How these tests could be cheated: by refusing all that has a header that is unusual, or all whose
first column grows. So beside each text that is refused stands one that looks much like it and is
right, and what is refused is read with `columns`.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from mlscli.errors import InputError
from mlscli.io.clouds import rows as rows_module
from mlscli.io.clouds.opening import read_opening
from mlscli.io.clouds.text import TextCloud
from tests.helpers.texts import clouds_of, one_cloud, read, text

GRID = "".join(f"{x} {y} {x * y / 8}\n" for y in range(3) for x in range(12))


@pytest.mark.parametrize(
    ("header", "words"),
    [
        ("Point No;X coord;Y coord;Z coord", "before the first point, expected numbers or a head"),
        ("x;y;z", "a header that names 3 columns, and rows of 4"),
        ("id;label;x;y;z", "a header that names 5 columns, and rows of 4"),
        ("lat;lon;alt;name", "before the first point"),
        ("# lat;lon;alt;id", "found the comment '# lat;lon;alt;id', which names no x, y and z"),
        ("// r g b a", "which names no x, y and z"),
        ("% timestamp, range, azimuth, intensity", "which names no x, y and z"),
    ],
)
def test_a_header_without_x_y_z_or_of_other_columns_is_refused(
    tmp_path: Path, header: str, words: str
) -> None:
    content = f"{header}\n" + "7;0.5;1.5;2.5\n" * 3
    with pytest.raises(InputError, match=words) as error:
        read(tmp_path, content)
    assert "\n" not in str(error.value)
    assert one_cloud(tmp_path, content, "-,x,y,z") == [[0.5, 1.5, 2.5]] * 3


@pytest.mark.parametrize(
    "comment", ["# made by hand", "# point cloud of the hall", "// 3 scans, of May", "#"]
)
def test_other_comments_name_nothing(tmp_path: Path, comment: str) -> None:
    assert one_cloud(tmp_path, f"{comment}\n1.5 2 3\n") == [[1.5, 2, 3]]


def test_missing_values_at_the_end_are_no_missing_columns(tmp_path: Path) -> None:
    assert one_cloud(tmp_path, "x,y,z,a,b\n1,2,3,,\n4,5,6,7\n") == [[1, 2, 3], [4, 5, 6]]


@pytest.mark.parametrize(
    ("content", "columns", "first"),
    [
        ("".join(f"{1.6e9 + n} 1.5 2.5 {n}.5\n" for n in range(6)), "t,x,y,z", [1.5, 2.5, 0.5]),
        (
            "".join(f"{1403636580838555648 + n * 10**8},1,2,{n}\n" for n in range(6)),
            "t,x,y,z",
            [1, 2, 0],
        ),
        ("".join(f"{n} 1.5 {n / 7} 2.5\n" for n in range(6)), "-,x,y,z", [1.5, 0, 2.5]),
        (
            "".join(f"{1001 + n},{n}.5,{n / 7},2.5,GRND\n" for n in range(6)),
            "-,x,y,z",
            [0.5, 0, 2.5],
        ),
        ("".join(f"{n};0.5;{n}.5;3.25;9\n" for n in range(1, 7)), "-,x,y,z", [0.5, 1.5, 3.25]),
    ],
)
def test_times_and_numbers_of_rows_are_not_taken_for_x(
    tmp_path: Path, content: str, columns: str, first: list[float]
) -> None:
    with pytest.raises(InputError, match=f"`columns` {columns}; `columns` x,y,z takes it for x"):
        read(tmp_path, content)
    (cloud, *_) = read(tmp_path, content, columns)
    assert cloud.points[0].tolist() == first
    assert len(read(tmp_path, content, "x,y,z")) == 1


@pytest.mark.parametrize(
    "content",
    [
        GRID,
        "".join(f"{n} 1.5 {n / 7}\n" for n in range(9)),
        "".join(f"{500_000.5 + n} 5e6 {n}\n" for n in range(9)),
        "".join(f"{n} {n % 3} {n % 2}.5 7\n" for n in range(9)),
    ],
)
def test_coordinates_that_grow_are_coordinates(tmp_path: Path, content: str) -> None:
    (points,) = clouds_of(tmp_path, content)
    assert points == [[float(word) for word in row.split()[:3]] for row in content.splitlines()]


def test_what_is_declared_is_compared_with_what_is_there(tmp_path: Path) -> None:
    more = TextCloud(text(tmp_path, "2\n" + "1.5,2,3\n" * 3))
    assert sum(len(cloud.points) for cloud in more.clouds()) == 3
    assert ["declares 2 points, and there are 3" in note for note in more.notes] == [True]

    fewer = TextCloud(text(tmp_path, "5\n" + "1.5,2,3\n" * 3))
    assert sum(len(cloud.points) for cloud in fewer.clouds()) == 3
    assert "2 of 5 points are missing: the file ends before them" in fewer.losses[0]


@pytest.mark.parametrize(
    ("end", "fault"),
    [
        ("1.5 2.", "found 2 columns"),
        ("1.5 2.5 3 -", "found 4 columns"),
        ("1.5 2.5 -", "found 3 columns"),
        ("1.5 2.5 3e 9 9", "found '3e' as z"),
        ("\0" * 30, "zero bytes"),
        ("1.5 2.5 3.5 9 9\0\0\0", "zero bytes"),
    ],
)
def test_a_cut_text_is_read_as_far_as_it_goes(tmp_path: Path, end: str, fault: str) -> None:
    cloud = TextCloud(text(tmp_path, "1.5 2.5 3.5 9 9\n" * 4 + end))

    assert [each.points.tolist() for each in cloud.clouds()] == [[[1.5, 2.5, 3.5]] * 4]
    (loss,) = cloud.losses
    assert f"cloud.txt:5: found {fault.removeprefix('found ')}" in loss
    assert "the text seems to be cut there, and 1 row is left out" in loss


@pytest.mark.parametrize("block", [1 << 22, 40])
@pytest.mark.parametrize(
    "line", ["1.5 x 2 3 4", "WARN: buffer full", "1.5", "\0" * 30, "7" * 70_000]
)
def test_a_broken_line_in_the_middle_is_a_loss(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, line: str, block: int
) -> None:
    monkeypatch.setattr(rows_module, "BLOCK_CHARACTERS", block)
    good = [f"{k}.5 2.5 3.5 9 9" for k in range(8)]
    for at in (1, 5, 8):
        lines = [*good[:at], line, "# a comment", line, *good[at:]]
        cloud = TextCloud(text(tmp_path, "\n".join(lines) + "\n"))

        assert [each.points.tolist() for each in cloud.clouds()] == [
            [[k + 0.5, 2.5, 3.5] for k in range(8)]
        ]
        (loss,) = cloud.losses
        assert loss.startswith(f"{cloud.path}:{at + 1}: found ")
        assert loss.endswith("; 2 of 10 rows cannot be read")


@pytest.mark.parametrize("times", [4, 5, 50])
def test_a_text_of_which_half_the_lines_are_broken_is_none(tmp_path: Path, times: int) -> None:
    content = "1.5 2.5 3.5\n" * 4 + "1.5 2.5 abc\n" * times
    with pytest.raises(InputError, match=r"cloud\.txt:5: found 'abc' as z, expected a number"):
        read(tmp_path, content)
    (cloud,) = read(tmp_path, content + "1.5 2.5 3.5\n" * times)
    assert len(cloud.points) == 4 + times


@pytest.mark.parametrize("line", ["ncols 4 7", "1.5 2,5 3.5"])
def test_what_shows_another_format_is_no_loss(tmp_path: Path, line: str) -> None:
    good = "1.5 2.5 3.5\n" * 9
    content = line + "\n" + good if line.startswith("n") else good + line + "\n" + good
    with pytest.raises(InputError, match=r"cloud\.txt:(1|10): found"):
        read(tmp_path, content)


def test_rows_that_differ_are_not_said_to_be_alike(tmp_path: Path) -> None:
    content = "x,y,z\n" + "1,2,3,4\n" * 5 + "1,2,3,4,5\n"
    with pytest.raises(InputError, match="names 3 columns, and rows of 4 to 5, most of them of 4"):
        read(tmp_path, content)


def test_a_last_row_is_taken_only_if_no_declared_one_is_missing_after_it(tmp_path: Path) -> None:
    whole = TextCloud(text(tmp_path, "3\n1.5,2,3\n4,5,6\n7,8,9"))
    assert [len(cloud.points) for cloud in whole.clouds()] == [3]
    assert whole.losses == []
    cut = TextCloud(text(tmp_path, "4\n1.5,2,3\n4,5,6\n7,8,9"))
    assert [len(cloud.points) for cloud in cut.clouds()] == [2]
    assert len(cut.losses) == 2
    with pytest.raises(InputError, match="holds no points"):
        read(tmp_path, "40\n1.5,2,3")


def test_the_beginning_of_a_text_is_taken_apart(tmp_path: Path) -> None:
    path = text(tmp_path, "# one\n\nTitle\n//two\nx, y (m), z\n12\n1, 2, 3\n# three\n4, 5, 6\n")
    opening = read_opening(path)

    assert opening.dialect == (",", 3)
    assert opening.headers == ["Title", "x, y (m), z"]
    assert opening.comments == ["# one", "//two"]
    assert opening.declared == 12
    assert opening.first_line == 6
    assert opening.rows == [["1", "2", "3"], ["4", "5", "6"]]
    assert next(opening.names("# X (m), Y, Z [cm]")) == ["x", "y", "z"]


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("".join(f"1 {n}.5 {n % 3}.25 0.5\n" for n in range(6)), "first column holds whole num"),
        (
            "".join(f"1 {n} {n}.5 {n % 3}.25 0.5 9\n" for n in range(6)),
            "first two columns hold whole",
        ),
        ("".join(f"{n / 10} 1.5 {n % 3}.25 0.5\n" for n in range(12)), "grows as evenly as times"),
        (
            "".join(f"{n / 10} {n % 2}.5 {n % 3}.25 {n / 7} 0 0.1\n" for n in range(12)),
            "grows as evenly as times",
        ),
    ],
)
def test_a_column_that_hardly_is_x_is_told(tmp_path: Path, content: str, words: str) -> None:
    assert any(words in note for note in TextCloud(text(tmp_path, content)).notes)
    assert not any(words in note for note in TextCloud(text(tmp_path, content), "x,y,z").notes)
    assert not any(words in note for note in TextCloud(text(tmp_path, GRID)).notes)


def test_a_raster_with_colours_is_no_flight_in_time(tmp_path: Path) -> None:
    content = "".join(f"{n / 2} 7.5 {n % 3}.25 10 20 30\n" for n in range(12))

    assert not any("as times" in note for note in TextCloud(text(tmp_path, content)).notes)


@pytest.mark.parametrize(
    "content",
    [
        "imageName X Y Z Omega Phi Kappa\nDJI_1.JPG 1.5 2 3 0.1 0.2 88\nDJI_2.JPG 2 2 3 0 0 88\n",
        "# PhotoID, X, Y, Z, Omega, Phi, Kappa, r11\na.jpg\t1\t2\t3\t0\t0\t88\t1\n",
    ],
)
def test_cameras_of_photogrammetry_are_no_points(tmp_path: Path, content: str) -> None:
    with pytest.raises(InputError, match="holds no cloud but a trajectory"):
        read(tmp_path, content)


def test_of_places_of_images_in_no_known_columns_it_tells_what_reads_them(tmp_path: Path) -> None:
    rows = "".join(f"{n} 000{n}.JPG {7e5 + n} {4e6 + n} 19{n}\n" for n in range(6))

    with pytest.raises(InputError, match=r"where images were taken; .*`columns` -,-,x,y,z to take"):
        read(tmp_path, "$ gps file\n$ id name x y z\n6\n" + rows)


def test_what_stands_below_a_header_and_is_no_row_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"holds no points; found '0\.5 m,1 m,2 m', expected numb"):
        read(tmp_path, "x,y,z\n0.5 m,1 m,2 m\n")


def test_texts_that_were_put_one_behind_another_are_read_on(tmp_path: Path) -> None:
    assert one_cloud(tmp_path, "\ufeff1,2,3\n\ufeff4,5,6\n") == [[1, 2, 3], [4, 5, 6]]


@pytest.mark.parametrize(
    ("row", "columns"),
    [
        ("{number},{north:.3f},{east:.3f},116.25,GRND\n", "-,y,x,z"),
        ("{number},{east:.3f},{north:.3f},116.25,GRND\n", "-,x,y,z"),
    ],
)
def test_of_numbered_survey_points_it_tells_which_column_is_x(
    tmp_path: Path, row: str, columns: str
) -> None:
    numbers = (7, 12, 3, 40, 8, 21, 5)
    content = "".join(
        row.format(number=n, north=4_169_003.1 + n / 3, east=352_000.2 + n / 7) for n in numbers
    )
    cloud = TextCloud(text(tmp_path, content))

    assert any(f"try `columns` {columns}" in note for note in cloud.notes)
