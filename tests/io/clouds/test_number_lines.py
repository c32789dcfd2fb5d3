"""Rows of numbers behind a header, in PLY and PCD.

How these tests could be cheated: by giving up what is declared whenever the rows differ from it, or
by taking all that has enough numbers. So what may differ stands beside what may not, with faces
after the vertices, whose rows look like points, and in blocks of a few characters.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest

from mlscli.io.clouds import rows as rows_module
from mlscli.io.clouds.pcd import PcdCloud
from mlscli.io.clouds.plycloud import PlyCloud
from mlscli.io.clouds.pointfile import PointFile
from tests.helpers.program import mls
from tests.helpers.texts import text

POINTS = [[n + 0.5, n % 3 + 0.25, n / 8] for n in range(9)]
FACES = "element face 2\nproperty list uchar int vertex_indices\n"


@pytest.fixture(params=[1 << 22, 7], autouse=True)
def block(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rows_module, "BLOCK_CHARACTERS", request.param)


def rows(form: str = "{0} {1} {2}", points: Sequence[Sequence[float]] = POINTS) -> str:
    return "".join(form.format(*point) + "\n" for point in points)


def ply(folder: Path, body: str, count: int = 9, more: str = "", after: str = "") -> PointFile:
    properties = "".join(f"property {each}\n" for each in ("float x", "float y", "float z"))
    properties += "".join(f"property {each}\n" for each in more.split(",") if each)
    head = f"ply\nformat ascii 1.0\nelement vertex {count}\n{properties}{after}end_header\n"
    return PlyCloud(text(folder, head + body, "a.ply"))


def pcd(folder: Path, body: str, count: int = 9, more: str = "") -> PointFile:
    names = ["x", "y", "z", *more.split()]
    head = f"FIELDS {' '.join(names)}\nSIZE{' 4' * len(names)}\nTYPE{' F' * len(names)}\n"
    return PcdCloud(text(folder, f"{head}WIDTH {count}\nDATA ascii\n{body}", "a.pcd"))


def points_of(cloud: PointFile) -> list[list[float]]:
    return [[float(v) for v in point] for each in cloud.clouds() for point in each.points]


RIGHT = {
    "half colours": (rows("{0} {1} {2} 0.5"), "half red"),
    "bool": (rows("{0} {1} {2} true"), "bool seen"),
    "a type that no one knows": (rows("{0} {1} {2} 7"), "long long_ago"),
    "Windows' nan": (rows("{0} {1} {2} -1.#IND -nan(ind)"), "float nx,float ny"),
    "two lines a row": (rows("{0} {1} {2} \n1 2 3"), "uchar red,uchar green,uchar blue"),
    "three lines a row": (rows("{0} {1}\n{2}\n1 2"), "uchar red,uchar green"),
    "a number a line": (rows("{0}\n{1}\n{2}"), ""),
    "commas": (rows("{0}, {1}, {2}"), ""),
    "tabs and a long comment": ("# " + "a" * 100_000 + "\n" + rows("{0}\t{1}\t{2}"), ""),
}


@pytest.mark.parametrize("kind", RIGHT)
@pytest.mark.parametrize("after", ["", FACES])
def test_what_is_whole_is_read_without_a_word(tmp_path: Path, kind: str, after: str) -> None:
    body, more = RIGHT[kind]
    cloud = ply(tmp_path, body + "3 0 1 2\n" * 2 * bool(after), 9, more, after)

    assert points_of(cloud) == POINTS
    assert cloud.notes == []
    assert cloud.losses == []


def test_elements_before_the_vertices_may_stand_on_several_lines_too(tmp_path: Path) -> None:
    head = "element camera 2\n" + "".join(f"property float {name}\n" for name in "abcd")
    head += "element vertex 9\n" + "".join(f"property float {name}\n" for name in "xyz")
    body = "1 2\n3 4\n" * 2 + rows()
    path = text(tmp_path, f"ply\nformat ascii 1.0\n{head}end_header\n{body}", "a.ply")

    assert points_of(PlyCloud(path)) == POINTS


@pytest.mark.parametrize("make", [ply, pcd])
@pytest.mark.parametrize(
    "form",
    ["4,5 6 7", "{0} {1} 2,5", "0,5 0,25 0,125", "0,5;0,25;0,125", "0,05,0,25,0,12", "5 7 8 9 1"],
)
def test_decimal_commas_and_whole_numbers_too_many_are_no_points(
    tmp_path: Path, make: object, form: str
) -> None:
    assert callable(make)
    cloud = make(tmp_path, rows(form))

    assert points_of(cloud) == []
    (loss,) = cloud.losses
    assert "9 of 9 points are missing: the first is 1, found '" in loss
    assert ("with decimal points" in loss) == ("," in form and form != "0,05,0,25,0,12")


def test_two_points_a_line_are_no_point_with_more_numbers(tmp_path: Path) -> None:
    assert points_of(ply(tmp_path, rows("{0} {1} {2} 9.5 9.5 9.5"))) == []


@pytest.mark.parametrize("make", [ply, pcd])
def test_a_number_more_in_every_row_is_told(tmp_path: Path, make: object) -> None:
    assert callable(make)
    cloud = make(tmp_path, "HEADER_EXT_START 1\nMODE None\n" + rows("{0} {1} {2} 0"))

    assert points_of(cloud) == POINTS
    assert cloud.losses == []
    more, lines = cloud.notes
    assert "rows have 1 number more than are declared" in more
    assert "2 lines are no points: the first is 1, found 'HEADER_EXT_START 1'" in lines


@pytest.mark.parametrize("make", [ply, pcd])
def test_rows_beyond_those_declared_are_read_and_told(tmp_path: Path, make: object) -> None:
    assert callable(make)
    cloud = make(tmp_path, rows(), 4)

    assert points_of(cloud) == POINTS
    assert cloud.losses == []
    assert [
        "declares 4 points, and there are 9; all are taken" in note for note in cloud.notes
    ] == [True]
    broken = make(tmp_path, rows() + "1 2\n7 8 9\n", 4)
    assert points_of(broken) == [*POINTS, [7, 8, 9]]
    assert "1 line beyond the declared points cannot be read" in broken.losses[0]


@pytest.mark.parametrize("more", ["", "float w"])
def test_rows_of_what_follows_are_no_points(tmp_path: Path, more: str) -> None:
    body = rows("{0} {1} {2}" + " 9" * bool(more)) + "3 0 1 2\n3 1 2 3\n"

    assert points_of(ply(tmp_path, body, 9, more, FACES)) == POINTS
    cloud = ply(tmp_path, body, 4, more, FACES)
    assert points_of(cloud) == POINTS
    assert ["all are taken" in note for note in cloud.notes] == [True]


def test_a_broken_row_is_lost_and_no_other(tmp_path: Path) -> None:
    body = rows() + "7" * 100_000 + "\n1 2 x\n1 2 3 4\n" + rows()
    cloud = pcd(tmp_path, body, 21)

    assert points_of(cloud) == POINTS * 2
    assert "3 of 21 points are missing: the first is 10, found '7777" in cloud.losses[0]


def test_the_command_tells_and_ends_with_the_status(tmp_path: Path) -> None:
    form = "{0} {1} {2}"
    ply(tmp_path, rows(form) + "1,5 2 3\n", 10)
    run = mls("build", "a.ply", "-c", "plain", "--set", "map.cell_size=1", cwd=tmp_path)
    assert run.returncode == 3
    assert "1 of 10 points is missing: the first is 10, found '1,5 2 3', exp" in run.stderr
    ply(tmp_path, rows("0,5 1 2"))
    run = mls("build", "a.ply", "-c", "plain", "--overwrite", cwd=tmp_path)
    assert run.returncode == 1
    assert "with decimal points" in run.stderr
