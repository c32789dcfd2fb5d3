"""Decode scans of a planar laser.

References
----------
sensor_msgs/LaserScan: angles turn around z, zero is forward along x; ranges outside of
[range_min, range_max] should be discarded.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from mlscli.io.messages.parts import CloudPart, part_of
from mlscli.runtime.arrays import Float64


def decode_laserscan(message: Any) -> list[CloudPart]:
    """Decode a ``sensor_msgs/LaserScan``; beams without a valid range are NaN."""
    ranges = np.asarray(message.ranges, dtype=np.float64)
    angles = message.angle_min + np.arange(len(ranges)) * message.angle_increment
    valid = (ranges >= message.range_min) & (ranges <= message.range_max)
    points = polar(np.where(valid, ranges, np.nan), angles)
    return [part_of(points, message.header.frame_id, message.header.stamp)]


def polar(ranges: Float64, angles: Float64) -> Float64:
    """Return the points of beams in the xy plane.

    Parameters
    ----------
    ranges : float64 (N,)
    angles : float64 (N,)
        Radians about z, from x.

    Returns
    -------
    float64 (N, 3)
        NaN where the range is not finite.
    """
    ranges = np.where(np.isfinite(ranges), ranges, np.nan)
    return np.column_stack([ranges * np.cos(angles), ranges * np.sin(angles), ranges * 0])
