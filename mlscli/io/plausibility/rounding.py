"""Coordinates that lost their digits: numbers far from 0 that were stored in float32 once.

Near 5,600,000, a northing of UTM, float32 has a number every half a metre; a file of double numbers
does not get them back. It is told by one horizontal axis alone lying on such steps, as a raster of
whole or half metres does so on both.
"""

from __future__ import annotations

import numpy as np

from mlscli.runtime.arrays import Float64

_FEWEST, _MOST = 32, 1024
"""How many points tell, and how many are looked at."""

_SHARE = 0.2
"""Of numbers that were rounded, at least so many are odd times the step, and so many even times."""

_GLANCE, _FEW = 32, 0.1
"""If of so many of the points fewer are odd times the step on both axes, no more are looked at."""

_MANTISSA = 23
"""The bits of float32 below its exponent."""


def lost_step(points: Float64) -> float:
    """Return the step to which a horizontal coordinate of points (N, 3) was rounded; 0 if none."""
    few = _some(points, _GLANCE)
    if max(_odd(few[0]), _odd(few[1])) < _FEW:
        return 0.0
    some = _some(points, _MOST)
    if some.shape[1] < _FEWEST or np.abs(some).max() > 1e9:
        return 0.0
    step = 0.0
    for own, other in (some, some[::-1]):
        if _SHARE <= _odd(own) <= 1 - _SHARE:
            finest = float(np.spacing(np.abs(own).min().astype(np.float32)))
            step = max(step, finest if (other % finest).any() else 0.0)
    return step


def _some(points: Float64, most: int) -> Float64:
    """Return x and y, (2, M), of some of the points, without those that are not finite."""
    some = np.ascontiguousarray(points[:: len(points) // most + 1, :2].T)
    finite = np.isfinite(some)
    return some if finite.all() else some[:, finite.all(axis=0)]


def _odd(numbers: Float64) -> float:
    """Return the share of numbers (N,) that are odd times the step that float32 has at the least.

    It is 0 where one of them is none that float32 has.
    """
    with np.errstate(over="ignore"):
        single = numbers.astype(np.float32)
    if not len(numbers) or (single != numbers).any():
        return 0.0
    bits = single.view(np.uint32)
    odd = (bits & 1).astype(np.bool_)
    if np.count_nonzero(odd) < _FEW * len(odd):
        return 0.0
    # Numbers with larger exponents are even times that step.
    exponents = bits >> _MANTISSA & 0xFF
    return np.count_nonzero(odd & (exponents == exponents.min())) / len(odd)
