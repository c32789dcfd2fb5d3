"""Where the beams of a scan point: its increment, against its bounds and the number of ranges.

References
----------
sensor_msgs/LaserScan: angle_min and angle_max are the angles of the first and the last beam.
"""

from __future__ import annotations

import math

import numpy as np

from mlscli.io.plausibility.finding import Finding, doubted, refused, right
from mlscli.runtime.arrays import Float64

_APART = 2.5
"""Increments between the last beam and angle_max: many drivers set it one or two beyond."""

_TURNS = 4 * math.pi
"""A scan over more radians than two turns has none."""

_DEGREES = 361.0
"""A turn in degrees, and a beam more."""


def angles_of(count: int, low: float, high: float, increment: float) -> Finding[Float64]:
    """Return the angles of the beams.

    Parameters
    ----------
    count : int
        The number of ranges.
    low, high, increment : float
        angle_min, angle_max and angle_increment as the scan states them, in radians. Where the
        bounds are equal, they are not set.

    Returns
    -------
    Finding of float64 (count,)
        In radians, by the increment, which is what viewers go by. Where that is 0 or no number,
        they are spread from bound to bound, if these are apart; else refused, as beams of one
        direction are no scan. What spans many radians is taken as degrees, and refused where it
        cannot be degrees either.
    """
    if count > 1 and not (math.isfinite(increment) and increment):
        if low == high or not math.isfinite(low + high):
            return refused(
                f"angle_increment is {increment:g}, and no bounds tell where beams point"
            )
        spread = angles_of(count, low, high, (high - low) / (count - 1))
        note = f"angle_increment is {increment:g}; the beams are spread from angle_min to angle_max"
        if spread.value is None:
            return spread
        return doubted(spread.value, "; ".join(filter(None, (note, spread.note))))
    angles: Float64 = low + np.arange(count, dtype=np.float64) * increment
    span = abs((count - 1) * increment)
    if count > 1 and span > _TURNS:
        if span > _DEGREES:
            return refused(f"its beams span {span:g} radians, expected a turn at most")
        return doubted(
            np.radians(angles),
            "its beams span more radians than two turns; they are taken as degrees",
        )
    if count < 2 or low == high or not math.isfinite(low + high):
        return right(angles)
    if abs(float(angles[-1]) - high) <= _APART * abs(increment):
        return right(angles)
    if increment * (high - low) < 0:
        return doubted(angles, "angle_increment turns away from angle_max; the increment counts")
    return doubted(
        angles,
        "angle_increment and the number of ranges do not lead from angle_min to angle_max; the "
        "increment counts",
    )
