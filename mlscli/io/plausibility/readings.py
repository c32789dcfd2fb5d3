"""Which of several ways to read the same bytes as coordinates is right.

Coordinates of a scene are of one order of magnitude, give or take a few: nearly all lie between
1e-4 and 1e8 in whatever unit. Bytes read in the wrong order, or as numbers of another kind, have
exponents from all over: those of a float32 lie in that range once in six, and round numbers become
tinier than 1e-40. So each number speaks for a reading or against it, and what a few numbers say
together is certain. Whole numbers have no exponents: there neighbours in the data are compared,
which lie near each other in a scene.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mlscli.runtime.arrays import Bool, Float64, Int64, UInt8

_RUN, _RUNS = 32, 8
"""What of a cloud is looked at: this many points that follow one another, at so many places."""

_GLANCE = 16
"""How many points are enough where all is as it should be."""

_ENOUGH = 6
"""So many numbers must say something for a glance to be enough."""

_LOW, _HIGH, _TINY = 1e-4, 1e8, 1e-20

# How likely a number is in a scene, as the logarithm of its share among numbers of its exponent:
# 90 % in 40 exponents, 8 % in the 53 below these, 2 % in all others.
_WITHIN, _BELOW, _BEYOND = np.log([0.9 / 40, 0.08 / 53, 0.02 / 163])

_CERTAIN = np.log(1e4)
"""Another reading than the stated one must be this much likelier."""

_SHARE = 0.6
"""The share of its numbers that lie in the usual range in a reading that is right."""

_EXPONENTS = range(-14, 27)
"""Those of numbers in the usual range."""

_USUAL = {
    size: bytes({sign | (bias + each) >> below for each in _EXPONENTS for sign in (0, 128)})
    for size, bias, below in ((4, 127, 1), (8, 1023, 4))
}
"""The top bytes of such numbers, by size: the lowest bits of the exponent are in the byte below."""

_ROUGHER = 4
"""Neighbours are this many times farther apart in a reading that is wrong."""


def sample(points: Float64) -> Int64:
    """Return the indices of those of points (N, 3) that are to be compared, ascending."""
    count = len(points)
    if count <= _RUN * _RUNS:
        return np.arange(count)
    starts = np.arange(_RUNS) * (count - _RUN) // (_RUNS - 1)
    some = (starts[:, None] + np.arange(_RUN)).ravel()
    if np.count_nonzero(_are_some(points[some])) < _RUN:
        # Most are no returns.
        others = np.flatnonzero(_are_some(points))
        some = others[: _RUN * _RUNS] if len(others) else some
    return some


def looks_right(data: UInt8, tops: Sequence[int], point_step: int, count: int, size: int) -> bool:
    """Return at a glance whether numbers are plausible as they were read; False: look closer.

    Parameters
    ----------
    data : uint8 (bytes,)
        Points that follow one another.
    tops : sequence of int
        Offset in the point of the top byte of each coordinate: its sign and most of its exponent.
    point_step : int
        Bytes from point to point.
    count : int
        Number of points.
    size : int
        Size of a coordinate in bytes: 4 or 8, a floating-point number.
    """
    end, step = count * point_step, point_step * max(1, count // _GLANCE)
    known = within = 0
    for at in tops:
        some = data[at:end:step].tobytes()
        # Zero, or tinier than what can be told here, says nothing.
        known += len(some) - some.count(0) - some.count(128)
        within += len(some) - len(some.translate(None, _USUAL[size]))
        if known >= _GLANCE:
            break
    return known >= _ENOUGH and within >= _SHARE * known


def likelier(stated: Float64, others: Sequence[Float64]) -> int | None:
    """Return which reading of the same numbers is right.

    Parameters
    ----------
    stated : float64 (N, 3)
        The numbers as the header says.
    others : sequence of float64 (N, 3)
        The same numbers in other ways.

    Returns
    -------
    int or None
        -1: as stated; else the index of one of the others, which is then certain. None: this
        cannot be told.
    """
    if not _are_some(stated).any() or all(
        np.array_equal(stated, each, equal_nan=True) for each in others
    ):
        return -1
    if np.isnan(stated).all():
        return -1
    stated_score, _ = _likelihood(stated)
    scored = [_likelihood(other) for other in others]
    best = max(range(len(others)), key=lambda place: scored[place][0])
    score, share = scored[best]
    if stated_score - score > _CERTAIN:
        return -1
    if score - stated_score > _CERTAIN:
        return best if share >= _SHARE else None
    return _by_neighbours(stated, others)


def _are_some(points: Float64) -> Bool:
    """Return which of points (N, 3) are not 0."""
    # Signalling NaNs, as of bytes in the wrong order, are no reason to warn.
    with np.errstate(invalid="ignore"):
        return np.asarray(points.any(axis=1))


def is_scene(points: Float64) -> bool:
    """Return whether numbers are plausible as the coordinates of points (N, 3)."""
    return _likelihood(points)[1] >= _SHARE


def _likelihood(points: Float64) -> tuple[float, float]:
    """Return how likely numbers are as coordinates, and the share of them in the usual range."""
    sizes = np.abs(points[np.isfinite(points)])
    sizes = sizes[sizes > 0]
    within = (sizes >= _LOW) & (sizes < _HIGH)
    below = (sizes >= _TINY) & (sizes < _LOW)
    scores = np.where(within, _WITHIN, np.where(below, _BELOW, _BEYOND))
    # What is not finite is no measurement, as many sensors report, and counts for no reading; but
    # not as an advantage over numbers, which it would have if it were left out of the sum.
    missing = int(np.count_nonzero(~np.isfinite(points)))
    share = float(within.mean()) if len(sizes) else float(missing > 0)
    return float(scores.sum() + missing * _BELOW), share


def _by_neighbours(stated: Float64, others: Sequence[Float64]) -> int | None:
    """Return in which reading whole numbers lie nearer to their neighbours; None where in none."""
    if len(stated) < 32 or not (stated == np.rint(stated)).all():
        return None
    apart = [_apart(stated), *map(_apart, others)]
    best = min(range(len(apart)), key=apart.__getitem__)
    rest = min(value for place, value in enumerate(apart) if place != best)
    return best - 1 if _ROUGHER * apart[best] < rest < np.inf else None


def _apart(points: Float64) -> float:
    """Return how far one point is from the next, in the median."""
    steps = np.abs(np.diff(points, axis=0)).max(axis=1)
    steps = steps[steps > 0]
    return float(np.median(steps)) if len(steps) >= 16 else float("inf")
