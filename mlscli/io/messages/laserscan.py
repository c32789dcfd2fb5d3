"""Decode scans of a planar laser.

References
----------
sensor_msgs/LaserScan: angles turn around z, zero is forward along x.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from mlscli.io.messages.parts import CloudPart, MalformedCloudError, part_of
from mlscli.io.plausibility.angles import angles_of
from mlscli.io.plausibility.ranges import measured
from mlscli.runtime.arrays import Float64


def decode_laserscan(message: Any) -> list[CloudPart]:
    """Decode a ``sensor_msgs/LaserScan``; beams that measured nothing are NaN."""
    ranges = np.asarray(message.ranges, dtype=np.float64)
    turned = angles_of(
        len(ranges),
        float(message.angle_min),
        float(message.angle_max),
        float(message.angle_increment),
    )
    angles = turned.accepted(MalformedCloudError)
    found = measured(ranges, float(message.range_min), float(message.range_max))
    beams, unmeasured = found.accepted(MalformedCloudError)
    points = polar(np.where(beams, ranges, np.nan), angles)
    part = part_of(points, message.header.frame_id, message.header.stamp)
    doubts = tuple(filter(None, (turned.note, found.note)))
    return [part._replace(doubts=doubts, unmeasured=unmeasured, is_ranged=True)]


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
