"""Which ranges of a scan are measurements.

How these tests could be cheated: by dropping all that is at the bound, or whatever comes twice. So
walls stand as far as the bound, ranges are rounded as scanners round them, and what drivers write
for nothing hit is what they are known to write.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from mlscli.io.plausibility.finding import Finding
from mlscli.io.plausibility.ranges import NOTHING_HIT, OUT_OF_RANGE, Measured, measured
from mlscli.runtime.arrays import Bool, Float64

ANGLES = np.linspace(-1.0, 1.0, 721)


def wall(distance: float, step: float = 0.001) -> Float64:
    """Return the ranges of a straight wall across, as a scanner with such steps tells them."""
    return np.round(distance / np.cos(ANGLES) / step) * step


def beams(found: Finding[Measured]) -> Bool:
    return np.asarray(~np.isnan(found.accepted(ValueError).ranges))


def unmeasured(found: Finding[Measured]) -> dict[str, int]:
    return dict(found.accepted(ValueError).unmeasured)


@pytest.mark.parametrize("distance", [1.0, 16.0, 29.6, 29.999])
@pytest.mark.parametrize("step", [0.001, 0.01])
def test_walls_are_walls_as_far_as_the_bound(distance: float, step: float) -> None:
    ranges = wall(distance, step)
    found = measured(ranges, 0.1, 30.0)

    np.testing.assert_array_equal(beams(found), ranges <= 30)
    assert not found.note


@pytest.mark.parametrize("value", [30.0, 29.96, 29.99])
def test_beams_that_pile_up_at_the_bound_hit_nothing(value: float) -> None:
    ranges = wall(5.0)
    ranges[100:140] = value
    found = measured(ranges, 0.1, 30.0)

    np.testing.assert_array_equal(np.flatnonzero(~beams(found)), np.arange(100, 140))
    assert unmeasured(found) == {NOTHING_HIT: 40}
    assert "hit nothing" in found.note


def test_what_is_farther_than_nothing_hit_hits_nothing_either() -> None:
    ranges = np.full(400, 29.96)
    ranges[:300], ranges[7] = 4.0, 29.99
    found = measured(ranges, 0.1, 30.0)

    assert unmeasured(found) == {NOTHING_HIT: 101}


def test_of_two_piles_the_nearer_one_bounds_what_is_hit_and_infinite_ranges_are_none() -> None:
    ranges = np.full(400, math.inf)
    ranges[:200], ranges[200:220], ranges[220:240], ranges[240:242] = 4.0, 29.6, 29.9, 29.5
    found = measured(ranges, 0.1, 30.0)

    assert np.flatnonzero(beams(found)).tolist() == [*range(200), 240, 241]
    assert unmeasured(found) == {NOTHING_HIT: 40}


def test_a_few_beams_at_the_bound_and_many_elsewhere_are_walls() -> None:
    ranges = np.full(400, 4.0)
    ranges[:12] = 30.0
    found = measured(ranges, 0.1, 30.0)

    assert beams(found).all()
    assert not found.note
    # Nor are a few beams many, whatever their share.
    assert not measured(np.array([30.0, 2.0, 30.0]), 0.1, 30.0).note


def test_ranges_out_of_bounds_are_counted_and_what_is_not_finite_is_not_among_them() -> None:
    ranges = np.array([2.0, 0.05, 31.0, 0.0, -1.0, math.inf, -math.inf, math.nan, 30.0])
    found = measured(ranges, 0.1, 30.0)

    assert beams(found).tolist() == [True, *[False] * 7, True]
    assert unmeasured(found) == {OUT_OF_RANGE: 4}


@pytest.mark.parametrize(
    ("low", "high"), [(0.0, 0.0), (math.nan, math.nan), (0.1, 0.0), (5.0, 1.0), (-1.0, -1.0)]
)
def test_bounds_that_are_not_set_bound_nothing(low: float, high: float) -> None:
    found = measured(np.array([2.0, 0.0, -1.0, 80.0, math.inf]), low, high)

    assert beams(found).tolist() == [True, False, False, True, False]
    assert "range_max is not set" in found.note


@pytest.mark.parametrize("low", [0.0, -1.0, math.nan])
def test_a_lower_bound_that_is_not_set_leaves_the_upper_one(low: float) -> None:
    found = measured(np.array([2.0, 0.0, 80.0]), low, 30.0)

    assert beams(found).tolist() == [True, False, False]
    assert not found.note


def test_an_upper_bound_may_be_infinite() -> None:
    found = measured(np.array([2.0, math.inf, 80.0, 80.0, 80.0]), 0.1, math.inf)

    assert beams(found).tolist() == [True, False, True, True, True]
    assert not found.note


@pytest.mark.parametrize(
    ("low", "high", "scale", "words"),
    [
        (8.0, 40.0, 1.0, "are below range_min, 8, and dropped"),
        (0.1, 12.0, 1000.0, "are beyond range_max, 12, and dropped"),
    ],
)
def test_bounds_that_most_ranges_contradict_are_told(
    low: float, high: float, scale: float, words: str
) -> None:
    ranges = scale * wall(3.0)
    ranges[:50] = 9.0
    found = measured(ranges, low, high)

    assert words in found.note
    assert np.flatnonzero(beams(found)).tolist() == list(range(50))


@pytest.mark.parametrize("nothing", [0.0, 0.01, 65.533, math.inf])
def test_what_a_driver_writes_for_nothing_hit_contradicts_no_bound(nothing: float) -> None:
    ranges = wall(5.0)
    ranges[:600] = nothing

    assert not measured(ranges, 0.1, 30.0).note
