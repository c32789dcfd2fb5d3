"""LAS and LAZ files as clouds, through laspy and lazrs: scaled coordinates in float64.

Points flagged as withheld are left out: the specification calls them deleted. (ASPRS, LAS
Specification 1.4 R15.)
"""

from __future__ import annotations

import io
import logging
import struct
from collections.abc import Iterable
from itertools import chain, repeat
from typing import Any, BinaryIO, NamedTuple

import laspy
import numpy as np

from mlscli.errors import InputError, one_line
from mlscli.io.clouds.laz import check_packing, needs_table, readable_points
from mlscli.io.clouds.pointfile import Content, PointFile, by_keyframe, shortfall
from mlscli.io.clouds.structures import mapped
from mlscli.io.source import keyframe_field, side_by_side
from mlscli.runtime.arrays import Array, Float64

# What laspy logs is also raised.
logging.getLogger("laspy").addHandler(logging.NullHandler())

_CHUNK_BYTES = 1 << 22
_HEADER = struct.Struct("<4s90xHII")
_SHORTEST_HEADER = 227
_VARIABLE_RECORD = 54


class LasCloud(PointFile):
    """A LAS or LAZ file: one keyframe, unless an extra dimension tells keyframes apart."""

    kind = "LAS cloud"

    def _read(self) -> Content:
        header, one_way = self._header()
        count = header.point_count
        tried = (
            readable_points(header, mapped(self.path)) if header.are_points_compressed else count
        )
        step = max(1, _CHUNK_BYTES // header.point_format.size)
        part = self._part(repeat(step), tried, one_way)
        for smaller in (256, 1) if part.fault else ():
            nearer = self._part(chain(part.sizes, repeat(smaller)), tried, one_way)
            part = max(part, nearer, key=lambda part: sum(part.sizes))
        points = np.concatenate([np.empty((0, 3)), *part.points])
        labels = np.concatenate(part.labels) if part.labels else None
        came = sum(part.sizes)
        withheld = came - len(points)
        return Content(
            by_keyframe(points, labels),
            [f"{self.path}: {withheld:,} points are flagged as withheld and left out"]
            if withheld
            else [],
            [shortfall(self.path, came, count, part.fault)] if came < count else [],
        )

    def _header(self) -> tuple[laspy.LasHeader, bool]:
        """Return the header, and whether the points can be read without seeking.

        If so, a file that was cut can be read, too. Only compressed points in chunks of different
        sizes need seeking: to the table of chunks at their end.

        Raises
        ------
        InputError
            The header is not whole, or contradicts itself.
        """
        data = mapped(self.path)
        try:
            _, size, begin, records = _HEADER.unpack_from(data.data)
            if len(data) < max(begin, _SHORTEST_HEADER):
                raise ValueError(f"the file ends at byte {len(data):,}, before its points")
            # laspy reads as many records as are declared, whether they are there or not.
            if records * _VARIABLE_RECORD > begin - size:
                raise ValueError(f"{records:,} variable length records do not fit the header")
            with self.path.open("rb") as file:
                header = laspy.LasHeader.read_from(file)
            if not header.are_points_compressed:
                return header, True
            (packing,) = header.vlrs.get("LasZipVlr")
            check_packing(header, packing)
            return header, not needs_table(header, packing, data)
        # laspy fails in many ways on damaged headers.
        except Exception as error:
            raise InputError(
                f"{self.path}: the header cannot be read: {one_line(error)}"
            ) from error

    def _part(self, steps: Iterable[int], left: int, one_way: bool) -> _ChunkedPoints:
        """Read points until `left` of them have come or no more can be read.

        Parameters
        ----------
        steps : iterable of int
            How many points to read at a time.
        left : int
        one_way : bool
            Whether to read without seeking.
        """
        part = _ChunkedPoints([], [], [], "")
        with self.path.open("rb") as file:
            try:
                reader = laspy.LasReader(
                    _OneWay(file) if one_way else file,
                    laz_backend=laspy.LazBackend.Lazrs,
                    read_evlrs=False,
                )
                label = keyframe_field(set(reader.header.point_format.extra_dimension_names))
                for step in steps:
                    if not left:
                        break
                    chunk = reader.read_points(min(step, left))
                    if not len(chunk):
                        raise EOFError("the file ends before them")
                    kept = ~np.asarray(chunk.withheld, dtype=np.bool_)
                    xyz = side_by_side([np.asarray(axis) for axis in (chunk.x, chunk.y, chunk.z)])
                    part.points.append(xyz[kept])
                    if label is not None:
                        part.labels.append(np.asarray(chunk[label])[kept])
                    part.sizes.append(len(chunk))
                    left -= len(chunk)
            # laspy and lazrs fail in many ways on damaged points, panics of Rust included.
            except BaseException as error:
                if not isinstance(error, Exception) and type(error).__name__ != "PanicException":
                    raise
                return part._replace(fault=one_line(error) or type(error).__name__)
        return part


class _ChunkedPoints(NamedTuple):
    """Points as read, in chunks.

    Attributes
    ----------
    points : list of float64 (N, 3)
        Scaled coordinates, without withheld points.
    labels : list of (N,)
        The keyframe of each of these points; empty where no dimension holds it.
    sizes : list of int
        Number of points read in each chunk, with withheld ones.
    fault : str
        Why no more could be read; empty where all were.
    """

    points: list[Float64]
    labels: list[Array]
    sizes: list[int]
    fault: str


class _OneWay(io.RawIOBase):
    """A file without seeking."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file

    def readable(self) -> bool:
        """Return True."""
        return True

    def readinto(self, buffer: Any, /) -> int:
        """Read into a buffer."""
        data = self._file.read(len(buffer))
        buffer[: len(data)] = data
        return len(data)
