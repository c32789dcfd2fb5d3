"""Decode clouds whose points are packed into bytes, in a layout that the message states.

References
----------
sensor_msgs/PointCloud2 and sensor_msgs/PointField: the numbers of datatypes, and what offsets,
steps and the byte order mean.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from mlscli.io.messages.parts import CloudPart, MalformedCloudError, part_of
from mlscli.io.ros import DATATYPES
from mlscli.io.source import keyframe_field, side_by_side
from mlscli.runtime.arrays import Array, Float64


class PointField(NamedTuple):
    """A field of every point.

    Attributes
    ----------
    offset : int
        Offset in the point where its value begins, in bytes.
    datatype : int
        Number of its datatype: a key of `Packed.datatypes`.
    """

    offset: int
    datatype: int


class Packed(NamedTuple):
    """Points in bytes.

    Attributes
    ----------
    data : uint8 (M,)
    shape : tuple of int
        Number of rows, and of points in a row.
    strides : tuple of int
        Bytes from row to row and from point to point; `data` must be long enough for them.
    fields : mapping of str to PointField
        By name.
    datatypes : mapping of int to str
        The numpy type of each datatype number, without byte order.
    order : str
        ``<`` little-endian, ``>`` big-endian.
    """

    data: Array
    shape: tuple[int, int]
    strides: tuple[int, int]
    fields: Mapping[str, PointField]
    datatypes: Mapping[int, str]
    order: str

    def unpack(self) -> tuple[Float64, Array | None]:
        """Return the coordinates of the points, and their keyframes.

        Returns
        -------
        points : float64 (N, 3)
        keyframes : (N,) or None
            Of the dtype of their field; None where there is no such field.

        Raises
        ------
        MalformedCloudError
            A coordinate is missing, a field extends beyond its point, or its datatype is not known.
        """
        absent = [name for name in "xyz" if name not in self.fields]
        if absent:
            raise MalformedCloudError(
                f"no field {', '.join(absent)}, expected x, y and z beside "
                f"{', '.join(self.fields) or 'none'}"
            )
        points = side_by_side([self._view(name) for name in "xyz"])
        name = keyframe_field(self.fields)
        return points, None if name is None else self._view(name).reshape(-1)

    def _view(self, name: str) -> Array:
        """Return the values of a field, (rows, points), without copying them."""
        offset, datatype = self.fields[name]
        if datatype not in self.datatypes:
            raise MalformedCloudError(
                f"field {name} has datatype {datatype}, expected "
                f"{min(self.datatypes)}-{max(self.datatypes)}"
            )
        dtype = np.dtype(self.order + self.datatypes[datatype])
        if not 0 <= offset <= self.strides[1] - dtype.itemsize:
            raise MalformedCloudError(
                f"field {name} ends at byte {offset + dtype.itemsize} of points that are "
                f"{self.strides[1]} bytes apart"
            )
        return np.ndarray(self.shape, dtype, self.data, offset, self.strides)


def decode_pointcloud2(message: Any) -> list[CloudPart]:
    """Decode a ``sensor_msgs/PointCloud2`` of any layout.

    Raises
    ------
    MalformedCloudError
        A coordinate is missing, a field extends beyond its point, its datatype is not known, or
        the data is not as long as the layout says.
    """
    # As integers: a field may be text, and text times a number is a long text.
    height, width = int(message.height), int(message.width)
    steps = int(message.row_step), int(message.point_step)
    points, keyframes = np.empty((0, 3)), None
    if width * height:
        # Of several fields of one name the first counts; of a field with several elements, too.
        fields: dict[str, PointField] = {}
        for field in message.fields:
            fields.setdefault(field.name, PointField(field.offset, field.datatype))
        points, keyframes = Packed(
            np.asarray(message.data),
            (height, width),
            _strides(len(message.data), height, width, *steps),
            fields,
            DATATYPES,
            ">" if message.is_bigendian else "<",
        ).unpack()
    return [part_of(points, message.header.frame_id, message.header.stamp, keyframes)]


def _strides(
    length: int, height: int, width: int, row_step: int, point_step: int
) -> tuple[int, int]:
    """Return the bytes from row to row and from point to point, checked against the data."""
    row = width * point_step
    # A cloud of one row has no next row; some writers leave row_step unset there.
    apart = row_step if height > 1 else max(row, row_step)
    expected = height * apart
    if apart < row or length not in (expected, expected - apart + row):
        raise MalformedCloudError(
            f"{length} bytes of data, expected {max(expected, height * row)} for width {width}, "
            f"height {height}, point_step {point_step} and row_step {row_step}"
        )
    return apart, point_step
