"""What the header of a LAS or LAZ file counts, against the points and records that are there.

How these tests could be cheated: by counts that are right, by points behind the end that make no
sense. So counts lie both ways, and whole files lie behind others.
"""

from __future__ import annotations

import struct
from pathlib import Path

import laspy
import numpy as np
import pytest

from mlscli.io.clouds.las import LasCloud
from tests.helpers.las import parsed, read, write


@pytest.mark.parametrize(("name", "point_format"), [("a.las", 3), ("a.las", 7), ("a.laz", 7)])
@pytest.mark.parametrize("declared", [0, 20])
def test_points_beyond_those_declared_are_taken(
    tmp_path: Path, name: str, point_format: int, declared: int
) -> None:
    expected = parsed(write(tmp_path / "b.las", 36, point_format)).tolist()
    content = bytearray(write(tmp_path / name, 36, point_format).read_bytes())
    struct.pack_into("<I", content, 107, declared)
    if point_format > 5:
        struct.pack_into("<Q", content, 247, declared)
    (tmp_path / name).write_bytes(content)

    assert read(tmp_path / name) == ([expected], [])
    (note,) = LasCloud(tmp_path / name).notes
    assert f"its header declares {declared} points, and there are 36" in note


@pytest.mark.parametrize("declared", [0, 20])
def test_of_chained_points_beyond_those_declared_the_sure_ones_are_taken(
    tmp_path: Path, declared: int
) -> None:
    expected = parsed(write(tmp_path / "b.las", 90)).tolist()
    content = bytearray(write(tmp_path / "a.laz", 90).read_bytes())
    struct.pack_into("<I", content, 107, declared)
    (tmp_path / "a.laz").write_bytes(content)

    (points,), losses = read(tmp_path / "a.laz")

    assert points == expected[: len(points)]
    assert 85 <= len(points) < 90
    assert f"more points follow than the {declared} that its header declares" in losses[0]


def test_chained_points_beyond_those_declared_stay_within_the_bounds(tmp_path: Path) -> None:
    first = parsed(write(tmp_path / "b.las", 90))[:20]
    content = bytearray(write(tmp_path / "a.laz", 90).read_bytes())
    struct.pack_into("<I", content, 107, 20)
    # Others lie outside the bounds of these.
    struct.pack_into("<6d", content, 179, *np.stack([first.max(0), first.min(0)], axis=1).ravel())
    (tmp_path / "a.laz").write_bytes(content)

    (points,), losses = read(tmp_path / "a.laz")

    assert len(points) == 20
    assert "the last ones are left out" in losses[0]


@pytest.mark.parametrize("records", [False, True])
@pytest.mark.parametrize(("name", "point_format"), [("a.las", 3), ("a.las", 7), ("a.laz", 3)])
def test_a_file_joined_to_another_is_a_loss(
    tmp_path: Path, name: str, point_format: int, records: bool
) -> None:
    las = laspy.read(write(tmp_path / name, 36, point_format))
    if records:
        las.evlrs = laspy.vlrs.vlrlist.VLRList([laspy.VLR("LASF_Spec", 7, "", b"LASF")])
    path = tmp_path / name
    las.write(path)
    (whole,), _ = read(path)
    content = path.read_bytes()
    path.write_bytes(content + content)

    (points,), losses = read(path)

    assert points == whole
    (loss,) = losses
    assert f"another LAS file, joined to it at byte {len(content):,}, is left out" in loss


@pytest.mark.parametrize("name", ["a.las", "a.laz"])
@pytest.mark.parametrize("records", [4, 2**32 - 1])
def test_more_records_than_fit_before_the_points_are_told(
    tmp_path: Path, name: str, records: int
) -> None:
    expected = parsed(write(tmp_path / "b.las", 300)).tolist()
    content = bytearray(write(tmp_path / name, 300).read_bytes())
    struct.pack_into("<I", content, 100, records)
    (tmp_path / name).write_bytes(content)

    assert read(tmp_path / name) == ([expected], [])
    (note,) = LasCloud(tmp_path / name).notes
    assert f"declares {records:,} variable length records, of which {int(name == 'a.laz')}" in note
