"""The set of points seen before.

How these tests could be cheated: by a set that is exact for few points only, or by comparing
coordinates to rounding. So it is held against Python's own set, grown, and asked for neighbours.
"""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from mlscli.io.reading.seen import SeenPoints


@settings(deadline=None)  # Kernels compile, machines are busy.
@given(st.lists(st.lists(st.tuples(*[st.integers(-2, 2)] * 3), max_size=700), max_size=6))
def test_seen_points_are_an_exact_set(clouds: list[list[tuple[int, int, int]]]) -> None:
    seen, known = SeenPoints(), set()
    for cloud in clouds:
        fresh = []
        for point in cloud:
            fresh.append(point not in known)
            known.add(point)
        points = np.array(cloud, dtype=np.float64).reshape(-1, 3)
        assert seen.add(points).tolist() == fresh


def test_seen_points_differ_by_their_last_bit_and_grow_past_any_size() -> None:
    seen = SeenPoints()
    points = np.random.default_rng(1).normal(size=(50_000, 3))
    for part in np.array_split(points, 7):
        assert seen.add(part).all()
    assert not seen.add(points).any()
    for axis in range(3):
        near = points.copy()
        near[:, axis] = np.nextafter(near[:, axis], 9.0)
        assert seen.add(near).all()
