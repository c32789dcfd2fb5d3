"""Coordinates that a wrong byte has made: numbers of another order of magnitude than all others.

The top byte of a floating-point number is most of its exponent. Changed, it moves the point out of
the scene, or so near to zero as nothing is measured, and this in one coordinate alone. Outliers of
a scene lie along a ray, so that mostly all three are large; and where many are, this is how the
points are.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mlscli.runtime.arrays import Array, Bool, Float64
from mlscli.runtime.kernels import inner, kernel

_FAR = 1000
"""How many times the extent of the others a coordinate lies away from them."""

_TINY = 1.2e-19
"""What is no zero, but nearer to it than rounding leaves numbers: 1 / 2^63 of a unit."""

_SHARE, _LEAST = 1e-3, 3
"""More points than this share of them, and than so many, are no accident."""

_SAMPLE, _FEWEST = 4096, 8
"""The points that tell where most are, and how many of these must be measurements."""


def odd_exponents(columns: Sequence[Array]) -> Bool | None:
    """Return which coordinates cannot be; None where all can.

    Parameters
    ----------
    columns : sequence of three arrays (N,)
        x, y and z, of floating-point numbers; others have no exponents.

    Returns
    -------
    bool (N, 3) or None
        One in a row at most.
    """
    count = len(columns[0])
    if any(column.dtype.kind != "f" for column in columns):
        return None
    step = max(1, count // _SAMPLE)
    some = _points([column[::step] for column in columns])
    some = some[np.isfinite(some).all(axis=1) & some.any(axis=1)]
    if len(some) < _FEWEST:
        return None
    low, high = np.quantile(some, [0.1, 0.9], axis=0)
    reach = _FAR * (float((high - low).max()) or float(np.abs(high).max()))
    low, high, most = low - reach, high + reach, int(max(_LEAST, _SHARE * count))
    x, y, z = columns
    if not 0 < _count(x, y, z, low, high, most) <= most:
        return None
    points = _points(columns)
    sizes = np.abs(points)
    with np.errstate(invalid="ignore"):
        odd = (points > high) | (points < low) | ((sizes < _TINY) & (sizes > 0))
    odd[odd.sum(axis=1) > 1] = False
    return odd if odd.any() else None


def _points(columns: Sequence[Array]) -> Float64:
    # Signalling NaNs are no reason to warn.
    with np.errstate(invalid="ignore"):
        return np.stack([column.astype(np.float64) for column in columns], axis=1)


@kernel
def _count(x: Array, y: Array, z: Array, low: Float64, high: Float64, most: int) -> int:
    """Return how many points have a coordinate that cannot be.

    Parameters
    ----------
    x, y, z : float32 or float64 (N,)
    low, high : float64 (3,)
        The least and the greatest that each can be.
    most : int
        Where there are more, ``most + 1`` is returned.
    """
    count = 0
    for row in range(len(x)):
        if (
            _is_odd(x[row], low[0], high[0])
            or _is_odd(y[row], low[1], high[1])
            or _is_odd(z[row], low[2], high[2])
        ):
            count += 1
            if count > most:
                break
    return count


@inner
def _is_odd(value: float, low: float, high: float) -> bool:
    return value > high or value < low or 0 < abs(value) < _TINY
