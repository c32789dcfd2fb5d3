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


def lost_step(points: Float64) -> float:
    """Return the step to which a horizontal coordinate of points (N, 3) was rounded; 0 if none."""
    some = points[:: len(points) // _MOST + 1, :2]
    some = some[np.isfinite(some).all(axis=1)]
    if len(some) < _FEWEST or np.abs(some).max() > 1e9:
        return 0.0
    step = 0.0
    for axis in (0, 1):
        own = some[:, axis]
        if (own != own.astype(np.float32)).any():
            continue
        finest = float(np.spacing(np.abs(own).min().astype(np.float32)))
        odd = float((own / finest % 2 == 1).mean())
        if _SHARE <= odd <= 1 - _SHARE and (some[:, 1 - axis] % finest).any():
            step = max(step, finest)
    return step
