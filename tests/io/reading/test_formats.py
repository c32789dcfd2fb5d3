"""What is meant by a folder, or by one of its files, and what is said of what was not taken.

How these tests could be cheated: by the first model that is found, by notes that are there always,
or by taking any file called metadata.yaml for a bag. So models differ, what lies alone gives no
note, and other files of these names are refused.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from mlscli.errors import InputError
from mlscli.io.reading.formats import open_source
from mlscli.io.reading.recording import open_recording
from mlscli.io.source import Source
from tests.helpers.bags import write_told
from tests.helpers.craft import POINTS as SEEN
from tests.helpers.craft import cloud
from tests.io.clouds.test_colmap import IMAGES, POINTS, write_binary, write_text
from tests.io.clouds.test_opensfm import write as write_opensfm


def choices(source: Source) -> list[str]:
    """Return the notes on what was chosen."""
    return [note for note in source.notes if "taken is" in note]


def test_the_metadata_of_a_bag_stand_for_the_bag(tmp_path: Path) -> None:
    folder = write_told(tmp_path / "flight", [cloud(1, "map")], "ros2")

    (keyframe,) = open_recording(folder / "metadata.yaml")

    assert keyframe.points.tolist() == SEEN.tolist()


def test_metadata_of_something_else_are_no_bag(tmp_path: Path) -> None:
    (tmp_path / "metadata.yaml").write_text("title: a flight\n")

    with pytest.raises(InputError, match="found 'title: a flight' before the first point"):
        list(open_recording(tmp_path / "metadata.yaml"))


@pytest.mark.parametrize(
    ("taken", "other"),
    [
        ("sparse", "sparse/0"),
        ("sparse", "sparse/aligned"),
        ("sparse/0", "sparse/aligned"),
        (".", "sparse"),
        (".", "sparse/0"),
        ("0", "sparse"),
        ("sparse/model", ""),
    ],
)
def test_models_that_are_not_taken_are_named(tmp_path: Path, taken: str, other: str) -> None:
    write_binary(tmp_path / taken, IMAGES, POINTS)
    if other:
        write_text(tmp_path / other, None, POINTS[:2])

    source = open_source(tmp_path)

    assert sum(len(cloud.points) for cloud in source.clouds()) == len(POINTS)
    if other:
        (note,) = choices(source)
        assert f"taken is {tmp_path / taken}; not taken: {tmp_path / other}, " in note
    else:
        assert not choices(source)


def test_a_model_that_is_named_itself_gives_no_note(tmp_path: Path) -> None:
    write_binary(tmp_path / "sparse", IMAGES, POINTS)
    write_binary(tmp_path / "sparse/0", IMAGES, POINTS)

    assert not choices(open_source(tmp_path / "sparse/0"))
    assert not choices(open_source(tmp_path / "sparse/points3D.bin"))


@pytest.mark.parametrize("name", ["images.bin", "cameras.bin"])
def test_another_file_of_a_model_leads_to_it(tmp_path: Path, name: str) -> None:
    write_binary(tmp_path, IMAGES, POINTS)
    (tmp_path / "cameras.bin").write_bytes(bytes(8))

    assert sum(len(cloud.points) for cloud in open_source(tmp_path / name).clouds()) == len(POINTS)


def test_of_two_reconstructions_of_a_project_one_is_taken_and_the_other_named(
    tmp_path: Path,
) -> None:
    assert not choices(open_source(write_opensfm(tmp_path)))
    other = write_opensfm(tmp_path / "opensfm")

    (note,) = choices(open_source(tmp_path))

    assert f"not taken: {other}" in note


def test_a_grid_of_heights_is_named(tmp_path: Path) -> None:
    path = tmp_path / "dem.asc"
    path.write_text("NCOLS 2\r\nNROWS 1\r\nxllcorner 0\nyllcorner 0\ncellsize 1\n3.5 3.6\n")

    with pytest.raises(InputError, match=r"is an ESRI grid \(gdal_translate -of XYZ makes"):
        open_source(path)


@pytest.mark.parametrize(
    ("content", "name"),
    [
        (
            b"# app\nmtllib a.mtl\no scan\nv 1 2 3\nv 1 2 4\nvn 0 0 1\nf 1 2 1\n",
            "a mesh (Wavefront",
        ),
        (b"v 1 2 3\r\nv 1 2 4\r\nf 1 2 1\r\n", "a mesh (Wavefront OBJ)"),
        (b"glTF\2\0\0\0", "a mesh (glTF)"),
        (b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", "a mesh (OFF)"),
        # As ModelNet has it; with colours, as MeshLab writes it; packed.
        (b"OFF3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", "a mesh (OFF)"),
        (b"# by a program\nCOFF # colours\n\n1 0 0\n0 0 0 9 9 9 255\n", "a mesh (OFF)"),
        (b"OFF BINARY\n\0\0\0\3", "a mesh (OFF)"),
        (b"solid a room\nfacet normal 0 0 1\n outer loop\n", "a mesh (STL)"),
        (b"# vtk DataFile Version 4.2\nvtk output\nASCII\n", "a data set of VTK (ParaView"),
        (b"# Bundle file v0.3\n1 1\n700 0 0\n1 0 0\n0 1 0\n0 0 1\n", "a reconstruction of Bundler"),
        (b"NVM_V3 \n\n1\na.jpg 700 1 0 0 0 0 0 0 0 0\n", "a reconstruction of VisualSFM (NVM)"),
        (b"ASTM-E57\1\0\0\0", "an E57 file (PDAL"),
        (b"CCB2\0\0", "a BIN of CloudCompare"),
        (
            b"version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 9\n",
            "a pointer of Git",
        ),
        (b"\n<!DOCTYPE html>\n<html>1 2 3</html>\n", "a web page"),
        (b"<HTML><body>", "a web page"),
        (b'[{"a": 1}]', "a JSON file"),
        (b"[[1, 2],\n[3, 4]]", "a JSON file"),
    ],
)
def test_what_is_no_cloud_is_called_by_its_name(tmp_path: Path, content: bytes, name: str) -> None:
    path = tmp_path / "a"
    path.write_bytes(content)

    with pytest.raises(InputError, match=f"is {re.escape(name)}"):
        open_source(path)


@pytest.mark.parametrize("header", ["OFF x y z", "solid x y z", "# OFF", "# Bundle of points"])
def test_a_text_whose_header_begins_like_a_format_is_a_text(tmp_path: Path, header: str) -> None:
    path = tmp_path / "a.txt"
    path.write_text(f"{header}\n{'1 2 3 4' if 'x' in header else '1 2 3'}\n")

    (keyframe,) = open_source(path).clouds()

    assert len(keyframe.points) == 1


@pytest.mark.parametrize("content", ["v 1 2 3\nv 4 5 6\n", "[1, 2, 3]\n[4, 5, 6]\n"])
def test_rows_with_marks_are_a_text_all_the_same(tmp_path: Path, content: str) -> None:
    path = tmp_path / "a.txt"
    path.write_text(content)

    with pytest.raises(InputError, match=r"found '(v|\[1)' as x, expected a number"):
        list(open_source(path).clouds())


@pytest.mark.parametrize("below", ["", "sparse", "sparse/0"])
def test_points_that_a_model_has_as_ply_alone_are_named(tmp_path: Path, below: str) -> None:
    write_text(tmp_path / below, IMAGES, POINTS)
    (tmp_path / below / "points3D.txt").rename(tmp_path / below / "points3D.ply")

    with pytest.raises(InputError, match=r"may be those of .*points3D\.ply: name that file"):
        open_source(tmp_path)
