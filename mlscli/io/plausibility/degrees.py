"""Whether coordinates are longitudes and latitudes, and no lengths."""

from __future__ import annotations

import numpy as np

from mlscli.io.plausibility.finding import Finding, doubted, right
from mlscli.runtime.arrays import Float64

_WIDEST = 0.05
"""A scene is no wider than this in degrees, some 5 km."""

_STEEPER = 100
"""In degrees it is so many times higher than wide, and so many times farther from 0."""

_FARTHEST = (180.0, 90.0)


def are_lengths(low: Float64, high: Float64) -> Finding[bool]:
    """Return that coordinates are lengths; doubted where x and y seem to be degrees.

    Parameters
    ----------
    low, high : float64 (3,)
        The bounds of all points.
    """
    # Coordinates may be as large as numbers are.
    with np.errstate(over="ignore"):
        wide, height = float((high - low)[:2].max()), float(high[2] - low[2])
    away = np.maximum(np.abs(low), np.abs(high))[:2]
    fits = any((away <= order).all() for order in (_FARTHEST, _FARTHEST[::-1]))
    if not fits or not 0 < wide < _WIDEST or min(height, float(away.max())) < _STEEPER * wide:
        return right(True)
    return doubted(
        True,
        f"x and y, about {low[0]:.4f} and {low[1]:.4f}, span {wide:.2g}, and z {height:.3g}, as "
        "longitude and latitude do; a map needs lengths, as of UTM",
    )
