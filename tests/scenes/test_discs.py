"""What discs hide, against plain loops over all discs.

Ways to pass without being right: all is seen, or nothing; boxes far from the point, at the border
of the grid or outside of it are not looked at; discs hide as whole planes, or what is in front of
them; the depth is not heeded; what is looked for first is not found first.
"""

from __future__ import annotations

import numpy as np
import pytest

import mlscli.runtime.threads
from mlscli.runtime.arrays import Float64
from mlscli.scenes.discs import Discs, discs, in_frame, in_sight, sights


def random_discs(rng: np.random.Generator, count: int) -> Discs:
    normal = rng.normal(size=(count, 3))
    normal[rng.random(count) < 0.3] = (0.0, 0.0, 1.0)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    radius = rng.choice((0.05, 0.3, 1.5), count) * rng.uniform(0.5, 1, count)
    depth = radius * rng.choice((0.01, 0.2, 0.9), count)
    return discs(rng.uniform(-3, 3, (count, 3)), normal, radius, depth)


def hides(made: Discs, n: int, camera: Float64, point: Float64) -> bool:
    """Return whether a disc hides a point, by the place where the ray meets its plane."""
    normal, centre, radius = made.normal[n], made.centre[n], made.radius[n]
    height = normal @ (point - centre)
    doubt = min(made.depth[n] / radius, 0.5) * np.linalg.norm(point - centre)
    if abs(height) <= max(made.depth[n], doubt):
        return False
    other = normal @ (camera - centre)
    if height * other >= 0:
        return False
    met = point + (camera - point) * (height / (height - other))
    return bool(np.linalg.norm(met - centre) <= radius)


def test_what_is_seen_is_what_no_disc_hides() -> None:
    rng = np.random.default_rng(1)
    shares = []
    for count in (1, 5, 40, 200):
        made = random_discs(rng, count)
        # Some points and cameras lie outside of all boxes.
        points, cameras = rng.uniform(-5, 5, (40, 3)), rng.uniform(-6, 6, (9, 3))
        points[:5, 0] = cameras[0, 0]
        points[5:10, 1:] = cameras[0, 1:]
        expected = np.array(
            [[not any(hides(made, n, c, p) for n in range(count)) for p in points] for c in cameras]
        )
        assert np.array_equal(sights(points, cameras, 100.0, made), expected)
        shares.append(expected.mean())
    assert shares[0] > 0.9 > 0.6 > shares[-1] > 0.02


def test_a_plane_hides_what_lies_beyond_and_nothing_on_it_or_before_it() -> None:
    rng = np.random.default_rng(2)
    flat = np.column_stack((rng.uniform(0, 4, (2000, 2)), np.zeros(2000)))
    up = np.tile([0.0, 0.0, 1.0], (2000, 1))
    made = discs(flat, up, np.full(2000, 0.3), np.full(2000, 0.01))
    cameras = np.array([[2.0, 2.0, 3.0], [2.0, 2.0, 0.1]])
    on, before, beyond = flat, flat + np.array([0, 0, 0.05]), flat * 0.5 + (1, 1, -0.5)
    assert sights(on, cameras, 9.0, made).all()
    assert sights(before, cameras, 9.0, made).all()
    assert not sights(beyond, cameras, 9.0, made).any()
    assert sights(beyond, cameras - (0, 0, 5), 9.0, made).all()


def test_the_first_that_are_seen_are_found_and_no_more_are_looked_for() -> None:
    made = random_discs(np.random.default_rng(3), 50)
    points = np.random.default_rng(4).uniform(-3, 3, (200, 3))
    camera = np.array([0.0, 0.0, 4.0])
    seen = np.flatnonzero(sights(points, camera[None], 100.0, made)[0])
    backwards = np.arange(200)[::-1].copy()
    assert 20 < len(seen) < 180
    assert in_sight(points, backwards, camera, made, 200).tolist() == seen[::-1].tolist()
    assert in_sight(points, backwards, camera, made, 7).tolist() == seen[:-8:-1].tolist()


def test_one_sees_as_far_as_asked_for() -> None:
    made = discs(np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]]), np.ones(1), np.ones(1))
    points = np.column_stack((np.zeros((9, 2)), np.arange(1.0, 10)))
    assert sights(points, np.zeros((1, 3)), 4.0, made).tolist() == [[True] * 4 + [False] * 5]


@pytest.mark.parametrize("angle", [20.0, 180.0, 250.0, 360.0])
def test_a_camera_frames_a_cone(angle: float) -> None:
    rng = np.random.default_rng(5)
    points, camera = rng.uniform(-2, 2, (500, 3)), np.array([0.3, -0.2, 0.1])
    direction = np.array([0.6, 0.0, 0.8])
    away = points - camera
    far = np.linalg.norm(away, axis=1)
    apart = np.degrees(np.arccos(np.clip(away @ direction / far, -1, 1)))
    expected = np.flatnonzero((far <= 1.8) & (apart <= angle / 2))
    found = in_frame(points, camera, direction, float(np.cos(np.radians(angle / 2))), 1.8)
    assert found.tolist() == expected.tolist()
    assert len(found)


def test_threads_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    made = random_discs(np.random.default_rng(6), 100)
    rng = np.random.default_rng(7)
    points, cameras = rng.uniform(-3, 3, (300, 3)), rng.uniform(-3, 3, (30, 3))
    found = []
    for processors in (1, 3):
        monkeypatch.setattr(mlscli.runtime.threads, "processors", lambda n=processors: n)
        found.append(sights(points, cameras, 5.0, made))
    assert np.array_equal(found[0], found[1])
