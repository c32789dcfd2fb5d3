"""Decode scans of a planar laser.

References
----------
sensor_msgs/LaserScan: angles turn around z, zero is forward along x.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from mlscli.io.messages.parts import CloudPart, MalformedCloudError, part_of
from mlscli.io.plausibility.angles import angles_of
from mlscli.io.plausibility.finding import Finding, refused
from mlscli.io.plausibility.ranges import measured
from mlscli.runtime.arrays import Float64

_REMEMBERED = 1 << 16
"""The directions of scans with more beams are not kept for the next one."""


def decode_laserscan(message: Any) -> list[CloudPart]:
    """Decode a ``sensor_msgs/LaserScan``; beams that measured nothing are NaN."""
    ranges = np.asarray(message.ranges, dtype=np.float64)
    remembered = _last_beams if len(ranges) <= _REMEMBERED else _beams
    turned = remembered(
        len(ranges),
        float(message.angle_min),
        float(message.angle_max),
        float(message.angle_increment),
    )
    along = turned.accepted(MalformedCloudError)
    found = measured(ranges, float(message.range_min), float(message.range_max))
    hits, unmeasured = found.accepted(MalformedCloudError)
    points = polar(hits, along)
    part = part_of(points, message.header.frame_id, message.header.stamp)
    doubts = tuple(filter(None, (turned.note, found.note)))
    part = part._replace(doubts=doubts, unmeasured=unmeasured)
    return [part._replace(is_ranged=True, is_sifted=True)]


def directions(angles: Float64) -> Float64:
    """Return the cosines and sines of angles (N,) in radians, float64 (2, N)."""
    return np.stack([np.cos(angles), np.sin(angles)])


def polar(ranges: Float64, along: Float64) -> Float64:
    """Return the points of beams in the xy plane, float64 (N, 3).

    Parameters
    ----------
    ranges : float64 (N,)
        NaN where nothing was measured, as of the points there.
    along : float64 (2, N)
        Cosines and sines of the beams' angles about z, from x.

    Raises
    ------
    MalformedCloudError
        The ranges have another shape.
    """
    if ranges.ndim != 1:
        raise MalformedCloudError(f"ranges of shape {ranges.shape}, expected (N,)")
    points = np.empty((len(ranges), 3))
    for column, factor in enumerate((*along, 0.0)):
        np.multiply(ranges, factor, out=points[:, column])
    return points


def _beams(count: int, low: float, high: float, increment: float) -> Finding[Float64]:
    """Return the directions of the beams, (2, count), read-only; see `angles_of`."""
    turned = angles_of(count, low, high, increment)
    if turned.value is None:
        return refused(turned.refusal)
    along = directions(turned.value)
    along.setflags(write=False)
    return turned._replace(value=along)


# The scans of a scanner mostly have the same ones.
_last_beams = lru_cache(maxsize=4)(_beams)
