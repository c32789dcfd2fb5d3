"""The bounds that a header states of its points, against the points."""

from __future__ import annotations

import numpy as np

from mlscli.io.plausibility.finding import Finding, doubted, right
from mlscli.runtime.arrays import Bool, Float64
from mlscli.runtime.kernels import kernel
from mlscli.words import some, verb

_MOST, _MOST_CHAINED = 0.1, 0.99
"""Where more than this share of the points lies too far outside, the bounds are wrong, not the
points: of points that are stored one by one, and of those that are chained."""

_BLOCK = 4096
"""Points that are looked at before the answer may be known."""


def within_bounds(
    points: Float64,
    low: Float64,
    high: Float64,
    slack: Float64,
    *,
    chained: bool = False,
    broken: bool = False,
    unwritten: Float64 | None = None,
) -> Finding[Bool]:
    """Return which points can be what was measured, by the bounds of all of them.

    Parameters
    ----------
    points : float64 (N, 3)
    low, high : float64 (3,)
        The bounds as the header states them; all zero where they were never set.
    slack : float64 (3,)
        How far points may lie outside, as they are rounded.
    chained : bool
        Whether each point is stored as what differs from the one before, so that one wrong byte
        moves all that follow.
    broken : bool
        Whether something is known to be wrong with them; then the bounds are right.
    unwritten : float64 (3,), optional
        Where a record of zeros lies, if points are stored one by one.

    Returns
    -------
    Finding of bool (N,)
        False for points whose numbers are damaged: few that lie outside by more than the whole
        extent, or where a record of zeros does, or, if chained, any that lie outside. All True,
        with a note, where points lie outside otherwise: then the bounds are not theirs.
    """
    extent = high - low
    is_set = np.isfinite(extent).all() and (extent >= 0).all() and (low.any() or high.any())
    all_kept = np.ones(len(points), dtype=np.bool_)
    if not is_set or not len(points):
        return right(all_kept)
    if _all_within(points, low - slack, high + slack):
        return right(all_kept)
    inside = ((points >= low - slack) & (points <= high + slack)).all(axis=1)
    reach = slack if chained else slack + float(extent.max())
    near = ((points >= low - reach) & (points <= high + reach)).all(axis=1)
    written = all_kept
    if unwritten is not None:
        written = inside | (points != unwritten).any(axis=1)
    far = int((written & ~near).sum())
    most = 1 if broken else _MOST_CHAINED if chained else _MOST
    if (not far and written.all()) or far > most * len(points):
        outside = len(points) - int(inside.sum())
        return doubted(
            all_kept,
            f"{outside:,} of {some(len(points), 'point')} {verb(outside, 'lies', 'lie')} outside "
            "the bounds that its header states; all are taken",
        )
    return right(np.asarray(near & written))


def overflowed(points: Float64, scales: Float64, offsets: Float64) -> Bool:
    """Return which points have a coordinate that did not fit when it was written.

    Parameters
    ----------
    points : float64 (N, 3)
        Whole numbers of 32 bits, scaled and moved.
    scales, offsets : float64 (3,)

    Returns
    -------
    bool (N,)
        True where a coordinate is the least or the greatest number that 32 bits hold: writers
        without room for a coordinate store these.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        ends = [np.asarray(float(end) * scales + offsets) for end in (-(2**31), 2**31 - 1)]
    return np.asarray(((points == ends[0]) | (points == ends[1])).any(axis=1))


@kernel
def _all_within(points: Float64, low: Float64, high: Float64) -> bool:
    """Return whether all points (N, 3) lie within bounds (3,): a block at a time, without branches.

    A number that is none lies nowhere.
    """
    for begin in range(0, len(points), _BLOCK):
        inside = True
        for row in range(begin, min(begin + _BLOCK, len(points))):
            x, y, z = points[row, 0], points[row, 1], points[row, 2]
            inside &= (x >= low[0]) & (x <= high[0]) & (y >= low[1]) & (y <= high[1])
            inside &= (z >= low[2]) & (z <= high[2])
        if not inside:
            return False
    return True
