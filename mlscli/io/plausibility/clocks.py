"""What time stamps are times of: their unit, and whether two kinds of messages go by one clock."""

from __future__ import annotations

import numpy as np

from mlscli.io.plausibility.finding import Finding, doubted, right
from mlscli.runtime.arrays import Float64

SECONDS_BELOW = 1e11
"""Time stamps from here on, 3,000 years, are no seconds; in nanoseconds it is 100 s."""

_UNITS = (("nanoseconds", 1e9), ("microseconds", 1e6), ("milliseconds", 1e3))
_LEAST_PERIOD = 1e-4
"""Messages come less often than every so many seconds."""

_THESE_YEARS = (1.2e9, 4e9)
"""The years 2008 to 2096, in seconds since 1970."""

_APART, _APART_WITHOUT_POSES = 5.0, 0.5
"""Stamps whose delays differ by less (s) are of one clock; messages are under way as long. Where
some clouds have no pose at their time, less tells."""

_STEADY, _SHARE = 1.0, 0.8
"""A delay is steady where it is so near the median (s) for so many of the messages."""

_FEWEST, _SHORTEST = 3, 1.0
"""So many messages at least, recorded over so many seconds, tell a delay."""


_TOLD, _NEAR = 16, 5.0
"""So many messages tell how far their stamps are ahead at a time, if they are so near to it (s)."""

_LONG, _DRIFT = 10.0, 1.0
"""What clocks gain on each other in so long (s) at least is told from so much (s) on."""


def in_seconds(stamps: Float64) -> Finding[Float64]:
    """Return time stamps in seconds.

    Parameters
    ----------
    stamps : float64 (N,)
        In any unit; NaN where not known.

    Returns
    -------
    Finding of float64 (N,)
        Doubted where they are too large for seconds: then they are in the smallest unit, down from
        nanoseconds, in which they make dates of our time, or else fewer than 10 kHz.
    """
    known = stamps[np.isfinite(stamps)]
    if not len(known) or np.abs(known).max() < SECONDS_BELOW:
        return right(stamps)
    steps = np.diff(np.unique(known))
    period = float(np.median(steps)) if len(steps) else np.inf
    fitting = [each for each in _UNITS if period / each[1] >= _LEAST_PERIOD] or [*_UNITS]
    low, high = _THESE_YEARS
    dated = [each for each in fitting if low <= known.min() / each[1] <= high]
    name, per_second = (dated or fitting)[0]
    return doubted(stamps / per_second, f"the time stamps are taken as {name}")


def same_clock(clouds: Float64, poses: Float64, *, unplaced: bool = False) -> Finding[float]:
    """Return how far the stamps of poses are ahead of those of clouds, by when both were recorded.

    Parameters
    ----------
    clouds, poses : float64 (N, 2), (M, 2)
        Stamps and times of recording, in seconds.
    unplaced : bool
        Whether there is no pose at the time of some clouds.

    Returns
    -------
    Finding of float
        In seconds; doubted where each kind keeps its delay, and these differ by more than messages
        are under way. 0 where they were not recorded together, or nothing is steady.
    """
    clouds, poses = _known(clouds), _known(poses)
    if len(clouds) >= _FEWEST and len(poses) and np.ptp(poses[:, 0]) >= _SHORTEST:
        lasted = clouds[-1, 1] - clouds[0, 1]
        if lasted >= _SHORTEST and not np.ptp(clouds[:, 0]):
            return doubted(
                0.0,
                f"all clouds bear one stamp, {clouds[0, 0]:.3f} s, though they were recorded over "
                f"{lasted:.1f} s",
            )
    delays = _delay(clouds), _delay(poses)
    if np.isnan(delays).any():
        return right(0.0)
    if max(clouds[0, 1], poses[0, 1]) >= min(clouds[-1, 1], poses[-1, 1]):
        return right(0.0)
    ahead = delays[0] - delays[1]
    if abs(ahead) <= (_APART_WITHOUT_POSES if unplaced else _APART):
        return right(ahead)
    return doubted(
        ahead,
        f"the stamps of the clouds are {_delayed(delays[0])} their recording, those of the poses "
        f"that move them {_delayed(delays[1])} it",
    )


def same_rate(first: Float64, last: Float64, poses: Float64) -> Finding[float]:
    """Return how far the stamps of clouds ran ahead of those of poses, by when both were recorded.

    Parameters
    ----------
    first, last, poses : float64 (N, 2), (M, 2), (K, 2)
        Stamps and times of recording, in seconds: of clouds at the beginning and at the end, and
        of all poses.

    Returns
    -------
    Finding of float
        In seconds, from the beginning to the end; doubted where it is more than the time of
        recording is uncertain by. 0 where too little was recorded, or nothing is steady.
    """
    poses = _known(poses)
    ahead, between = [], []
    for some in (_known(first)[:_TOLD], _known(last)[-_TOLD:]):
        if len(some) < _FEWEST or len(poses) < _TOLD:
            return right(0.0)
        middle = float(np.median(some[:, 1]))
        begin = int(np.searchsorted(poses[:, 1], middle)) - _TOLD // 2
        near = poses[max(0, min(begin, len(poses) - _TOLD)) :][:_TOLD]
        if not near[0, 1] - _NEAR <= middle <= near[-1, 1] + _NEAR:
            return right(0.0)
        ways = [each[:, 0] - each[:, 1] for each in (some, near)]
        ahead.append(float(np.median(ways[0]) - np.median(ways[1])))
        between.append((middle, max(float(np.ptp(way)) for way in ways)))
    (begun, _), (ended, _) = between
    gained = ahead[1] - ahead[0]
    unsteady = max(spread for _, spread in between)
    if ended - begun < _LONG or abs(gained) <= max(_DRIFT, unsteady):
        return right(gained)
    return doubted(
        gained,
        f"the stamps of the clouds {'gain' if gained > 0 else 'lose'} {abs(gained):.1f} s on those "
        f"of the poses that move them, within {ended - begun:.0f} s of recording",
    )


def _known(times: Float64) -> Float64:
    times = times[np.isfinite(times).all(axis=1)]
    return times[np.argsort(times[:, 1], kind="stable")]


def _delay(times: Float64) -> float:
    """Return how long after their stamps messages are recorded; NaN where that is not steady."""
    if len(times) < _FEWEST or not times[-1, 1] - times[0, 1] >= _SHORTEST:
        return float("nan")
    delays = times[:, 1] - times[:, 0]
    median = float(np.median(delays))
    return median if (np.abs(delays - median) <= _STEADY).mean() >= _SHARE else float("nan")


def _delayed(delay: float) -> str:
    return f"{abs(delay):.1f} s {'before' if delay >= 0 else 'after'}"
