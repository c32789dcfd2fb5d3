"""Which ranges of a scan are measurements: what the scan states of its bounds, against its ranges.

Drivers report beams that hit nothing in many ways: infinite or NaN, as REP 117 lays down, but also
0, a range beyond the bound, or the bound itself or one value just below it for all of them. Walls
do not look like that: even one that the scanner looks at from the farthest distance has as many
ranges as it has beams, but for a few per cent.

References
----------
sensor_msgs/LaserScan: ranges outside of [range_min, range_max] should be discarded. REP 117,
Informational Distance Measurements.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mlscli.io.plausibility.finding import Finding, doubted, right
from mlscli.runtime.arrays import Bool, Float64

OUT_OF_RANGE, NOTHING_HIT = "out of range", "nothing hit"
"""Why a range is no measurement, though it is a number."""

_SHARE = 0.03
"""More than this share of the beams at one value as far as the bound are no measurements."""

_LEAST = 3
"""Nor are fewer beams than these, whatever their share, a reason to think so."""

_LARGEST = np.finfo(np.float64).max

_NEAR = 0.98
"""From this part of the bound on, ranges may stand for nothing hit."""


class Measured(NamedTuple):
    """Which beams of a scan have measured something.

    Attributes
    ----------
    beams : bool (N,)
    unmeasured : tuple of (str, int)
        Why other beams have not, and how many; those that are not finite are left out.
    """

    beams: Bool
    unmeasured: tuple[tuple[str, int], ...]


def measured(ranges: Float64, low: float, high: float) -> Finding[Measured]:
    """Return which ranges are measurements.

    Parameters
    ----------
    ranges : float64 (N,)
    low, high : float
        The bounds as the scan states them, inclusive; NaN where it states none.

    Returns
    -------
    Finding of Measured
        Never refused.
    """
    notes = []
    low = low if low > 0 else 0.0
    if not high > low:
        notes.append("range_max is not set; every range above 0 is taken")
        low, high = 0.0, np.inf
    beams = (ranges > 0) & (ranges <= min(high, _LARGEST))
    if low > 0:
        beams &= ranges >= low
    counts = {OUT_OF_RANGE: int(np.count_nonzero(np.isfinite(ranges) & ~beams))}
    far = ranges[beams & (ranges >= _NEAR * high)]
    if len(far) >= _LEAST:
        farthest, times = np.unique(far, return_counts=True)
        piled = farthest[(times >= _LEAST) & (times > _SHARE * len(ranges))]
        if len(piled):
            # Where nothing is hit, nothing is farther.
            counts[NOTHING_HIT] = int(np.count_nonzero(far >= piled[0]))
            beams &= ranges < piled[0]
            notes.append("beams that share one range, next to range_max, have hit nothing")
    found = Measured(beams, tuple((reason, count) for reason, count in counts.items() if count))
    return doubted(found, "; ".join(notes)) if notes else right(found)
