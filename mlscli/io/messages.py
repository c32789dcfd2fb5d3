"""Messages that hold points: from a deserialised message to float64 coordinates.

A cloud with a field or channel named ``keyframe`` (or ``kf``, ``kf_id``) holds the points of
several keyframes and is split by it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from mlscli.io.base import rows_by_first_appearance
from mlscli.typing import Array, Float64

KEYFRAME_FIELDS = ("keyframe", "kf", "kf_id")

# sensor_msgs/PointField: the number of a datatype and what it stands for.
_DATATYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}


class MalformedCloudError(ValueError):
    """A message contradicts itself or lacks a coordinate; says what was found and expected."""


class Decoded(NamedTuple):
    """The points of one message.

    Attributes
    ----------
    points : float64 (N, 3)
    keyframes : (N,) or None
        The keyframe of each point; None where the message does not tell them apart.
    """

    points: Float64
    keyframes: Array | None

    def split(self) -> list[Float64]:
        """Return a cloud for each keyframe, in order of first appearance."""
        if self.keyframes is None or not len(self.points):
            return [self.points]
        return [self.points[rows] for rows in rows_by_first_appearance(self.keyframes)]


def decode_pointcloud2(message: Any) -> Decoded:
    """Read a ``sensor_msgs/PointCloud2`` of any layout.

    Raises
    ------
    MalformedCloudError
        A coordinate is missing, a field leaves its point, or the data is not as long as the
        layout says.
    """
    size = message.width * message.height
    if size == 0:
        return Decoded(np.empty((0, 3)), None)
    strides = _strides(message)
    fields = {field.name: field for field in reversed(message.fields)}
    absent = [name for name in "xyz" if name not in fields]
    if absent:
        raise MalformedCloudError(
            f"no field {', '.join(absent)}, expected x, y and z beside {_listed(fields)}"
        )
    xyz = [_view(message, fields[name], strides) for name in "xyz"]
    # Signalling NaNs are no reason to warn: points that are not finite are dropped later.
    with np.errstate(invalid="ignore"):
        points = np.stack(xyz, axis=-1, dtype=np.float64, casting="unsafe").reshape(size, 3)
    name = next((name for name in KEYFRAME_FIELDS if name in fields), None)
    keyframes = None if name is None else _view(message, fields[name], strides).ravel()
    return Decoded(points, keyframes)


def decode_pointcloud(message: Any) -> Decoded:
    """Read a ``sensor_msgs/PointCloud``.

    Raises
    ------
    MalformedCloudError
        The channel that tells keyframes apart has not a value for each point.
    """
    size = len(message.points)
    flat = (value for point in message.points for value in (point.x, point.y, point.z))
    points = np.fromiter(flat, dtype=np.float64, count=3 * size).reshape(size, 3)
    channels = {channel.name: channel for channel in reversed(message.channels)}
    name = next((name for name in KEYFRAME_FIELDS if name in channels), None)
    if name is None:
        return Decoded(points, None)
    keyframes = np.asarray(channels[name].values)
    if len(keyframes) != size:
        raise MalformedCloudError(
            f"{len(keyframes)} values in channel {name}, expected one for each of {size} points"
        )
    return Decoded(points, keyframes)


CLOUD_TYPES: dict[str, Callable[[Any], Decoded]] = {
    "sensor_msgs/msg/PointCloud2": decode_pointcloud2,
    "sensor_msgs/msg/PointCloud": decode_pointcloud,
}
"""The message types that can be mapped, and how each is decoded."""


def _strides(message: Any) -> tuple[int, int]:
    """Return the bytes from row to row and from point to point, checked against the data."""
    row = message.width * message.point_step
    # A cloud of one row has no next row; some writers leave row_step unset there.
    row_step = message.row_step if message.height > 1 else max(row, message.row_step)
    length = len(message.data)
    expected = message.height * row_step
    if row_step < row or length not in (expected, expected - row_step + row):
        raise MalformedCloudError(
            f"{length} bytes of data, expected {max(expected, message.height * row)} for width "
            f"{message.width}, height {message.height}, point_step {message.point_step} and "
            f"row_step {message.row_step}"
        )
    return row_step, message.point_step


def _view(message: Any, field: Any, strides: tuple[int, int]) -> Array:
    """Return the values of a field, (height, width), without copying them."""
    if field.datatype not in _DATATYPES:
        raise MalformedCloudError(f"field {field.name} has datatype {field.datatype}, expected 1-8")
    dtype = np.dtype((">" if message.is_bigendian else "<") + _DATATYPES[field.datatype])
    if field.offset + dtype.itemsize > message.point_step:
        raise MalformedCloudError(
            f"field {field.name} ends at byte {field.offset + dtype.itemsize} of a point, "
            f"expected at most its point_step {message.point_step}"
        )
    return np.ndarray(
        (message.height, message.width), dtype, np.asarray(message.data), field.offset, strides
    )


def _listed(fields: dict[str, Any]) -> str:
    return ", ".join(reversed(fields)) or "none"
