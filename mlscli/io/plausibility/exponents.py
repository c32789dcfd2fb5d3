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
from mlscli.runtime.kernels import kernel

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
    x, y, z = _float64([column[::step] for column in columns])
    with np.errstate(invalid="ignore", over="ignore"):
        measured = np.isfinite(x + y + z) & ((x != 0) | (y != 0) | (z != 0))
    some = np.stack([axis[measured] for axis in (x, y, z)])
    few = some.shape[1] // 10
    if some.shape[1] < _FEWEST:
        return None
    parted = np.partition(some, [few, -1 - few], axis=1)
    low, high = parted[:, few], parted[:, -1 - few]
    reach = _FAR * (float((high - low).max()) or float(np.abs(high).max()))
    low, high, most = low - reach, high + reach, max(_LEAST, _SHARE * count)
    # At a glance first: mostly there are none.
    numbers = [
        _count(column, *_as(column, [least, greatest, _TINY]))
        for column, least, greatest in zip(columns, low, high, strict=True)
    ]
    if not 0 < max(numbers) <= most:
        return None
    points = np.stack(_float64(columns), axis=1)
    sizes = np.abs(points)
    with np.errstate(invalid="ignore"):
        odd = (points > high) | (points < low) | ((sizes < _TINY) & (sizes > 0))
    if odd.any(axis=1).sum() > most:
        return None
    odd[odd.sum(axis=1) > 1] = False
    return odd if odd.any() else None


def _float64(columns: Sequence[Array]) -> list[Float64]:
    # Signalling NaNs are no reason to warn.
    with np.errstate(invalid="ignore"):
        return [column.astype(np.float64) for column in columns]


def _as(column: Array, values: Sequence[float]) -> Array:
    """Return values in the type of a column; infinite where they exceed it."""
    with np.errstate(over="ignore"):
        return np.array(values).astype(column.dtype)


@kernel
def _count(values: Array, low: float, high: float, tiny: float) -> int:
    """Return how many numbers (N,) are beyond bounds, or nearer to 0 than `tiny` and not 0.

    Without branches, and in one type, eight are compared at a time.
    """
    count = 0
    for k in range(len(values)):
        value = values[k]
        size = abs(value)
        count += (value > high) | (value < low) | ((size < tiny) & (size > 0))
    return count
