"""Decode clouds whose points are packed into bytes, in a layout that the message states.

References
----------
sensor_msgs/PointCloud2 and sensor_msgs/PointField: the numbers of datatypes, and what offsets,
steps and the byte order mean.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from mlscli.io.messages.parts import CloudPart, MalformedCloudError, part_of
from mlscli.io.plausibility.halves import unveiled
from mlscli.io.plausibility.layouts import Layout, layout_of, offsets_of
from mlscli.io.plausibility.readings import likelier, looks_right, sample
from mlscli.io.ros import DATATYPES
from mlscli.io.source import keyframe_field, side_by_side
from mlscli.runtime.arrays import Array, Float64

_SWAPPED = (
    "is_bigendian is not set, but the data is big-endian, and is read so",
    "is_bigendian is set, but the data is little-endian, and is read so",
)
_NAMES = {"x", "y", "z"}
# Which laser of several measured a point: drivers of spinning lidars, and Livox's.
_LASERS = {"ring", "line"}
_FLOATS = {"f4": 4, "f8": 8}
_dtype = cache(np.dtype)
_UNTOLD = "is_bigendian is set, and the data does not tell whether it is right; it is followed"


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
        points = side_by_side([self._view(name) for name in self._names()])
        name = keyframe_field(self.fields)
        return points, None if name is None else self._view(name).reshape(-1)

    def judged(self) -> tuple[Float64, Array | None, str]:
        """Return points and keyframes, as the data itself says they are, and what is doubted.

        Raises
        ------
        MalformedCloudError
            As for `unpack`.
        """
        points, keyframes = self.unpack()
        if self._looks_right(len(points)):
            return points, keyframes, ""
        found = unveiled([self._view(name).reshape(-1) for name in self._names()])
        if found.note:
            return side_by_side(found.accepted(MalformedCloudError)), keyframes, found.note
        flagged = self.order == ">"
        other = self._replace(order="<" if flagged else ">")
        some = sample(points)
        rows, columns = np.unravel_index(some, self.shape)
        swapped = side_by_side([other._view(name)[rows, columns] for name in self._names()])
        reading = likelier(points[some], [swapped])
        if reading == 0:
            return *other.unpack(), _SWAPPED[flagged]
        return points, keyframes, _UNTOLD if reading is None and flagged else ""

    def _looks_right(self, count: int) -> bool:
        """Return whether coordinates look right as they were read; False: look closer."""
        x, y, z = (self.fields[name] for name in self._names())
        size = _FLOATS.get(self.datatypes[x.datatype])
        if size is None or not x.datatype == y.datatype == z.datatype:
            return False
        row_step, point_step = self.strides
        if row_step != self.shape[1] * point_step:
            # Rows with gaps: the first one tells enough.
            count = self.shape[1]
        top = size - 1 if self.order == "<" else 0
        tops = (x.offset + top, y.offset + top, z.offset + top)
        return looks_right(self.data, tops, point_step, count, size)

    def _names(self) -> Sequence[str]:
        """Return the names of the coordinates x, y, z among the fields."""
        if self.fields.keys() >= _NAMES:
            return "xyz"
        # The case of a name does not matter where nothing else fits.
        by_case = {name.lower(): name for name in reversed(list(self.fields))}
        absent = [name for name in "xyz" if name not in by_case]
        if absent:
            if not self.fields:
                raise MalformedCloudError("it has no fields, expected x, y and z")
            raise MalformedCloudError(
                f"no field {', '.join(absent)}, expected x, y and z beside {', '.join(self.fields)}"
            )
        return [by_case[name] for name in "xyz"]

    def _view(self, name: str) -> Array:
        """Return the values of a field, (rows, points), without copying them."""
        offset, datatype = self.fields[name].offset, self.fields[name].datatype
        if datatype not in self.datatypes:
            raise MalformedCloudError(
                f"field {name} has datatype {datatype}, expected "
                f"{min(self.datatypes)}-{max(self.datatypes)}"
            )
        dtype = _dtype(self.order + self.datatypes[datatype])
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
        the data does not have the size that the layout says, nor any that it could have.
    """
    # As integers: a field may be text, and text times a number is a long text.
    stated = Layout(
        int(message.height), int(message.width), int(message.row_step), int(message.point_step)
    )
    data = np.asarray(message.data)
    # Of several fields of one name the first counts; of a field with several elements, too.
    fields: dict[str, PointField] = {}
    for field in message.fields:
        if field.name not in fields:
            fields[field.name] = field
    end = _end(fields)
    found = layout_of(data, stated, end)
    layout = found.accepted(MalformedCloudError)
    points, keyframes, misplaced, doubt = np.empty((0, 3)), None, "", ""
    if layout.height and layout.width:
        if end > layout.point_step:
            fields, misplaced = _placed(message.fields, layout.point_step)
        packed = Packed(
            data,
            (layout.height, layout.width),
            (layout.row_step, layout.point_step),
            fields,
            DATATYPES,
            ">" if message.is_bigendian else "<",
        )
        points, keyframes, doubt = packed.judged()
    part = part_of(points, message.header.frame_id, message.header.stamp, keyframes)
    part = part._replace(is_ranged=not _LASERS.isdisjoint(fields))
    if found.note or misplaced or doubt:
        part = part._replace(doubts=tuple(filter(None, (found.note, misplaced, doubt))))
    return [part]


def _placed(listed: Sequence[Any], point_step: int) -> tuple[dict[str, PointField], str]:
    """Return the fields of points, one of which ends beyond them, where they lie, and the doubt."""
    sizes = [
        _dtype(DATATYPES[field.datatype]).itemsize * int(field.count)
        if field.datatype in DATATYPES
        else 0
        for field in listed
    ]
    found = offsets_of([field.offset for field in listed], sizes, point_step)
    placed = zip(listed, found.accepted(MalformedCloudError), strict=True)
    # Of several fields of one name the first counts.
    fields = {field.name: PointField(at, field.datatype) for field, at in [*placed][::-1]}
    return fields, found.note


def _end(fields: Mapping[str, PointField]) -> int:
    """Return how many bytes of a point its fields span, as far as their types are known."""
    sizes = (
        field.offset + _dtype(DATATYPES[field.datatype]).itemsize
        for field in fields.values()
        if field.datatype in DATATYPES
    )
    return max(sizes, default=0)
