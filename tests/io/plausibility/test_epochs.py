"""Clocks that begin anew, held against the order of recording.

How these tests could be cheated: by an epoch wherever a stamp goes back, by the time of recording
alone or the stamp alone, or by the greatest stamp so far, which one wrong stamp spoils. So two
publishers whose clocks differ, stray stamps on both sides and messages under way are among them.
"""

from __future__ import annotations

import math
from collections.abc import Hashable

import numpy as np
import pytest

from mlscli.io.plausibility.epochs import Elapsed, Epochs
from mlscli.runtime.arrays import Float64

STEADY: Float64 = np.asarray(100 + 0.1 * np.arange(100))
TWICE: Float64 = np.tile(STEADY, 2)
LOGGED: Float64 = np.asarray(1000 + 0.1 * np.arange(200))


def epochs_of(stamps: Float64) -> Epochs:
    return Epochs.of({"tf": (np.asarray(1000 + 0.1 * np.arange(len(stamps))), stamps)})


@pytest.mark.parametrize("times", [1, 2, 4])
def test_each_reset_of_a_clock_begins_an_epoch(times: int) -> None:
    stamps = np.tile(STEADY, times + 1)
    epochs = epochs_of(stamps)

    assert len(epochs.begins) == times
    assert [(first, stop) for first, stop, *_ in epochs.runs["tf"]] == [
        (100 * k, 100 * k + 100) for k in range(times + 1)
    ]
    assert [epochs.at(105.0, 1005.0 + 10 * k) for k in range(times + 1)] == list(range(times + 1))


def strayed(at: int, stamp: float) -> Float64:
    stamps = STEADY.copy()
    stamps[at] = stamp
    return stamps


@pytest.mark.parametrize(
    "stamps",
    [
        STEADY,
        STEADY[::-1][:5],
        strayed(50, 0.0),
        strayed(50, 4e9),
        strayed(0, 0.0),
        # Two publishers, one of which is ahead, by turns.
        np.asarray(STEADY + np.tile([0.0, 37.0], 50)),
        np.asarray(STEADY + np.tile([0.0, 0.0, 2.5], 34)[:100]),
        np.asarray(STEADY + np.random.default_rng(1).uniform(-0.4, 0.4, 100)),
    ],
)
def test_stamps_out_of_order_are_no_epochs(stamps: Float64) -> None:
    assert not epochs_of(stamps).begins


@pytest.mark.parametrize("stray", [0.0, 4e9])
def test_stray_stamps_hide_no_reset(stray: float) -> None:
    epochs = epochs_of(np.concatenate([strayed(40, stray), strayed(60, stray)]))

    (begin,) = epochs.begins
    assert begin.logged == pytest.approx(1010)
    assert (begin.before, begin.after) == pytest.approx((109.9, 100))


def test_a_message_under_way_at_the_reset_is_of_the_clock_that_is_nearer() -> None:
    epochs = epochs_of(TWICE)

    assert epochs.at(109.9, 1010.3) == 0
    assert epochs.at(100.0, 1010.3) == 1
    assert epochs.at(109.9, 1009.9) == 0
    assert epochs.at(100.1, 1009.9) == 1
    assert epochs.at(109.9, 1015.0) == 1


def test_what_is_told_only_before_a_reset_or_only_after_it_is_of_that_epoch_alone() -> None:
    streams: dict[Hashable, tuple[Float64, Float64]] = {
        "whole": (LOGGED, TWICE),
        "early": (LOGGED[:50], STEADY[:50]),
        "late": (LOGGED[150:], STEADY[50:]),
        # It was silent until the clock was there again.
        "silent": (np.delete(LOGGED, range(50, 160)), np.delete(TWICE, range(50, 160))),
        # Its clock is another, and goes on.
        "steady": (LOGGED, np.asarray(5000 + LOGGED)),
    }
    epochs = Epochs.of(streams)

    assert {key: [tuple(run[2:]) for run in runs] for key, runs in epochs.runs.items()} == {
        "whole": [(0, 0), (1, 1)],
        "early": [(0, 0)],
        "late": [(1, 1)],
        "silent": [(0, 0), (1, 1)],
        "steady": [(0, 1)],
    }


def test_streams_that_are_reset_together_begin_one_epoch() -> None:
    streams: dict[Hashable, tuple[Float64, Float64]] = {
        "fast": (LOGGED, TWICE),
        "slow": (LOGGED[5::20], TWICE[5::20]),
        "delayed": (np.asarray(LOGGED + 0.3), TWICE),
    }
    epochs = Epochs.of(streams)

    assert len(epochs.begins) == 1
    assert all(len(runs) == 2 for runs in epochs.runs.values())


# Seconds since the beginning


def zeros(stamps: list[float], logged: list[float]) -> tuple[list[float], int]:
    """Return how long each stamp is after the beginning, and how often the clock jumps."""
    elapsed, found = Elapsed(), list[float]()
    for stamp, time in zip(stamps, logged, strict=True):
        elapsed.come(stamp, time)
        found.append(stamp - elapsed.zero)
    return found, len(elapsed.jumps)


@pytest.mark.parametrize(
    ("stamps", "logged", "expected", "jumps"),
    [
        # A clock that is set, ahead and back; a simulation that is reset.
        ([5, 6, 1.7e9, 1.7e9 + 1], [90, 91, 92, 93], [0, 1, 2, 3], 1),
        ([500, 501, 100, 101], [90, 91, 92, 93], [0, 1, 2, 3], 1),
        ([5, 6, 5, 6, 5], [90, 91, 92, 93, 94], [0, 1, 0, 1, 0], 0),
        ([0, 10, 0, 10], [90, 100, 102, 112], [0, 10, 12, 22], 1),
        # A simulation at a tenth and at twenty times the pace, that stops in between.
        ([5, 6, 7, 8], [0, 10, 20, 500], [0, 1, 2, 3], 0),
        ([5, 25, 45, 200], [0, 1, 2, 10], [0, 20, 40, 195], 0),
        # A recording with a pause; one that was converted at once, with a pause.
        ([5, 6, 3600], [90, 91, 3685], [0, 1, 3595], 0),
        ([5, 6, 7, 300], [0.001, 0.002, 0.003, 0.004], [0, 1, 2, 295], 0),
        # Sources in turn, the later first; files, whose recording has no times.
        ([500, 501, 5, 6], [500, 501, 5, 6], [0, 1, -495, -494], 0),
        ([500, 5, 9e9], [math.nan] * 3, [0, -495, 9e9 - 500], 0),
    ],
)
def test_seconds_run_on_where_the_clock_jumps(
    stamps: list[float], logged: list[float], expected: list[float], jumps: int
) -> None:
    assert zeros(stamps, logged) == (expected, jumps)
