"""Samples of points, and the planes through what surrounds them.

How these tests could be cheated: by a sample that is the beginning of the cloud, or by clouds too
small to be sampled; by planes across an axis, without noise.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from mlscli.geometry.surroundings import PointSample, planes
from mlscli.runtime.arrays import Float64


def sampled(size: int, *clouds: Float64) -> Float64:
    sample = PointSample(size)
    for cloud in clouds:
        sample.add(cloud)
    return sample.points


def rows(points: Float64) -> set[tuple[float, ...]]:
    return {tuple(point) for point in points.tolist()}


def test_a_sample_depends_neither_on_order_nor_on_repetition_nor_on_how_points_come() -> None:
    rng = np.random.default_rng(1)
    points = rng.normal(size=(5000, 3)).round(2)
    expected = sampled(1000, points)

    again = points[rng.permutation(5000)]
    assert sampled(1000, again).tobytes() == expected.tobytes()
    assert sampled(1000, points, again, points[:700]).tobytes() == expected.tobytes()
    assert sampled(1000, *np.array_split(again, 300)).tobytes() == expected.tobytes()


def test_a_sample_is_of_distinct_points_of_the_cloud_from_all_over_it() -> None:
    rng = np.random.default_rng(2)
    points = np.sort(rng.uniform(0, 1, (20_000, 3)), axis=0)
    sample = sampled(2000, points)

    assert len(rows(sample)) == len(sample) == 2000
    assert rows(sample) <= rows(points)
    np.testing.assert_allclose(np.percentile(sample, [10, 50, 90]), [0.1, 0.5, 0.9], atol=0.05)
    # Its beginning is a sample, too.
    np.testing.assert_allclose(np.percentile(sample[:300], [10, 50, 90]), [0.1, 0.5, 0.9], atol=0.1)


def test_all_points_are_kept_where_there_is_room_but_for_those_that_are_no_measurement() -> None:
    points = np.array([[1.0, 2, 3], [np.nan, 0, 0], [4, 5, np.inf], [-0.0, 0, 0], [0.0, 0, -0.0]])
    points = np.concatenate((points, [[1e33, 0, 0], [0, -1.1e8, 0]]))

    assert rows(sampled(10, points)) == {(1, 2, 3), (0, 0, 0)}
    assert sampled(10).shape == (0, 3)


def test_a_noisy_plane_has_its_normal_all_over() -> None:
    rng = np.random.default_rng(3)
    turn = Rotation.from_quat(rng.normal(size=4))
    flat = np.column_stack((rng.uniform(-5, 5, (3000, 2)), rng.normal(0, 0.005, 3000)))
    found = planes(turn.apply(flat) + 1e6)

    along = np.abs(found.normals @ turn.apply([0.0, 0.0, 1.0]))
    assert np.median(found.trust) > 0.9
    assert np.median(np.degrees(np.arccos(np.minimum(along, 1)))) < 2


def test_planes_tell_how_wide_and_how_thick_the_surroundings_are() -> None:
    rng = np.random.default_rng(6)
    points = rng.normal(size=(500, 3)) * (1.0, 1.0, 0.2)
    found = planes(points, 9)
    for n in (0, 123, 499):
        apart = np.linalg.norm(points - points[n], axis=1)
        near = points[np.argsort(apart)[:9]]
        assert found.reach[n] == np.sort(apart)[8]
        np.testing.assert_allclose(found.middles[n], near.mean(axis=0))
        expected = np.linalg.eigvalsh(np.cov(near.T, bias=True))
        np.testing.assert_allclose(found.variances[n], expected, atol=1e-12)
        across = (near - near.mean(axis=0)) @ found.normals[n]
        np.testing.assert_allclose(across.var(), expected[0], atol=1e-12)


def test_neither_noise_nor_a_line_nor_a_stray_point_is_a_plane() -> None:
    rng = np.random.default_rng(4)
    ball = rng.normal(size=(3000, 3))
    line = np.outer(np.arange(3000.0), [1.0, 2.0, 3.0]) + rng.normal(0, 1e-3, (3000, 3))
    # What one sweep of a laser sees of a wall: its jitter lies in one plane with it.
    sweep = np.column_stack((np.arange(3000.0), rng.normal(0, 1e-3, 3000), np.zeros(3000)))
    floor = np.column_stack((rng.uniform(0, 1, (3000, 2)), np.zeros(3000)))

    assert planes(ball).trust.mean() < 0.05
    assert planes(line).trust.mean() < 0.05
    assert planes(sweep).trust.mean() < 0.05
    trust = planes(np.concatenate((floor, [[3.0, 3.0, 0.0]]))).trust
    assert trust[-1] == 0
    assert trust[:-1].mean() > 0.9


def test_a_few_points_are_no_trouble() -> None:
    for count in range(6):
        found = planes(np.random.default_rng(5).normal(size=(count, 3)))
        assert found.normals.shape == (count, 3)
        assert np.isfinite(found.trust).all()
