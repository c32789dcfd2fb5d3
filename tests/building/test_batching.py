"""Keyframes gathered into batches.

How one could cheat: to lose the keyframes that wait, or to hand points out twice; so all that goes
in is held against all that comes out, for sizes of batches and keyframes drawn at random.
"""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from mlscli.building.batching import BEYOND_GRID, BatchGatherer
from mlscli.keyframes.batches import gather
from mlscli.keyframes.keyframe import Keyframe
from mlscli.pipeline.report import Report


@given(st.lists(st.integers(0, 9), max_size=12), st.integers(1, 20), st.integers(1, 4))
def test_all_points_and_keyframes_come_out_once_and_in_order(
    sizes: list[int], least: int, every: int
) -> None:
    rng = np.random.default_rng(len(sizes))
    keyframes = [
        Keyframe(rng.uniform(-5, 5, (size, 3)), float(number), (0.0, 0.0, float(number)))
        for number, size in enumerate(sizes)
    ]
    report = Report()
    gatherer = BatchGatherer(least, 0.5, report)
    parts, routes, waiting = [], [], 0
    for number, keyframe in enumerate(keyframes):
        waiting += len(keyframe.points)
        is_enough = gatherer.add(keyframe)
        assert is_enough == (waiting >= least)
        if is_enough:
            assert gatherer.close() == waiting
            waiting = 0
        if number % every == 0 and gatherer.has_points:
            parts.append(gatherer.take_points())
            routes.append(gatherer.take_route())
    if gatherer.has_waiting:
        gatherer.close()
    parts.append(gatherer.take_points())
    routes.append(gatherer.take_route())
    assert not gatherer.has_waiting
    assert not gatherer.has_points
    expected = gather(keyframes)
    np.testing.assert_array_equal(np.concatenate([part.xyz for part in parts]), expected.points.xyz)
    numbers = np.concatenate([part.keyframe for part in parts])
    np.testing.assert_array_equal(numbers, expected.points.keyframe)
    np.testing.assert_array_equal(np.concatenate(routes), expected.route)
    np.testing.assert_array_equal(gatherer.route, expected.route)
    assert gatherer.keyframes == len(keyframes)
    assert report.points_read == sum(sizes)


def test_points_beyond_the_grid_are_dropped_and_counted() -> None:
    report = Report()
    gatherer = BatchGatherer(1, 1e-3, report)
    gatherer.add(Keyframe(np.array([[1e7, 0.0, 0.0], [1.0, 1.0, 1.0]])))
    assert gatherer.close() == 1
    assert gatherer.take_points().xyz.tolist() == [[1.0, 1.0, 1.0]]
    assert report.dropped == {BEYOND_GRID: 1}
