"""Units of time stamps, and clocks that differ, told by when messages were recorded.

How these tests could be cheated: by the size of stamps alone, or by calling each delay a clock of
its own. So messages are under way, are recorded in bulk, or not together.
"""

from __future__ import annotations

import numpy as np
import pytest

from mlscli.io.plausibility.clocks import in_seconds, same_clock, same_rate
from mlscli.runtime.arrays import Float64

SECONDS: Float64 = 1_700_000_000 + np.arange(20) / 4


@pytest.mark.parametrize(
    ("unit", "per_second"), [("nanoseconds", 1e9), ("microseconds", 1e6), ("milliseconds", 1e3)]
)
def test_stamps_too_large_for_seconds_are_told_by_the_dates_they_make(
    unit: str, per_second: float
) -> None:
    found = in_seconds(np.append(SECONDS * per_second, np.nan))

    assert found.value is not None
    np.testing.assert_allclose(found.value[:-1], SECONDS, rtol=0, atol=1e-6)
    assert np.isnan(found.value[-1])
    assert found.note == f"the time stamps are taken as {unit}"


@pytest.mark.parametrize("stamps", [SECONDS, SECONDS - 1.7e9, np.full(3, np.nan), np.empty(0)])
def test_stamps_that_can_be_seconds_are(stamps: Float64) -> None:
    found = in_seconds(stamps)

    assert found.value is stamps
    assert found.note == ""


def recorded(delay: float, *, first: float = 0, count: int = 40, spread: float = 0.1) -> Float64:
    """Return stamps and times of recording, a second after one another, with a delay."""
    stamps = 1000 + first + np.arange(float(count))
    late = np.random.default_rng(3).uniform(0, spread, count)
    return np.column_stack((stamps, stamps + delay + late))


@pytest.mark.parametrize(
    ("clouds", "poses", "ahead"),
    [
        # A robot's clock that lags, one that is ahead, and uptime against the time of day.
        (recorded(0.1), recorded(253.8, first=-253.8), -253.7),
        (recorded(-20), recorded(0.1, first=-20), -20.1),
        (recorded(1.7e9), recorded(0.1, first=1.7e9), 1.7e9),
    ],
)
def test_stamps_of_two_clocks_are_told_by_their_delays(
    clouds: Float64, poses: Float64, ahead: float
) -> None:
    found = same_clock(clouds, poses)

    assert found.value == pytest.approx(ahead, abs=0.2)
    assert "s before their recording" in found.note or "s after their recording" in found.note


@pytest.mark.parametrize(
    ("clouds", "poses"),
    [
        (recorded(0.1), recorded(3)),  # as of a node that takes long
        (recorded(1000), recorded(1000.1)),
        (recorded(0.1), recorded(0.1, first=100)),
        (recorded(0.1), recorded(60, first=-40, spread=30)),
        (recorded(0.1), recorded(60, count=2, first=-40)),
        # Written in bulk afterwards, all at one time or one after another.
        (np.column_stack((recorded(0)[:, 0], np.full(40, 5e8))), recorded(0.1)),
        (
            np.column_stack((recorded(0)[:, 0], np.arange(40.0))),
            np.column_stack((recorded(0)[::-1, 0], np.arange(0.5, 40))),
        ),
        (np.full((9, 2), np.nan), recorded(5)),
        (np.empty((0, 2)), recorded(5)),
    ],
)
def test_delays_that_tell_no_clocks_apart_are_passed_over(clouds: Float64, poses: Float64) -> None:
    assert same_clock(clouds, poses).note == ""
    assert same_clock(poses, clouds).note == ""


@pytest.mark.parametrize(("delay", "told"), [(1.1, True), (-0.9, True), (0.3, False)])
def test_where_clouds_have_no_pose_at_their_time_less_tells_two_clocks(
    delay: float, told: bool
) -> None:
    clouds, poses = recorded(0.1 + delay), recorded(0.1)

    assert not same_clock(clouds, poses).note
    assert ("their recording" in same_clock(clouds, poses, unplaced=True).note) == told


def test_clouds_that_all_bear_one_stamp_are_told() -> None:
    clouds = recorded(0.1, count=10)
    clouds[:, 0] = 1003

    assert "all clouds bear one stamp, 1003.000 s" in same_clock(clouds, recorded(0.1)).note
    # Keyframes of one message, and clouds of which nothing moves with the time.
    assert same_clock(clouds[:1].repeat(5, axis=0), recorded(0.1)).note == ""
    assert same_clock(clouds, recorded(0.1, count=1)).note == ""


def drifting(rate: float, *, seconds: float = 600, hertz: float = 5, late: float = 0.1) -> Float64:
    """Return stamps of a clock that is so much faster than the one of the recording."""
    logged = np.arange(0, seconds, 1 / hertz)
    lag = np.random.default_rng(5).uniform(0, late, len(logged))
    return np.column_stack((1000 + logged * (1 + rate) - lag, 1000 + logged))


@pytest.mark.parametrize("rate", [0.01, -0.01, 0.003])
def test_a_clock_that_gains_on_that_of_the_poses_is_told(rate: float) -> None:
    clouds, poses = drifting(rate), drifting(0, hertz=20)
    found = same_rate(clouds[:16], clouds[-16:], poses)

    assert found.value == pytest.approx(600 * rate, abs=0.1)
    assert f"{'gain' if rate > 0 else 'lose'} {abs(600 * rate):.1f} s" in found.note


# Within 90 s, 0.9 s; a simulation that runs at a third of the time of recording, clouds and poses;
# messages recorded up to 8 s late; poses of the beginning alone; few clouds; no stamps.
@pytest.mark.parametrize(
    ("clouds", "poses"),
    [
        (drifting(0.01, seconds=90), drifting(0, seconds=90)),
        (drifting(-2 / 3), drifting(-2 / 3, hertz=20)),
        (drifting(0.01, late=8), drifting(0)),
        (drifting(0.01), drifting(0, seconds=300)),
        (drifting(0.01)[::2990], drifting(0)),
        (np.full((40, 2), np.nan), drifting(0)),
    ],
)
def test_clocks_of_which_none_surely_gains_are_passed_over(clouds: Float64, poses: Float64) -> None:
    assert same_rate(clouds[:16], clouds[-16:], poses).note == ""
