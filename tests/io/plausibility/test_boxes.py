"""Bounds that a header states, against the points.

How these tests could be cheated: by dropping whatever lies outside, or nothing. So both are there:
bounds that were never set or belong to other points, and points whose numbers are damaged.
"""

from __future__ import annotations

import numpy as np
import pytest

from mlscli.io.plausibility.boxes import within_bounds
from mlscli.runtime.arrays import Float64

POINTS: Float64 = np.random.default_rng(1).uniform(-20, 20, (1000, 3))
LOW, HIGH, SLACK = POINTS.min(axis=0), POINTS.max(axis=0), np.full(3, 0.002)


@pytest.mark.parametrize("chained", [False, True])
def test_points_within_their_bounds_are_right(chained: bool) -> None:
    for slack in (0.0, 0.0019):
        found = within_bounds(POINTS, LOW + slack, HIGH - slack, SLACK, chained=chained)
        assert found.value is not None
        assert found.value.all()
        assert not found.note


@pytest.mark.parametrize("bounds", [(0.0, 0.0), (1.0, -1.0), (np.nan, 1.0), (-np.inf, np.inf)])
def test_bounds_that_are_not_set_say_nothing(bounds: tuple[float, float]) -> None:
    found = within_bounds(POINTS, np.full(3, bounds[0]), np.full(3, bounds[1]), SLACK, chained=True)

    assert found.value is not None
    assert found.value.all()
    assert not found.note


def test_bounds_of_other_points_are_told_and_nothing_is_dropped() -> None:
    # Written when there were fewer; before a transformation.
    few, elsewhere = POINTS[:20], POINTS + 5e6
    for other, outside in ((few, None), (elsewhere, 1000)):
        for chained in (False, True):
            if chained and outside is None:
                continue
            low, high = other.min(axis=0), other.max(axis=0)
            found = within_bounds(POINTS, low, high, SLACK, chained=chained)
            assert found.value is not None
            assert found.value.all()
            assert "lie outside the bounds that its header states" in found.note
            assert outside is None or found.note.startswith("1,000 of 1,000")


@pytest.mark.parametrize("row", [0, 4095, 4096])
def test_a_point_beyond_any_face_is_seen_wherever_it_stands_and_on_the_face_is_within(
    row: int,
) -> None:
    points = np.zeros((4097, 3))
    low, high = np.array([-1.0, -2.0, -3.0]), np.array([1.0, 2.0, 3.0])
    for axis in range(3):
        for face, away in ((low, -np.inf), (high, np.inf)):
            points[row] = 0
            points[row, axis] = face[axis]
            assert not within_bounds(points, low, high, np.zeros(3)).note
            points[row, axis] = np.nextafter(face[axis], away)
            assert within_bounds(points, low, high, np.zeros(3)).note


@pytest.mark.parametrize("count", [1, 900])
def test_records_of_zeros_outside_the_bounds_are_no_points(count: int) -> None:
    # Beside the others, as offsets are chosen; however many were never written.
    zeros = HIGH + 1
    points = np.concatenate([POINTS, np.tile(zeros, (count, 1))])
    found = within_bounds(points, LOW, HIGH, SLACK, unwritten=zeros)

    assert found.value is not None
    assert np.flatnonzero(~found.value).tolist() == list(range(1000, 1000 + count))
    inside = within_bounds(points, LOW, zeros, SLACK, unwritten=zeros)
    assert inside.value is not None
    assert inside.value.all()


def test_a_few_points_far_outside_are_damaged() -> None:
    damaged = POINTS.copy()
    damaged[[3, 500], [0, 2]] = [2e6, -1000]
    found = within_bounds(damaged, LOW, HIGH, SLACK)

    assert found.value is not None
    assert np.flatnonzero(~found.value).tolist() == [3, 500]
    assert not found.note


def test_of_points_that_are_chained_any_outside_is_damaged() -> None:
    damaged = POINTS.copy()
    damaged[700:] *= 1.2
    outside = (np.abs(damaged) > np.maximum(-LOW, HIGH) + SLACK).any(axis=1)
    found = within_bounds(damaged, LOW, HIGH, SLACK, chained=True)

    assert found.value is not None
    assert not found.value[outside].any()
    assert found.value[:700].all()
    # All of them, where something else is known to be wrong.
    found = within_bounds(damaged + 99, LOW, HIGH, SLACK, chained=True, broken=True)
    assert found.value is not None
    assert not found.value.any()
