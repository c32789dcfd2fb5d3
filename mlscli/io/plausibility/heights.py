"""Whether heights are heights, and not what rasters hold where they have none.

A raster that is written as points has a number for cells without a value, far from all heights:
-9999 mostly, or the least or the largest whole number of 16 bits.
"""

from __future__ import annotations

import numpy as np

from mlscli.io.plausibility.finding import Finding, doubted, right
from mlscli.runtime.arrays import Float64

_NO_VALUES = (-9999.0, -99999.0, -32768.0, -32767.0, 9999.0, 99999.0, 32767.0)
_FEWEST, _SHARE = 3, 0.001
"""So many points, and this share of them, are no accident."""

_FARTHER = 10
"""They are so many times farther from the others than these extend."""


def have_heights(points: Float64) -> Finding[bool]:
    """Return that z of points (N, 3) are heights; doubted where some seem to stand for none."""
    heights = points[:, 2]
    for value in _NO_VALUES:
        count = int(np.count_nonzero(heights == value))
        if count < max(_FEWEST, _SHARE * len(heights)) or count == len(heights):
            continue
        others = heights[heights != value]
        # Coordinates may be as large as numbers are.
        with np.errstate(over="ignore"):
            if np.abs(others - value).min() > _FARTHER * np.ptp(others):
                return doubted(
                    True,
                    f"z of {count / len(heights):.0%} of the points looked at is {value:g} "
                    "exactly, far from all others, as rasters have it where there is no value; "
                    "all are taken, `crop` leaves them out",
                )
    return right(True)
