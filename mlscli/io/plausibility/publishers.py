"""Whether poses that are said to be of one body are: what their order tells of who published them.

Two robots whose frames have the same names, or a transform that a second node goes on to publish,
leave poses at two places by turns; interpolated between, they put clouds anywhere. One body that
moves does not look like that: the way it went gets not much shorter when its poses are dealt out to
two.
"""

from __future__ import annotations

import math

import numpy as np

from mlscli.io.plausibility.finding import Finding, refused, right
from mlscli.runtime.arrays import Bool, Float64, Int64

_RETURNS, _LAGS = 5, 5
"""Poses near one of so many before, and not near the last, are returns; fewer tell nothing."""

_NEARER = 4.0
"""They are so many times nearer; and the way of one is so many times that of two."""

_LEAST = 0.05
"""Places nearer to one another than this, in the unit of the recording, are one."""

_FEWEST = 4
"""Each of two has as many poses at least."""

_RUN, _RUNS = 2000, 10
"""What of many poses is looked at: as many that follow one another, at as many places."""


def alternate(labels: Int64) -> bool:
    """Return whether labels (N,), not negative, take turns, rather than follow one another.

    They change at least half as often as others than the commonest come.
    """
    changes = int(np.count_nonzero(np.diff(labels)))
    others = len(labels) - int(np.bincount(labels).max(initial=0))
    return changes > _FEWEST and 2 * changes >= others


def of_one_body(stamps: Float64, positions: Float64, quaternions: Float64) -> Finding[bool]:
    """Return that poses of one frame in another are those of one body; refused if they are of two.

    Parameters
    ----------
    stamps : float64 (N,)
        Seconds, in the order of recording.
    positions : float64 (N, 3)
        In the unit of the recording.
    quaternions : float64 (N, 4)
        Of length 1.

    Returns
    -------
    Finding of bool
        True; refused where the poses are by turns those of two bodies that move on, each for
        itself, or of two that stay as they are.
    """
    order = np.argsort(stamps, kind="stable")
    positions, quaternions = positions[order], quaternions[order]
    labels = _constants(positions, quaternions)
    if labels is None:
        positions = positions[_some(len(positions))]
        returns = _returns(positions)
        if len(returns) >= _RETURNS:
            positions = positions[returns[0] - 1 : returns[-1] + 1]
            labels = _dealt(positions)
    if labels is None or not alternate(labels):
        return right(True)
    jumps = np.flatnonzero(np.diff(labels))
    apart = float(np.median(np.linalg.norm(positions[jumps + 1] - positions[jumps], axis=1)))
    how = f"{apart:.3g} apart" if apart >= _LEAST else "turned another way"
    return refused(
        f"told at two places by turns, {how}, as by two robots with frames of the same names or by "
        "two nodes"
    )


def _some(count: int) -> Int64:
    """Return the rows that are looked at: all, or runs of them spread over the whole."""
    if count <= _RUN * _RUNS:
        return np.arange(count)
    starts = np.arange(_RUNS) * (count - _RUN) // (_RUNS - 1)
    return np.asarray((starts[:, None] + np.arange(_RUN)).ravel())


def _constants(positions: Float64, quaternions: Float64) -> Int64 | None:
    """Return which of two poses each is; None unless they are two, of which neither ever moves."""

    def equal(row: int) -> Bool:
        same = (positions == positions[row]) & (quaternions[:, :3] == quaternions[row, :3])
        return np.asarray(same.all(axis=1))

    if len(positions) < 2 * _FEWEST:
        return None
    first = equal(0)
    other = int(np.argmin(first))
    second = equal(other)
    if not (first | second).all() or min(first.sum(), second.sum()) < _FEWEST:
        return None
    cosine = min(abs(float(quaternions[0] @ quaternions[other])), 1.0)
    apart = max(float(np.linalg.norm(positions[0] - positions[other])), 2 * np.arccos(cosine))
    return second.astype(np.int64) if apart >= _LEAST else None


def _returns(positions: Float64) -> Int64:
    """Return the rows of poses that are far from the last one, but near one of those before it."""
    if len(positions) <= _LAGS:
        return np.empty(0, dtype=np.int64)
    steps = [
        np.linalg.norm(positions[_LAGS:] - positions[_LAGS - lag : len(positions) - lag], axis=1)
        for lag in range(1, _LAGS + 1)
    ]
    back = steps[0] > np.maximum(_NEARER * np.min(steps[1:], axis=0), _LEAST)
    return np.flatnonzero(back) + _LAGS


def _dealt(positions: Float64) -> Int64 | None:
    """Return which of two bodies each pose is of; None where one goes as well for all of them.

    The first two poses are one of each; each other goes to the body that was nearest before.
    """
    last = positions[:2].tolist()
    labels, ways = [], [0.0, 0.0]
    for place in positions.tolist():
        near = [math.dist(place, at) for at in last]
        body = int(near[1] < near[0])
        labels.append(body)
        ways[body] += near[body]
        last[body] = place
    way = float(np.linalg.norm(np.diff(positions, axis=0), axis=1).sum())
    dealt = np.array(labels)
    enough = min(np.bincount(dealt, minlength=2)) >= _FEWEST
    return dealt if enough and way > _NEARER * sum(ways) else None
