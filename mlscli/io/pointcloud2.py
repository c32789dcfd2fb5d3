"""Clouds whose points are packed into bytes, in a layout that the message tells.

References
----------
sensor_msgs/PointCloud2 and sensor_msgs/PointField: the numbers of datatypes, and what offsets,
steps and the byte order mean.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from mlscli.io.parts import MalformedCloudError, Part, keyframe_field, seconds, stacked
from mlscli.typing import Array, Float64

# sensor_msgs/PointField: the number of a datatype and what it stands for.
_DATATYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}


class Field(NamedTuple):
    """A number of every point: where it begins in the point, and its datatype by number."""

    offset: int
    datatype: int


class Packed(NamedTuple):
    """Points in bytes.

    Attributes
    ----------
    data : uint8 (M,)
    shape : tuple of int
        Rows, and points in a row.
    strides : tuple of int
        Bytes from row to row and from point to point, with which the data is long enough.
    fields : mapping of str to Field
    datatypes : mapping of int to str
        What the numbers of datatypes stand for, as numpy writes it.
    order : str
        ``<`` little-endian, ``>`` big-endian.
    """

    data: Array
    shape: tuple[int, int]
    strides: tuple[int, int]
    fields: Mapping[str, Field]
    datatypes: Mapping[int, str]
    order: str

    def unpack(self) -> tuple[Float64, Array | None]:
        """Return the coordinates (N, 3) and, where points tell them, their keyframes (N,).

        Raises
        ------
        MalformedCloudError
            A coordinate is missing, a field leaves its point, or its datatype is not known.
        """
        absent = [name for name in "xyz" if name not in self.fields]
        if absent:
            raise MalformedCloudError(
                f"no field {', '.join(absent)}, expected x, y and z beside "
                f"{', '.join(self.fields) or 'none'}"
            )
        points = stacked([self._view(name) for name in "xyz"])
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


def decode_pointcloud2(message: Any) -> list[Part]:
    """Read a ``sensor_msgs/PointCloud2`` of any layout.

    Raises
    ------
    MalformedCloudError
        A coordinate is missing, a field leaves its point, or the data is not as long as the
        layout says.
    """
    points, keyframes = np.empty((0, 3)), None
    if message.width * message.height:
        # Of two fields with one name the first counts; of several elements the first as well.
        fields = {f.name: Field(f.offset, f.datatype) for f in reversed(message.fields)}
        points, keyframes = Packed(
            np.asarray(message.data),
            (message.height, message.width),
            _strides(message),
            dict(reversed(fields.items())),
            _DATATYPES,
            ">" if message.is_bigendian else "<",
        ).unpack()
    return [Part(points, keyframes, message.header.frame_id, seconds(message.header.stamp))]


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
