"""Scans: what a dense cloud tells of its surfaces, and what hides what in it.

Ways to pass without being right: texture that is the same everywhere; strays that stretch the
bounds; sparse parts taken for strays; order or repetitions that change the scan.
"""

from __future__ import annotations

import numpy as np
import pytest

from mlscli.errors import UsageError
from mlscli.runtime.arrays import Float64
from mlscli.scenes.discs import sights
from mlscli.scenes.noise import Noise
from mlscli.scenes.scan_flight import fly_scan
from mlscli.scenes.scans import Scan
from mlscli.scenes.surfaces import Scatter
from tests.scenes.clouds import level, upright


def seen(scan: Scan, *camera: float) -> Float64:
    """Return the points of a scan that are seen from a position."""
    return scan.xyz[np.flatnonzero(sights(scan.xyz, np.array([camera]), 1e3, scan.discs)[0])]


def spacing_of(points: Float64) -> float:
    return Scan.of("", points).spacing


def test_a_roof_hides_what_lies_below_it_and_not_what_lies_beside_it() -> None:
    ground, roof = level(8000, (0, 10), (0, 10), 0.0), level(2000, (3, 7), (3, 7), 2.0)
    scan = Scan.of("roof", np.concatenate((ground, roof)))
    found = seen(scan, 5.0, 5.0, 8.0)
    assert (found[:, 2] == 2.0).sum() == len(roof)
    # The roof's shadow on the ground is larger by a third on each side.
    away = np.abs(found[found[:, 2] == 0.0, :2] - 5).max(axis=1)
    assert away.min() == pytest.approx(2.0 * 4 / 3, abs=2 * scan.spacing)
    beside = np.abs(ground[:, :2] - 5).max(axis=1) > 2.9
    assert (away > 2.9).sum() == pytest.approx(beside.sum(), rel=0.01)
    # From below it is the other way round.
    low = seen(scan, 5.0, 5.0, 1.0)
    assert set(low[:, 2].tolist()) == {0.0, 2.0}
    assert len(low) == len(scan.xyz)


def test_a_wall_hides_what_lies_behind_it() -> None:
    floor = level(10000, (0, 10), (0, 5), 0.0)
    wall = upright(5000, (0, 5), (0, 3), 5.0)
    found = seen(Scan.of("wall", np.concatenate((floor, wall))), 1.0, 2.5, 1.5)
    # But for the floor's first row behind it, which is as near to the wall as points are apart.
    assert found[:, 0].max() < 5 + 2 * spacing_of(floor)
    assert (found[:, 0] == 5.0).sum() == len(wall)
    assert (found[:, 0] < 5).sum() == (floor[:, 0] < 5).sum()


def test_noise_on_a_surface_does_not_hide_the_surface() -> None:
    rng = np.random.default_rng(3)
    ground = level(6000, (0, 10), (0, 10), 0.0)
    both = np.concatenate((ground, level(6000, (2, 8), (2, 8), -1.0, seed=4)))
    scan = Scan.of("rough", both + rng.normal(0, 0.1 * spacing_of(ground), both.shape))
    found = seen(scan, 5.0, 5.0, 4.0)
    assert (found[:, 2] > -0.5).sum() > 0.98 * len(ground)
    assert (found[:, 2] < -0.5).sum() < 0.002 * len(ground)


def test_texture_is_on_edges_and_corners() -> None:
    ground, wall = level(5000, (0, 5), (0, 5), 0.0), upright(3000, (0, 5), (0, 3), 2.5)
    scan = Scan.of("edge", np.concatenate((ground, wall)))
    to_edge = np.hypot(scan.xyz[:, 0] - 2.5, scan.xyz[:, 2])
    assert scan.texture[to_edge > 3 * scan.spacing] == pytest.approx(0.05, abs=1e-3)
    assert np.median(scan.texture[to_edge < scan.spacing / 2]) > 4 * 0.05
    everywhere = np.random.default_rng(5).normal(size=(3000, 3))
    assert 0.3 < np.median(Scan.of("ball", everywhere).texture) <= 1.05


def test_strays_neither_bound_a_scan_nor_hide_anything() -> None:
    ground = level(4000, (0, 10), (0, 10), 0.0)
    lone = np.array([[5.0, 5.0, 3.0], [5.1, 5.0, 300.0]])
    scan = Scan.of("strays", np.concatenate((ground, lone)))
    assert scan.xyz[scan.stray].tolist() == lone.tolist()
    assert scan.bounds[1].tolist() == ground.max(axis=0).tolist()
    assert len(seen(scan, 5.0, 5.0, 6.0)) == len(ground) + 2
    assert scan.radius[scan.stray].max() < 4 * scan.spacing


def test_what_is_sparse_all_over_is_no_stray_and_hides() -> None:
    # As a scanner sees it: points are as far apart as they are from it, relatively.
    rng = np.random.default_rng(2)
    away, turn = np.exp(rng.uniform(0, np.log(30), 30000)), rng.uniform(0, np.pi / 2, 30000)
    ground = np.column_stack((away * np.cos(turn), away * np.sin(turn), np.zeros(30000)))
    below = level(500, (12, 18), (12, 18), -3.0, seed=3)
    scan = Scan.of("fading", np.concatenate((ground, below)))
    assert not scan.stray.any()
    assert scan.radius.max() > 10 * scan.spacing > 50 * scan.radius.min()
    assert scan.bounds[1].tolist() == ground.max(axis=0).tolist()
    assert set(seen(scan, 15.0, 15.0, 9.0)[:, 2].tolist()) == {0.0}


def test_neither_order_nor_repetitions_nor_signs_of_zero_change_a_scan() -> None:
    points = level(500, (0, 1), (0, 1), 0.0)
    scan = Scan.of("a", points)
    mixed = np.random.default_rng(1).permutation(np.concatenate((points, points[:50] * (1, 1, -1))))
    other = Scan.of("a", mixed)
    for name in ("xyz", "foot", "normal", "radius", "depth", "texture", "stray"):
        assert getattr(scan, name).tobytes() == getattr(other, name).tobytes()


def test_a_survey_s_usual_height_is_a_tenth_of_the_width() -> None:
    assert Scan.of("a", level(20000, (0, 40), (0, 10), 0.0)).usual_height == 2.0


def test_points_whose_distances_are_0_when_squared_make_a_scan_all_the_same() -> None:
    here, ground = level(50, (1e-200, 2e-200), (0, 1e-200), 0.0), level(500, (0, 10), (0, 10), 0.0)
    for points in (here, np.concatenate((here, ground))):
        scan = Scan.of("near", points)
        assert (scan.radius > 0).all()
        flight = fly_scan(scan, 20, Noise(sigma=Scatter(0, 0), salt_pepper=0), survey=True)
        assert flight.points >= 20
        assert flight.seen > 0.95


@pytest.mark.parametrize("count", [0, 1, 12])
def test_too_few_points_are_no_scan(count: int) -> None:
    points = np.repeat(level(count, (0, 1), (0, 1), 0.0), 3, axis=0)
    with pytest.raises(UsageError, match=f"few: holds {count} distinct points, expected"):
        Scan.of("few", points)


def test_too_many_points_are_refused_before_any_work(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mlscli.scenes.scans.MAX_SCAN_POINTS", 99)
    with pytest.raises(UsageError, match="many: holds 100 points, expected at most 99; `crop`"):
        Scan.of("many", level(100, (0, 1), (0, 1), 0.0))
