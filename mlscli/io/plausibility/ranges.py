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

import math
from typing import NamedTuple

import numpy as np

from mlscli.io.plausibility.finding import Finding
from mlscli.runtime.arrays import Float64

OUT_OF_RANGE, NOTHING_HIT = "out of range", "nothing hit"
"""Why a range is no measurement, though it is a number."""

_SHARE = 0.03
"""More than this share of the beams at one value as far as the bound are no measurements."""

_LEAST = 3
"""Nor are fewer beams than these, whatever their share, a reason to think so."""

_LARGEST = np.finfo(np.float64).max

_NEAR = 0.98
"""From this part of the bound on, ranges may stand for nothing hit."""

_FAR = 3.0
"""Most ranges beyond so many times the bound are no walls that go on beyond it."""


class Measured(NamedTuple):
    """What the beams of a scan have measured.

    Attributes
    ----------
    ranges : float64 (N,)
        NaN where nothing was measured.
    unmeasured : tuple of (str, int)
        Why other beams have not, and how many; those that are not finite are left out.
    """

    ranges: Float64
    unmeasured: tuple[tuple[str, int], ...]


def measured(ranges: Float64, low: float, high: float) -> Finding[Measured]:
    """Return the ranges that are measurements.

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
        low, high = 0.0, math.inf
    beams = ranges >= low if low > 0 else ranges > 0
    beams &= ranges <= min(high, _LARGEST)
    hits = int(np.count_nonzero(beams))
    unmeasured = []
    if hits < len(ranges) and (out := int(np.count_nonzero(np.isfinite(ranges))) - hits):
        unmeasured.append((OUT_OF_RANGE, out))
        if 2 * out > len(ranges):
            notes += _contradicted(ranges, low, high)
    ranges = np.where(beams, ranges, np.nan)
    pile = _pile(ranges, _NEAR * high)
    if pile is not None:
        # Where nothing is hit, nothing is farther.
        missed = ranges >= pile
        ranges[missed] = np.nan
        unmeasured.append((NOTHING_HIT, int(np.count_nonzero(missed))))
        notes.append("beams that share one range, next to range_max, have hit nothing")
    return Finding(Measured(ranges, tuple(unmeasured)), "; ".join(notes))


def _contradicted(ranges: Float64, low: float, high: float) -> list[str]:
    """Return a note if most ranges lie far out of bounds and do not share one value."""
    told = ranges[np.isfinite(ranges) & (ranges > 0)]
    for out, bound, where in (
        (told < low, low, "below range_min"),
        (told > _FAR * high, high, "beyond range_max"),
    ):
        beyond = told[out]
        if 2 * len(beyond) <= len(told):
            continue
        middle = float(np.median(beyond))
        # What most of them share is a driver's word for nothing hit.
        if 2 * np.count_nonzero(beyond == middle) < len(beyond):
            return [
                f"most ranges, as {middle:.3g}, are {where}, {bound:.3g}, and dropped; that bound "
                "or their unit may be wrong"
            ]
    return []


def _pile(ranges: Float64, near: float) -> float | None:
    """Return the least range from `near` on that beams pile up at; None where they do not."""
    fewest = max(_LEAST, int(_SHARE * len(ranges)) + 1)
    far = ranges >= near
    # Mostly few are, and that number is all that is looked at.
    count = int(np.count_nonzero(far))
    if count < fewest:
        return None
    those = ranges[far]
    those.sort()
    alike = those[fewest - 1 :] == those[: count - fewest + 1]
    first = alike.argmax()
    return float(those[first]) if alike[first] else None
