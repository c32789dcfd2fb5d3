"""Scans of a planar laser.

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
    """Read a ``sensor_msgs/LaserScan``; beams that hit nothing are NaN."""
    ranges = np.asarray(message.ranges, dtype=np.float64)
    angles = message.angle_min + np.arange(len(ranges)) * message.angle_increment
    valid = (ranges >= message.range_min) & (ranges <= message.range_max)
    points = polar(np.where(valid, ranges, np.nan), angles)
    return [part_of(points, message.header.frame_id, message.header.stamp)]


def polar(ranges: Float64, angles: Float64) -> Float64:
    """Return the points (N, 3) of beams in the xy plane; those not finite are NaN."""
    ranges = np.where(np.isfinite(ranges), ranges, np.nan)
    return np.column_stack([ranges * np.cos(angles), ranges * np.sin(angles), ranges * 0])
