"""Where the beams of a scan point.

How these tests could be cheated: by a word on each scan, so what drivers usually write must pass;
by turning the scan round or stretching it, so the increment counts always.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from mlscli.io.plausibility.angles import angles_of

STEP = math.radians(0.5)


@pytest.mark.parametrize("beyond", [-2, -1, 0, 1, 2])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_last_beam_near_its_bound_is_right(beyond: int, sign: int) -> None:
    step = float(np.float32(sign * STEP))

    found = angles_of(720, -sign * math.pi, -sign * math.pi + (719 + beyond) * step, step)

    assert not found.note
    assert found.value is not None
    assert found.value.tolist() == [-sign * math.pi + k * step for k in range(720)]


@pytest.mark.parametrize(
    ("count", "low", "high"), [(0, -3.0, 3.0), (1, -3.0, 3.0), (9, 0.0, 0.0), (9, 0.0, math.nan)]
)
def test_bounds_that_say_nothing_are_not_doubted(count: int, low: float, high: float) -> None:
    found = angles_of(count, low, high, STEP)

    assert not found.note
    assert found.value is not None
    assert found.value.tolist() == [low + k * STEP for k in range(count)]


@pytest.mark.parametrize(
    ("increment", "words"),
    [
        (-STEP, "angle_increment turns away from angle_max; the increment counts"),
        (0.99 * STEP, "do not lead from angle_min to angle_max; the increment counts"),
        (1.01 * STEP, "do not lead from angle_min to angle_max; the increment counts"),
    ],
)
def test_an_increment_that_contradicts_the_bounds_counts_and_is_told(
    increment: float, words: str
) -> None:
    found = angles_of(720, -math.pi, -math.pi + 719 * STEP, increment)

    assert words in found.note
    assert found.value is not None
    assert found.value.tolist() == [-math.pi + k * increment for k in range(720)]


@pytest.mark.parametrize("increment", [0.0, math.nan, math.inf])
def test_without_an_increment_beams_are_spread_between_the_bounds(increment: float) -> None:
    found = angles_of(7, -3.0, 3.0, increment)

    assert "the beams are spread from angle_min to angle_max" in found.note
    assert found.value is not None
    assert found.value.tolist() == [-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0]


@pytest.mark.parametrize(("low", "high"), [(0.0, 0.0), (0.0, math.nan), (-math.inf, 1.0)])
def test_beams_that_nothing_spreads_are_refused(low: float, high: float) -> None:
    found = angles_of(7, low, high, 0.0)

    assert found.refusal == "angle_increment is 0, and no bounds tell where beams point"
    # One beam needs no increment.
    assert angles_of(1, low, high, 0.0).value is not None


@pytest.mark.parametrize(("low", "step", "count"), [(-135.0, 0.5, 541), (360.0, -1.0, 361)])
def test_angles_that_can_only_be_degrees_are_read_as_such(
    low: float, step: float, count: int
) -> None:
    found = angles_of(count, low, low + (count - 1) * step, step)

    assert found.note == "its beams span more radians than two turns; they are taken as degrees"
    assert found.value is not None
    assert np.allclose(found.value, [math.radians(low + k * step) for k in range(count)])


def test_angles_that_are_neither_radians_nor_degrees_are_refused() -> None:
    found = angles_of(1081, -135_000.0, 135_000.0, 250.0)

    assert found.value is None
    assert found.refusal == "its beams span 270000 radians, expected a turn at most"
