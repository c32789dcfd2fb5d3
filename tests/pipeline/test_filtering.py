"""Points are filtered again where others come within their sight, and nowhere else.

How one could cheat: ask all points again; say of each point that it looked over the whole radius;
points so few that none has neighbours enough; one point at a time, or never many in a cell.
"""

from __future__ import annotations

import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mlscli.config import loads
from mlscli.keyframes.batches import Points
from mlscli.pipeline.filtering import FilteredPoints, kept
from mlscli.pipeline.pipeline import Pipeline
from mlscli.pipeline.report import Report
from mlscli.pipeline.stages.median import Median
from mlscli.runtime.arrays import Bool, Float64
from tests.helpers.maps import CELL, random_points

seeds = st.integers(0, 2**32 - 1)
MEDIANS = st.sampled_from(
    [Median(0.8, max_nb=6, min_nb=2), Median(0.8, max_nb=0, min_nb=3), Median(0.6, 4, 1, 0.2)]
)


def points_of(xyz: Float64) -> Points:
    return Points.of(xyz, np.zeros(len(xyz), dtype=np.int32))


@settings(max_examples=35, deadline=None)
@given(seeds, MEDIANS)
def test_what_is_asked_for_is_what_all_are_told(seed: int, stage: Median) -> None:
    rng = np.random.default_rng(seed)
    points = random_points(rng)
    asked = rng.random(points.size) < 0.4
    told = stage.evaluate(points, CELL, asked).xyz[asked]
    everybody = stage.evaluate(points, CELL).xyz[asked]
    assert told.tobytes() == everybody.tobytes()


@settings(max_examples=35, deadline=None)
@given(seeds, MEDIANS)
def test_nothing_farther_off_than_a_stage_looked_changes_a_point(seed: int, stage: Median) -> None:
    rng = np.random.default_rng(seed)
    points = random_points(rng)
    everybody = np.ones(points.size, dtype=np.bool_)
    before = stage.evaluate(points, CELL, everybody)
    low, high = points.xyz.min(axis=0, initial=0.0), points.xyz.max(axis=0, initial=0.0)
    other = rng.uniform(low - 0.5, high + 0.5, (1, 3))
    after = stage.evaluate(points_of(np.concatenate((points.xyz, other))), CELL).xyz[:-1]
    dx, dy = (points.xyz[:, :2] - other[:, :2]).T
    out_of_sight = dx * dx + dy * dy > before.looked
    assert after[out_of_sight].tobytes() == before.xyz[out_of_sight].tobytes()


@pytest.mark.parametrize("max_nb", [0, 6])
def test_only_points_that_see_a_new_one_are_asked_again(
    max_nb: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(1)
    cloud = np.c_[rng.uniform(0, 8, (2000, 2)), rng.normal(0, 0.05, 2000)]
    new = np.array([[4.0, 4.0, 0.0], [4.3, 3.6, 0.01]])
    asked: list[tuple[Points, Bool]] = []
    evaluate = Median.evaluate

    def watched(stage: Median, points: Points, cell_size: float, which: Bool) -> object:
        asked.append((points, which))
        return evaluate(stage, points, cell_size, which)

    monkeypatch.setattr(Median, "evaluate", watched)
    filtered = FilteredPoints(Median(0.8, max_nb=max_nb, min_nb=2))
    filtered.add(pipeline(), points_of(cloud))
    outcome = filtered.add(pipeline(), points_of(new))
    points, which = asked[1]
    told = {tuple(row) for row in points.xyz[which].tolist()}
    # By the definition: those whose nearest so many, of all that are within the radius, end there.
    expected = {tuple(row) for row in new.tolist()}
    for row in cloud:
        apart = ((cloud - row) ** 2).sum(axis=1)
        nearest = np.sort(apart[apart <= 0.64])
        sight = nearest[max_nb] if 0 < max_nb < len(nearest) else 0.64
        if (((new - row)[:, :2] ** 2).sum(axis=1) <= sight).any():
            expected.add(tuple(row.tolist()))
    assert told == expected
    assert len(expected) < (400 if max_nb == 0 else 60)
    assert kept(outcome.rows).size >= 2


@settings(max_examples=35, deadline=None)
@given(seeds, MEDIANS)
def test_many_that_come_to_one_cell_change_what_each_of_them_would(
    seed: int, stage: Median
) -> None:
    rng = np.random.default_rng(seed)
    cloud = random_points(rng, 120).xyz
    new = np.round(rng.uniform((0, 0, -0.3), (0.6, 0.6, 0.3), (12, 3)) * 16) / 16
    filtered = FilteredPoints(stage)
    first, then = (filtered.add(pipeline(), points_of(xyz)) for xyz in (cloud, new))
    unchanged = ~np.isin(first.rows[:, 0], then.cells.keys)
    together = kept(np.concatenate((first.rows[unchanged], then.rows)))
    once = stage.apply(points_of(np.concatenate((cloud, new))), CELL)
    assert sorted(together.xyz.tolist()) == sorted(once.xyz.tolist())


def test_a_point_costs_no_more_where_many_share_its_cell() -> None:
    few, many = 500, 10_000
    # Kernels are loaded.
    seconds_for_each(few)
    assert seconds_for_each(many) < 4 * min(seconds_for_each(few) for _ in range(5))


def seconds_for_each(size: int) -> float:
    """Return what it takes, for each, to filter points that come to as many in one cell."""
    rng = np.random.default_rng(size)
    filtered = FilteredPoints(Median(0.8, max_nb=6, min_nb=2))
    for _ in range(2):
        points = points_of(rng.uniform(0, CELL, (size, 3)) * (1, 1, 0.1))
        begin = time.process_time()
        filtered.add(pipeline(), points)
    return (time.process_time() - begin) / size


def pipeline() -> Pipeline:
    return Pipeline(loads(f"map: {{cell_size: {CELL}}}\npipeline: []"), "map", Report())
