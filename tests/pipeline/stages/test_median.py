"""The median filter on points.

How one could cheat: clouds without equal distances, or a radius that holds every point, or
points as dense everywhere, so that the nearest are never far from where they were sought before.
"""

from __future__ import annotations

import numpy as np
import pytest

from mlscli.keyframes.batches import Points
from mlscli.parameters.lengths import Cells
from mlscli.pipeline.stages.median import Median
from tests.helpers import references
from tests.helpers.maps import random_points, symmetries, turned_points


def rows(points: Points) -> list[tuple[tuple[float, float, float], int]]:
    return [
        ((x, y, z), keyframe)
        for (x, y, z), keyframe in zip(points.xyz.tolist(), points.keyframe.tolist(), strict=True)
    ]


def test_the_filter_agrees_with_its_rule_read_plainly() -> None:
    rng = np.random.default_rng(1)
    limited = dropped = moved = 0
    for _ in range(300):
        points = random_points(rng)
        radius = float(rng.choice([0.25, 0.5, 0.8, 1.0]))
        most = int(rng.choice([0, 1, 4, 7, 100]))
        least = int(rng.integers(0, (most or 6) + 1))
        again = float(rng.choice([0, 0.05, 0.1, 0.3]))
        result = Median(radius, most, least, again).apply(points, 0.5)
        expected = references.median(points, radius, most, least, again)
        assert rows(result) == expected
        dropped += len(expected) < points.size
        limited += expected != references.median(points, radius, 0, least, again)
        moved += expected != references.median(points, radius, most, least)
    assert dropped > 100
    assert limited > 50
    assert moved > 20


def test_of_equally_distant_neighbours_the_lower_count() -> None:
    # Two neighbours at distance 1, above and below; where only one counts, it is the lower.
    xyz = np.array([[0.0, 0.0, 5.0], [0.0, 0.0, 6.0], [0.0, 0.0, 4.0], [0.0, 0.6, 4.2]])
    points = Points(xyz, np.zeros(4, dtype=np.int32))
    # Heights 4, 4.2 and 5 of the point, the near one and the lower of the equal ones.
    assert Median(1.0, 2, 1).apply(points, 1.0).xyz[0, 2] == 4.2
    # All: 4, 4.2, 5, 6, of which index 4 // 2 is the third.
    assert Median(1.0, 0, 1).apply(points, 1.0).xyz[0, 2] == 5.0


def test_an_outlier_that_looks_again_comes_nearer_to_its_surface() -> None:
    rng = np.random.default_rng(6)
    floor = np.c_[rng.uniform(0, 4, (600, 2)), rng.normal(0, 0.1, 600)]
    outliers = np.c_[rng.uniform(1, 3, (20, 2)), rng.uniform(0.4, 0.8, 20)]
    points = Points(np.concatenate((floor, outliers)), np.zeros(620, dtype=np.int32))
    once, again = (
        Median(1.0, 16, 4, recentre).apply(points, 0.5).xyz[600:, 2] for recentre in (0, 0.2)
    )
    assert np.mean(once) > 0.08
    assert abs(np.mean(again)) < np.mean(once) / 2


def test_the_nearest_are_found_however_dense_the_points_are() -> None:
    rng = np.random.default_rng(7)
    # Clusters a thousand times denser than the rest, points that coincide, a wall, and equal steps.
    clusters = rng.normal(0, 0.003, (300, 3)) + rng.uniform(0, 3, (3, 3)).repeat(100, axis=0)
    coinciding = np.full((40, 3), 1.5)
    wall = np.c_[np.full(300, 0.7), rng.uniform(0, 3, (300, 2))]
    steps = np.stack(np.meshgrid(*[np.arange(7) / 4] * 3), axis=-1).reshape(-1, 3)
    sparse = rng.uniform(0, 3, (200, 3))
    xyz = rng.permutation(np.concatenate((clusters, coinciding, wall, steps, sparse)))
    points = Points(xyz, np.zeros(len(xyz), dtype=np.int32))
    for radius, most, least, again in ((1.0, 16, 8, 0.1), (0.5, 30, 3, 0.0), (0.3, 1, 1, 0.05)):
        result = Median(radius, most, least, again).apply(points, 0.5)
        assert rows(result) == references.median(points, radius, most, least, again)


def test_a_median_is_always_a_height_that_was_measured() -> None:
    rng = np.random.default_rng(2)
    points = random_points(rng, 500)
    result = Median(Cells(2), 5, 0).apply(points, 0.5)
    assert np.isin(result.xyz[:, 2], points.xyz[:, 2]).all()


def test_neighbours_are_found_across_columns_and_far_from_the_origin() -> None:
    for offset in (0.0, 1e3, -1e8, 1e8):
        # Points a radius apart, to the last bit, wherever the edges of the columns lie.
        steps = np.arange(200) * 0.5
        xyz = np.c_[offset + steps, np.full(200, -offset), np.zeros(200)]
        points = Points(xyz, np.zeros(200, dtype=np.int32))
        kept = Median(0.5, 0, 2).apply(points, 0.5)
        assert kept.size == 198


def test_turning_and_shuffling_the_points_turns_and_shuffles_the_result() -> None:
    rng = np.random.default_rng(3)
    for _ in range(50):
        points = random_points(rng)
        stage = Median(0.7, 5, 2)
        result = stage.apply(points, 0.5)
        order = rng.permutation(points.size)
        shuffled = stage.apply(points.take(order), 0.5)
        assert sorted(rows(shuffled)) == sorted(rows(result))
        for symmetry in symmetries():
            turned = stage.apply(turned_points(points, symmetry), 0.5)
            assert rows(turned) == rows(turned_points(result, symmetry))


def test_threads_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    points = random_points(np.random.default_rng(4), 30_000)
    spread = Points(points.xyz * (30, 30, 1), points.keyframe)
    results = []
    for processors in (1, 2, 5):
        monkeypatch.setattr("mlscli.runtime.threads.processors", lambda n=processors: n)
        monkeypatch.setattr("mlscli.runtime.threads.WORTHWHILE", 100)
        results.append(Median(0.7, 5, 2).apply(spread, 0.5))
    assert results[0].size > 1000
    for result in results[1:]:
        assert rows(result) == rows(results[0])


def test_points_reach_no_farther_than_declared() -> None:
    rng = np.random.default_rng(5)
    stage, cell_size = Median(0.7, 5, 1), 0.5
    for _ in range(100):
        points = random_points(rng)
        cells = np.floor(points.xyz[:, :2] / cell_size)
        near = (np.abs(cells) <= stage.reach(cell_size)).all(axis=1)
        alone = stage.apply(Points(points.xyz[near], points.keyframe[near]), cell_size)
        everything = stage.apply(points, cell_size)
        for one, other in ((alone, everything), (everything, alone)):
            inside = (np.floor(one.xyz[:, :2] / cell_size) == 0).all(axis=1)
            assert set(rows(one.take(inside))) <= set(rows(other))


def test_as_many_neighbours_as_count_at_most_may_be_asked_for() -> None:
    assert list(Median(1.0, 4, 4).faults(None, None)) == []
    assert [fault.field for fault in Median(1.0, 4, 5).faults(None, None)] == ["min_nb"]
    assert list(Median(1.0, 0, 5).faults(None, None)) == []
