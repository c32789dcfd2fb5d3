"""Poses of two bodies under one name, told from those of one.

How these tests could be cheated: by refusing whatever jumps. So there are bodies that jump, shake,
stand and go to and fro, which are one; and two at all rates, near each other and far.
"""

from __future__ import annotations

import numpy as np
import pytest

from mlscli.io.plausibility.publishers import alternate, of_one_body
from mlscli.runtime.arrays import Float64

RNG = np.random.default_rng(5)


def level(count: int) -> Float64:
    return np.tile([0.0, 0.0, 0.0, 1.0], (count, 1))


def walk(count: int, step: float, seed: int) -> Float64:
    heading = np.cumsum(np.random.default_rng(seed).normal(0, 0.1, count))
    return np.cumsum(np.column_stack((np.cos(heading), np.sin(heading), 0 * heading)), 0) * step


def told(stamps: Float64, positions: Float64, quaternions: Float64 | None = None) -> str:
    turns = level(len(stamps)) if quaternions is None else quaternions
    return of_one_body(stamps, positions, turns).refusal


@pytest.mark.parametrize("rates", [(10, 10), (10, 9.7), (50, 30), (50, 1), (100, 7)])
@pytest.mark.parametrize("apart", [0, 3, 20])
def test_two_that_move_on_each_for_itself_are_told_apart_at_any_rates(
    rates: tuple[float, float], apart: float
) -> None:
    one, other = np.arange(0, 60, 1 / rates[0]), np.arange(0.003, 60, 1 / rates[1])
    there = walk(len(other), 1 / rates[1], 2) + np.array([apart, apart, 0])
    positions = np.concatenate((walk(len(one), 1 / rates[0], 1), there))

    assert "told at two places by turns" in told(np.concatenate((one, other)), positions)


@pytest.mark.parametrize("count", [20, 1000, 50_000])
@pytest.mark.parametrize("kind", ["walks", "shakes", "stands", "errs", "jumps", "shuttles"])
def test_one_that_moves_in_whatever_way_is_one(kind: str, count: int) -> None:
    times = np.arange(float(count)) * 0.1
    path = walk(count, 0.1, 3)
    errors = RNG.normal(0, 30, (count, 3)) * (RNG.random((count, 1)) < 0.05)
    positions = {
        "walks": path,
        "shakes": path + RNG.normal(0, 0.3, (count, 3)),
        "stands": RNG.normal(0, 0.03, (count, 3)).round(2),
        "errs": path + errors,
        "jumps": np.repeat([[0.0, 0, 0], [5, 0, 0]], count // 2, axis=0),
        "shuttles": np.outer(np.sin(times), [3.0, 0, 0]),
    }[kind]

    assert told(times, positions) == ""


def test_one_that_stays_among_those_of_one_that_moves_is_another() -> None:
    times = np.arange(40.0) * 0.1
    positions = walk(40, 0.3, 4)
    positions[::2] = 0

    assert "told at two places by turns" in told(times, positions)


def test_two_that_stay_are_told_apart_by_their_turns_too() -> None:
    positions, turns = np.zeros((20, 3)), level(20)
    turns[::2] = (0, 0, 1, 0)

    assert "turned another way" in told(np.arange(20.0), positions, turns)
    # The same turn with the other sign, and one by turns for a long time each.
    assert told(np.arange(20.0), positions, level(20) * np.resize([1, -1], (20, 1))) == ""
    assert told(np.arange(20.0), positions, np.sort(turns, axis=0)) == ""


def test_the_order_is_that_of_the_stamps_and_of_equal_stamps_that_of_recording() -> None:
    times = np.repeat(np.arange(20.0), 2)
    positions = walk(40, 0.1, 1)
    positions[1::2, 2] += 10

    assert " 10 apart" in told(times, positions)
    # Recorded one after the other, with stamps of the same times.
    behind = np.concatenate((np.arange(0, 40, 2), np.arange(1, 40, 2)))
    assert " 10 apart" in told(times[behind] + 0.1 * (behind % 2), positions[behind])


@pytest.mark.parametrize("count", [0, 1, 2, 7])
def test_few_poses_tell_nothing(count: int) -> None:
    assert told(np.arange(float(count)), RNG.normal(0, 9, (count, 3))) == ""


@pytest.mark.parametrize(
    ("labels", "expected"),
    [
        ([0, 1] * 6, True),
        ([0, 0, 0, 1] * 4, True),
        ([0, 0, 0, 0, 0, 1] * 6, True),
        ([0, 0, 1, 1, 1] * 4, True),
        ([0] * 30 + [1] * 30, False),
        (([0] * 30 + [1] * 30) * 4, False),
        ([0, 1, 0], False),
        ([], False),
    ],
)
def test_turns_are_taken_where_labels_change_about_as_often_as_the_rarer_ones_come(
    labels: list[int], expected: bool
) -> None:
    assert alternate(np.array(labels, dtype=np.int64)) is expected
