"""What lies near points and triangles, against loops over all of them.

How one could cheat: to look into the columns around only, where the distance is greater than a
column; to take a corner, or the box, of a triangle for the triangle; to count a distance that is
met exactly at random. So distances are greater and smaller than columns, triangles are upright, a
line or a single point, and half of the coordinates are coarse.
"""

from __future__ import annotations

import numpy as np
import pytest

from mlscli.errors import InputError, UsageError
from mlscli.runtime.arrays import Float64
from mlscli.scoring.near import PointColumns, are_near, checked_scan, near_triangles, seen_by
from tests.scoring import references as slow


def some_points(rng: np.random.Generator, size: int) -> Float64:
    points: Float64 = rng.uniform(-3, 3, (size, 3)) * rng.choice([0.2, 1], 3) + rng.integers(
        -9, 9, 3
    )
    if rng.random() < 0.5:
        points = np.round(points * 4) / 4
    return points


def test_points_near_points_are_those_that_loops_find() -> None:
    found = 0
    for seed in range(30):
        rng = np.random.default_rng(seed)
        points = some_points(rng, 60)
        others = points[rng.permutation(60)[:20]] + rng.choice([0, 0.25, 0.5], (20, 3))
        distance, side = float(rng.choice([0.25, 0.75, 1.5])), float(rng.choice([0.1, 0.5, 2]))
        near = are_near(points, PointColumns.of(others, side), distance)
        assert near.tolist() == [
            any(slow.squared_distance(p, o) <= distance**2 for o in others.tolist())
            for p in points.tolist()
        ]
        found += int(np.count_nonzero(near))
    assert 300 < found < 1500


def some_triangles(rng: np.random.Generator, size: int) -> Float64:
    corners = some_points(rng, 3 * size).reshape(size, 3, 3)
    kind = rng.integers(0, 5, size)
    corners[kind == 0, 2] = corners[kind == 0, 1]
    corners[kind == 1] = corners[kind == 1, :1]
    # No more than a line; and upright.
    corners[kind == 2, 2] = (corners[kind == 2, 0] + corners[kind == 2, 1]) / 2
    corners[kind == 3, 2, :2] = corners[kind == 3, 1, :2]
    return corners


def test_points_near_triangles_are_those_that_loops_find_group_by_group() -> None:
    found = 0
    for seed in range(25):
        rng = np.random.default_rng(seed)
        points, triangles = some_points(rng, 80), some_triangles(rng, 6)
        triangles += points.mean(axis=0) - triangles.mean(axis=(0, 1))
        if rng.random() < 0.5:
            triangles = np.round(triangles * 4) / 4
        group = rng.integers(0, 3, 6).astype(np.uint8)
        distance, side = float(rng.choice([0.25, 0.75, 1.5])), float(rng.choice([0.1, 0.5, 2]))
        columns = PointColumns.of(points, side)
        near = near_triangles(columns, triangles, group, 3, distance)
        apart = np.array(
            [[slow.to_triangle(p, *t) for t in triangles] for p in points[columns.order]]
        )
        for number in range(3):
            least = apart[:, group == number].min(axis=1, initial=np.inf)
            # But for rounding, which may decide where the distance is met.
            clear = np.abs(least - distance) > 1e-9
            np.testing.assert_array_equal(near[number][clear], (least <= distance)[clear])
            found += int(np.count_nonzero(near[number]))
    assert 500 < found < 5000


def test_a_distance_that_is_met_exactly_is_near() -> None:
    corners = np.array([[(0.0, 0.0, 0.0), (4.0, 0.0, 0.0), (0.0, 4.0, 0.0)]])
    points = np.array([(1.0, 1.0, 0.5), (-0.5, 1.0, 0.0), (0.0, -0.5, 0.0), (1.0, 1.0, -0.5)])
    group = np.zeros(1, dtype=np.uint8)
    assert near_triangles(PointColumns.of(points, 0.25), corners, group, 1, 0.5).all()
    assert not near_triangles(PointColumns.of(points, 0.25), corners, group, 1, 0.499).any()


def test_large_coordinates_cost_nothing_but_their_own_digits() -> None:
    rng = np.random.default_rng(1)
    points = np.round(rng.uniform(-2, 2, (50, 3)) * 64) / 64
    triangles = np.round(rng.uniform(-2, 2, (4, 3, 3)) * 64) / 64
    group, far = np.zeros(4, dtype=np.uint8), np.array([513450.0, 5402650.0, 300.0])
    # The columns are whole, so that they stand the same there.
    near, there = (
        near_triangles(PointColumns.of(points + shift, 0.25), triangles + shift, group, 1, 0.5)
        for shift in (0 * far, far)
    )
    assert 5 < np.count_nonzero(near) < 45
    np.testing.assert_array_equal(near, there)


@pytest.mark.parametrize(
    ("scan", "within", "complaint"),
    [
        (np.zeros((0, 3)), 1.0, "the scan holds no points"),
        (np.zeros((2, 2)), 1.0, r"`scan`: has shape \(2, 2\) and dtype float64; expected points"),
        (np.zeros((2, 3), dtype=np.complex128), 1.0, "`scan`: has shape .* dtype complex128"),
        (np.full((2, 3), np.nan), 1.0, "`scan`: not all coordinates are finite"),
        (np.ones((2, 3)), 0.0, "`within` 0.0: expected a number above 0"),
        (np.ones((2, 3)), -1.0, "`within` -1.0: expected a number above 0"),
        (np.ones((2, 3)), np.inf, "`within` inf: expected a number above 0"),
        (np.ones((2, 3)), np.nan, "`within` nan: expected a number above 0"),
        (np.full((2, 3), 5e6), 1e-3, "`within` 0.001: too small for coordinates of up to 5e.06; "),
    ],
)
def test_a_scan_that_nothing_can_be_compared_with_is_refused(
    scan: Float64, within: float, complaint: str
) -> None:
    with pytest.raises((UsageError, InputError), match=f"^{complaint}"):
        checked_scan(scan, within)


def test_the_least_distance_that_the_refusal_names_is_taken() -> None:
    scan = np.full((2, 3), -5e6)
    with pytest.raises(UsageError, match=r"at least ([\d.e-]+)$") as refusal:
        checked_scan(scan, 1e-3)
    checked_scan(scan, float(str(refusal.value).split()[-1]) * 1.1)


def test_a_flight_has_seen_what_it_came_near_in_all_three_dimensions() -> None:
    scan = np.array([(0.0, 0.0, 0.0), (0.0, 0.0, 2.9), (0.0, 0.0, 3.1), (3.1, 0.0, 0.0)])
    flight = np.array([(0.0, 0.0, 0.0), (1e12, 0.0, 0.0)])
    assert seen_by(flight, scan, 1.0).tolist() == [True, True, False, False]
    assert seen_by(flight.astype(np.float32), scan, 1.1).tolist() == [True] * 4


def test_what_one_thread_has_found_no_other_loses() -> None:
    rng = np.random.default_rng(1)
    points = rng.uniform(0, 1, (200_000, 3)) * (1, 1, 0.1)
    # The first triangle is near all points. The last, in another thread's range, is near none, but
    # tried for all: its box holds them. The rest is far away.
    near = np.array([(-1, -1, 0), (3, -1, 0), (-1, 3, 0)])
    tried, far = np.array([(-1.0, -1, -0.5), (3, 3, 3.5), (3, 3, 3.5)]), np.array((9.0, 9, 9))
    triangles = np.array([near, *[tried + far] * 4999, tried])
    columns = PointColumns.of(points, 0.5)
    group = np.zeros(len(triangles), dtype=np.uint8)
    for _ in range(5):
        assert near_triangles(columns, triangles, group, 1, 0.2).all()
