"""A sample that is drawn: bounded, from all over, and the same however the points come.

How one could cheat: by the beginning of the stream, by its end, by steps that are regular, or by a
sample of each part instead of one of the whole.
"""

from __future__ import annotations

import numpy as np
import pytest

from mlscli.geometry.samples import Reservoir
from mlscli.runtime.arrays import Float64


def numbered(count: int) -> Float64:
    return np.arange(3.0 * count).reshape(count, 3)


def drawn(size: int, *parts: Float64) -> Float64:
    reservoir = Reservoir(size)
    for part in parts:
        reservoir.add(part)
    return reservoir.points


@pytest.mark.parametrize("count", [0, 1, 99, 100])
def test_of_few_points_all_are_kept(count: int) -> None:
    points = numbered(count)
    assert drawn(100, *np.array_split(points, 7)).tobytes() == points.tobytes()


@pytest.mark.parametrize("parts", [2, 31, 5_000])
def test_the_sample_is_that_of_the_whole_stream_however_it_is_cut(parts: int) -> None:
    points = numbered(20_000)
    expected = drawn(100, points)
    assert drawn(100, *np.array_split(points, parts)).tobytes() == expected.tobytes()
    assert len(np.unique(expected, axis=0)) == 100
    assert np.isin(expected, points).all()


def test_each_point_is_as_likely_as_any_other() -> None:
    sample = drawn(5_000, numbered(1_000_000))[:, 0] / 3e6
    counts, _ = np.histogram(sample, 10, (0, 1))
    # 500 in each tenth, with a standard deviation of 21.
    assert np.abs(counts - 500).max() < 100


def test_a_sample_of_one_point_ends_with_no_warning() -> None:
    reservoir = Reservoir(1)
    for _ in range(50):
        reservoir.add(numbered(10_000))
    assert reservoir.points.shape == (1, 3)
