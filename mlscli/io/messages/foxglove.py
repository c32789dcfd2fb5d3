"""Decode Foxglove's clouds and scans, from protobuf, json or messages of ROS.

References
----------
Foxglove's message schemas: PointCloud, PackedElementField, NumericType, LaserScan. In json,
bytes are in base64; packed numbers are little-endian.
"""

from __future__ import annotations

import base64
from typing import Any

import numpy as np

from mlscli.io.messages.laserscan import directions, polar
from mlscli.io.messages.parts import CloudPart, MalformedCloudError, part_of, placed
from mlscli.io.messages.pointcloud2 import Packed, PointField
from mlscli.io.plausibility.ranges import measured
from mlscli.runtime.arrays import Array, Float64

# The numbers of foxglove.NumericType, each with its numpy type.
_DATATYPES = {1: "u1", 2: "i1", 3: "u2", 4: "i2", 5: "u4", 6: "i4", 7: "f4", 8: "f8"}


def decode_foxglove_pointcloud(message: Any) -> list[CloudPart]:
    """Decode a ``foxglove.PointCloud``.

    Raises
    ------
    MalformedCloudError
        A coordinate is missing, a field extends beyond its point, its datatype is not known, or
        the data is no whole number of points.
    """
    data = _bytes(message.data)
    stride = int(message.point_stride)
    points, keyframes = np.empty((0, 3)), None
    if len(data):
        if stride <= 0 or len(data) % stride:
            raise MalformedCloudError(
                f"{len(data)} bytes of data, expected a multiple of point_stride {stride}"
            )
        fields = {f.name: PointField(int(f.offset), int(f.type)) for f in reversed(message.fields)}
        shape, strides = (1, len(data) // stride), (len(data), stride)
        points, keyframes = Packed(data, shape, strides, fields, _DATATYPES, "<").unpack()
    return [_part(message, points, keyframes)]


def decode_foxglove_laserscan(message: Any) -> list[CloudPart]:
    """Decode a ``foxglove.LaserScan``: beams are spread evenly from the first to the last angle."""
    ranges = np.asarray(message.ranges, dtype=np.float64)
    angles = np.linspace(message.start_angle, message.end_angle, len(ranges))
    hits, unmeasured = measured(ranges, 0.0, np.inf).accepted(MalformedCloudError)
    part = _part(message, polar(hits, directions(angles)), None)
    return [part._replace(unmeasured=unmeasured, is_ranged=True, is_sifted=True)]


def _part(message: Any, points: Float64, keyframes: Array | None) -> CloudPart:
    pose = getattr(message, "pose", None)
    if pose is not None:
        points = placed(points, pose)
    return part_of(points, message.frame_id, message.timestamp, keyframes)


def _bytes(data: Any) -> Array:
    if isinstance(data, str):
        data = base64.b64decode(data, validate=True)
    return np.frombuffer(data, dtype=np.uint8)
