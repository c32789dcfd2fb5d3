"""What `benchmarks/real.py` compares is what it says, and its levels decide.

How one could cheat: samples with less noise than is said; a score of another distance for each row,
or of a part of the scan; meshes of other programs that are empty, or are moved; levels that no
figure misses, or that are compared with what is not shown; ground found by walls that stand on it.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from benchmarks import real
from benchmarks.instead import INSTEAD, voxels
from benchmarks.scans import SCANS, Scan, cell_of, drawn, flown
from mlscli.building.sizes import auto_cell_size
from mlscli.runtime.arrays import Float64
from mlscli.scoring import ColumnScore, EndErrors, OriginScore, Share, score_mesh
from tests.helpers.maps import Patch, map_of
from tests.helpers.meshes import areas, open3d

FAR = np.array([513450.0, 5402650.0, 300.0])


def hall(size: int, seed: int = 1) -> Float64:
    """Return points of a floor and of two walls, 6 by 6 by 3."""
    rng = np.random.default_rng(seed)
    xyz = rng.uniform(0, 1, (size, 3)) * (6, 6, 3)
    xyz[: size // 2, 2] = 0
    xyz[size // 2 : 3 * size // 4, 0] = 0
    xyz[3 * size // 4 :, 1] = 0
    return xyz


def test_a_sample_has_the_noise_that_is_said() -> None:
    scan = hall(40_000)
    sample = drawn(scan, 20_000, 1)
    assert len(np.unique(sample.clean, axis=0)) == 20_000
    assert {tuple(row) for row in sample.clean.tolist()} <= {tuple(row) for row in scan.tolist()}
    assert sample.cell == auto_cell_size(sample.clean) == cell_of(sample.clean)
    error = (sample.noisy - sample.clean) / sample.cell
    np.testing.assert_allclose(error[:, :2].std(axis=0), 1 / 12, rtol=0.02)
    # Of normal errors, half are less than 0.6745 sigma; a tenth of them is five times as great.
    assert np.median(np.abs(error[:, 2])) == pytest.approx(0.6745 / 4 * 1.15, rel=0.05)
    known = {tuple(row) for row in sample.evidence[:, :2].tolist()}
    gross = np.array([tuple(row) not in known for row in sample.noisy[:, :2].tolist()])
    assert np.count_nonzero(gross) == 1000 == 20_000 - len(sample.evidence)
    np.testing.assert_array_equal(sample.evidence[:, 2], sample.clean[~gross, 2])
    heights = sample.noisy[gross, 2]
    assert np.histogram(heights, 4, (0, 3))[0].min() > 200
    coarse = np.abs(error[~gross, 2]) > 4 / 4
    assert np.count_nonzero(coarse) == pytest.approx(0.1 * 19_000 * 0.424, rel=0.15)
    assert not np.array_equal(drawn(scan, 20_000, 2).clean, sample.clean)


def test_a_flight_sees_a_scan_with_either_noise() -> None:
    scan = np.concatenate((hall(6000), hall(6000, 2) * (-1, 1, 1)))
    thesis, slam = flown(scan, 60, 1)
    np.testing.assert_array_equal(thesis.clean, slam.clean)
    assert {tuple(row) for row in slam.clean.tolist()} <= {tuple(row) for row in scan.tolist()}
    sizes = [len(keyframe.points) for keyframe in slam.keyframes]
    cameras = np.repeat([keyframe.position for keyframe in slam.keyframes], sizes, axis=0)
    assert len(sizes) > 10
    assert max(sizes) <= 60
    for sample in (thesis, slam):
        points = np.concatenate([keyframe.points for keyframe in sample.keyframes])
        np.testing.assert_array_equal(points, sample.noisy)
    assert np.isfinite(cameras).all()
    size, cell = len(slam.clean), slam.cell
    assert len(thesis.evidence) == size - round(0.05 * size)
    assert len(slam.evidence) == pytest.approx(0.9 * 0.95 * size, rel=0.05)
    np.testing.assert_allclose((thesis.noisy - thesis.clean)[:, 0].std(), cell / 12, rtol=0.1)
    # Along the ray, and with the square of the distance, but for what is grossly wrong.
    ray = slam.clean - cameras
    distance = np.linalg.norm(ray, axis=1)
    error = ((slam.noisy - slam.clean) * ray).sum(axis=1) / distance
    far = distance > np.median(distance)
    typical = [np.median(np.abs(error[half])) / cell for half in (~far, far)]
    assert typical[0] < 0.6745 / 4 * 1.2 < typical[1]
    # What is known is right: without it, a wrong depth or height would count as an error.
    known = {tuple(row) for row in slam.evidence.tolist()}
    right = np.array([tuple(row) in known for row in slam.clean.tolist()])
    relative = (distance / np.median(distance)) ** 2
    assert (error[right] / relative[right]).std() == pytest.approx(cell / 4, rel=0.1)
    assert (error[~right] / relative[~right]).std() > cell
    across = np.linalg.norm(np.cross(slam.noisy - slam.clean, ray), axis=1) / distance
    assert np.median(across) < 0.8 * np.median(np.abs(error))


def test_voxels_are_closed_boxes_around_the_points() -> None:
    points = np.array([(0.1, 0.1, 0.1), (0.4, 0.3, 0.2), (0.6, 0.1, 0.1), (-0.1, 2.1, 3.0)])
    made = voxels(points, 0.5)
    # Two that touch, and one alone.
    assert areas(made).sum() == pytest.approx((10 + 6) * 0.25)
    assert len(made.triangles) == 2 * (10 + 6)
    assert made.vertices.min(axis=0).tolist() == [-0.5, 0, 0]
    assert made.vertices.max(axis=0).tolist() == [1, 2.5, 3.5]


@pytest.mark.parametrize("name", INSTEAD)
def test_what_is_used_instead_finds_a_clean_hall_wherever_it_stands(name: str) -> None:
    open3d()
    points = hall(1000) + np.random.default_rng(2).normal(0, 0.01, (1000, 3))
    cell = cell_of(points)
    for shift in (np.zeros(3), FAR):
        score = score_mesh(INSTEAD[name](points + shift, cell), points + shift, cell, whole=True)
        # From above, a wall is a line. The far side of a voxel is a cell away.
        assert score.recall > (0.5 if name == "2.5D Delaunay" else 0.95)
        assert score.precision > (0.5 if name == "voxels" else 0.9)


def test_the_ground_is_found_by_upper_ends_in_its_own_cell() -> None:
    patches = [
        Patch(0, 0, 0.4, 0.0, 0, 1),
        Patch(1, 0, 3.0, 3.0, 0, 9),
        Patch(2, 0, -0.6, 0.0, 0, 1),
        Patch(2, 0, 0.5, 0.0, 0, 1),
    ]
    ground = np.array([(x, 0.1, 0.0) for x in (1.1, 0.1, 0.6, 5.0, 0.2)])
    assert real.ground_found(map_of(patches), ground) == 3 / 5


def a_score(what: str, f: float, red: OriginScore, lowered: int = 0) -> real.Scored:
    plane = hall(1000)
    mesh = score_mesh(voxels(plane, 0.5), plane, 0.5)
    nothing, of = Share(0, 0, None), Share(lowered, 1000, lowered / 1000)
    ends = EndErrors(0.0, 0.0, 0.0, of, nothing)
    columns = ColumnScore(nothing, nothing, ends, ends)
    by_origin = {**mesh.by_origin, "artificial": red}
    return real.Scored(
        "office",
        "drawn",
        5000,
        1,
        what,
        0.5,
        replace(mesh, f=f, by_origin=by_origin),
        None,
        columns,
    )


@pytest.mark.parametrize(
    ("f", "red", "lowered", "missed"),
    [
        (0.98, OriginScore(0.1, 0.7, 0.01, 0.0), 10, ""),
        (
            0.98,
            OriginScore(0.1, 0.69, 0.011, 0.0),
            11,
            "costs, right, tops",
        ),
        (0.969, OriginScore(0.0, None, 0.0, 0.0), 0, "F, other"),
        (0.974, OriginScore(0.0, None, 0.0, 0.0), 0, "other"),
        (0.975, OriginScore(0.0, None, 0.0, 0.0), 0, "other"),
    ],
)
def test_a_level_is_missed_where_a_figure_is_on_the_wrong_side(
    f: float, red: OriginScore, lowered: int, missed: str
) -> None:
    none = OriginScore(0.0, None, 0.0, 0.0)
    made = {
        real.DEFAULT: [a_score(real.DEFAULT, f, red, lowered)],
        "voxels": [a_score("voxels", 0.975, none)],
        "Poisson": [a_score("Poisson", 0.9, none)],
        real.DRAWN: [a_score(real.DRAWN, 1.0, none)],
    }
    row = real.levels(made)
    assert len(row) == len(real.LEVEL_HEAD)
    assert row[5:7] == ("voxels", "97.50")
    assert row[-1] == missed


def test_the_tables_tell_what_was_measured(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "multilevel").mkdir()
    scan = hall(4000)
    np.savetxt(tmp_path / "multilevel" / "hall.xyz", scan[:, [0, 2, 1]] * (1, 1, -1), fmt="%.9f")
    # In place: the choices of --scan are made of its names.
    monkeypatch.setitem(SCANS, "office", Scan(("hall.xyz",), "y", (1000, 500)))
    options = [
        "--how",
        "drawn",
        "--scan",
        "office",
        "--seed",
        "7",
        "--seed",
        "8",
        "--json",
        str(tmp_path / "a.json"),
    ]
    for row in (real.DEFAULT, real.PLAIN, real.DRAWN, "voxels"):
        options += ["--row", row]
    done = CliRunner().invoke(real.main, [str(tmp_path), *options], catch_exceptions=False)
    lines = [line.strip("| ").split(" | ") for line in done.output.splitlines()]
    assert [line[:4] for line in lines[2:10]] == [
        ["office", "drawn", size, row]
        for size in ("1,000", "500")
        for row in (real.DEFAULT, real.PLAIN, real.DRAWN, "voxels")
    ]
    told = json.loads((tmp_path / "a.json").read_text(encoding="utf-8"))
    assert len(told) == 16
    for score in told:
        assert score["mesh"]["within"] == drawn(scan, score["points"], score["seed"]).cell
        assert score["mesh"]["unseen"] == score["mesh"]["beside"] == 0
        assert score["mesh"]["points"] == 4000
    first = [score["mesh"]["precision"] for score in told[:2]]
    assert lines[2][5] == f"{50 * sum(first):.2f}"
    assert [line[:3] for line in lines[-2:]] == [
        ["office", "drawn", size] for size in ("1,000", "500")
    ]


def test_without_the_scans_it_says_so(tmp_path: Path) -> None:
    done = CliRunner().invoke(real.main, [str(tmp_path / "none")])
    assert done.exit_code == 1
    assert "no such folder; the scans are not a part of the project" in str(done.output)
