"""PTX files: scans of a scanner that stands, each in its own frame.

How these tests could be cheated: by matrices that turn nothing, whose transposes are the same, or
by the position in the header, which may be another. So scans are turned and moved, the header's
position is a wrong one, and what must come is computed from the description of the format.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mlscli.errors import InputError
from mlscli.io.clouds.ptx import PtxCloud
from mlscli.io.reading.formats import open_source
from mlscli.io.reading.recording import open_recording
from mlscli.runtime.arrays import Float64
from tests.helpers.damage import cut
from tests.helpers.texts import text

POINTS: Float64 = np.round(np.random.default_rng(4).uniform(1, 9, (12, 3)), 4)

# About z by a quarter, from x to y, and away; as rows of four are multiplied by it.
TURNED = ((0, 1, 0, 0), (-1, 0, 0, 0), (0, 0, 1, 0), (100, 200, 30, 1))
MOVED: Float64 = np.column_stack((100 - POINTS[:, 1], 200 + POINTS[:, 0], 30 + POINTS[:, 2]))
STILL = ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1))


def row(numbers: tuple[float, ...]) -> str:
    return " ".join(map(str, numbers)) + "\n"


def scan(
    points: Float64, matrix: tuple[tuple[float, ...], ...], more: str = " 0.5", count: int = 0
) -> str:
    head = f"{(count or len(points)) // 3}\n3\n7 8 9\n1 0 0\n0 1 0\n0 0 1\n"
    lines = [row(tuple(point)).replace("\n", f"{more}\n") for point in points.tolist()]
    return head + "".join(map(row, matrix)) + "".join(lines)


@pytest.mark.parametrize("more", [" 0.5", " 0.5 10 20 30"])
def test_each_scan_is_a_keyframe_in_the_common_frame_seen_from_its_scanner(
    tmp_path: Path, more: str
) -> None:
    path = text(tmp_path, scan(POINTS, TURNED, more) + scan(POINTS, STILL, more), "scans.dat")
    source = open_source(path)
    first, second = source.clouds()

    assert source.kind == "PTX cloud"
    np.testing.assert_allclose(first.points, MOVED, rtol=0, atol=1e-12)
    assert first.position == (100, 200, 30)
    assert second.points.tolist() == POINTS.tolist()
    assert second.position == (0, 0, 0)
    assert first.is_ranged
    assert (*source.notes, *source.losses) == ()


def test_what_was_not_hit_is_no_point_and_counted(tmp_path: Path) -> None:
    points = POINTS.copy()
    points[[2, 5, 6]] = 0
    recording = open_recording(text(tmp_path, scan(points, TURNED)))
    (keyframe,) = recording.keyframes()

    np.testing.assert_allclose(keyframe.points, np.delete(MOVED, [2, 5, 6], axis=0), atol=1e-12)
    assert recording.tally.points_read == 12
    assert recording.tally.dropped == {"no return": 3}


def test_the_points_that_are_there_count(tmp_path: Path) -> None:
    # Of the first scan three are missing, and the second has three more than it declares.
    short = scan(POINTS[:9], STILL, count=12)
    source = PtxCloud(text(tmp_path, short + scan(POINTS, TURNED, count=9)))
    first, second = source.clouds()

    assert first.points.tolist() == POINTS[:9].tolist()
    np.testing.assert_allclose(second.points, MOVED, rtol=0, atol=1e-12)
    assert [loss.partition(": ")[2] for loss in source.losses] == [
        "3 of 12 points are missing: the scan ends before them"
    ]
    (note,) = source.notes
    assert "scan 2 declares 9 points and holds 12; all are read" in note


def test_a_broken_row_is_lost_and_named(tmp_path: Path) -> None:
    source = PtxCloud(text(tmp_path, scan(POINTS, STILL).replace(f"{POINTS[4, 0]}", "?", 1)))
    (cloud,) = source.clouds()

    assert cloud.points.tolist() == np.delete(POINTS, 4, axis=0).tolist()
    (loss,) = source.losses
    assert "1 of 12 points is missing: the first is '? " in loss


def test_cut_anywhere_whole_rows_come_in_the_right_frame(tmp_path: Path) -> None:
    whole = (scan(POINTS, TURNED) + scan(POINTS, STILL)).encode()
    expected = np.concatenate((MOVED, POINTS))
    header = whole.index(row(TURNED[-1]).encode()) + len(row(TURNED[-1]))
    for content in cut(whole[header:], 40):
        content = whole[:header] + content
        source = PtxCloud(text(tmp_path, content))
        points = np.concatenate([np.empty((0, 3)), *(cloud.points for cloud in source.clouds())])
        np.testing.assert_allclose(points, expected[: len(points)], rtol=0, atol=1e-12)
        assert source.losses or len(points) in (12, 24)


@pytest.mark.parametrize(
    "matrix",
    [
        ((2, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1)),
        ((1, 0, 0, 5), (0, 1, 0, 6), (0, 0, 1, 7), (0, 0, 0, 1)),
        (("nan", 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1)),
        ((1e300, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1)),
    ],
)
def test_a_matrix_that_is_no_pose_is_refused(
    tmp_path: Path, matrix: tuple[tuple[float, ...], ...]
) -> None:
    with pytest.raises(InputError, match="matrix in the header of scan 1 that does more than turn"):
        list(PtxCloud(text(tmp_path, scan(POINTS, matrix))).clouds())


def test_counts_that_no_file_can_hold_are_losses(tmp_path: Path) -> None:
    content = scan(POINTS, STILL).replace("4\n3\n", f"{10**17}\n{10**17}\n", 1)
    source = PtxCloud(text(tmp_path, content))
    (cloud,) = source.clouds()

    assert cloud.points.tolist() == POINTS.tolist()
    assert len(source.losses) == 1
