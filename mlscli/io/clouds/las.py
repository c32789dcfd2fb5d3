"""LAS and LAZ files as clouds, through laspy and lazrs: scaled coordinates in float64.

Points flagged as withheld are left out: the specification calls them deleted. (ASPRS, LAS
Specification 1.4 R15.)
"""

from __future__ import annotations

import io
import logging
import math
import struct
from collections.abc import Iterable
from itertools import chain, repeat
from typing import Any, BinaryIO, NamedTuple

import laspy
import lazrs
import numpy as np

from mlscli.errors import InputError, one_line
from mlscli.io.clouds.lascrs import georeference_of
from mlscli.io.clouds.laz import (
    check_packing,
    invented_points,
    is_layered,
    needs_table,
    points_end,
    readable_points,
)
from mlscli.io.clouds.pointfile import Content, PointFile, by_keyframe, counted
from mlscli.io.clouds.structures import bytes_of
from mlscli.io.files import open_input
from mlscli.io.plausibility.boxes import overflowed, within_bounds
from mlscli.io.plausibility.finding import Finding, right
from mlscli.io.source import keyframe_field, side_by_side
from mlscli.io.unpacking import excess, most_unpacked
from mlscli.runtime.arrays import Array, Bool, Float64, UInt8
from mlscli.runtime.muted import muted
from mlscli.words import are, some

# What laspy logs is also raised.
logging.getLogger("laspy").addHandler(logging.NullHandler())

_CHUNK_BYTES = 1 << 22
_HEADER = struct.Struct("<4s90xHII")
_SHORTEST_HEADER = 227
_VARIABLE_RECORD = 54
_RECORD_LENGTH = struct.Struct("<20xH")
_COUNT, _COUNT_AT = struct.Struct("<I"), 100
_SIGNATURE, _VERSIONS = b"LASF", {(1, minor) for minor in range(5)}
# The version of a header, its size, and where its points begin.
_BEGINNING = struct.Struct("<24xBB68xHI")
# Bytes that end compressed points, and that the decoder need not have read.
_FLUSHED = 16


class LasCloud(PointFile):
    """A LAS or LAZ file: one keyframe, unless an extra dimension tells keyframes apart."""

    kind = "LAS cloud"

    def _read(self) -> Content:
        header, one_way, notes = self._header()
        declared, data = header.point_count, bytes_of(self.path)
        data = data[: (joined := _next_file(header, data))]
        if header.are_points_compressed:
            tried = readable_points(header, data)
            most = most_unpacked(len(data)) // header.point_format.size
        else:
            tried = most = _whole_records(header, data)
        end = points_end(header, data) if one_way else None
        part = self._as_many(header, min(tried, most), end)
        is_chained = header.are_points_compressed and not is_layered(header)
        goes_on = is_chained and not part.fault and tried < most and part.unread > _FLUSHED
        if goes_on:
            part = self._as_many(header, most, end)
        points = np.concatenate([np.empty((0, 3)), *part.points])
        columns = [*points.T, np.concatenate(part.kept) if part.kept else np.empty(0, np.bool_)]
        if part.labels:
            columns.append(np.concatenate(part.labels))
        if part.fault and header.are_points_compressed:
            sure = len(points) - invented_points(header, data, len(points))
            beyond = _vouched(header, points[declared:sure], broken=True).accepted(InputError)
            if goes_on and not beyond.all():
                sure = declared
            columns = [column[:sure] for column in columns]
        fault = part.fault or (excess(len(data)) if tried > most else "")
        columns, more, losses = counted(self.path, columns, declared, fault)
        if goes_on:
            losses.append(
                f"{self.path}: more points follow than the {declared:,} that its header declares; "
                "how many cannot be told, and the last ones are left out"
            )
        points, kept = points[: len(columns[0])], columns[3]
        labels = columns[4] if len(columns) > 4 else None
        withheld = len(points) - int(kept.sum())
        notes += more
        if withheld:
            left = some(withheld, "point")
            notes.append(f"{self.path}: {left} {are(withheld)} flagged as withheld and left out")
        undamaged, note, faults = _undamaged(header, points, kept, broken=bool(part.fault))
        losses += [f"{self.path}: {fault}" for fault in faults]
        notes += [f"{self.path}: {note}"] if note else []
        kept = kept & undamaged
        if joined is not None:
            losses.append(
                f"{self.path}: another LAS file, joined to it at byte {joined:,}, is left out; "
                "expected each in a file of its own"
            )
        georeference, more = georeference_of(self.path, header, data)
        notes += more
        whole = bool(kept.all())
        return Content(
            by_keyframe(
                points if whole else points[kept],
                labels if labels is None or whole else labels[kept],
            ),
            notes,
            losses,
            georeference=georeference,
        )

    def _header(self) -> tuple[laspy.LasHeader, bool, list[str]]:
        """Return the header, whether the points can be read without seeking, and notes.

        If so, a file that was cut can be read, too. Only compressed points in chunks of different
        sizes need seeking: to the table of chunks at their end.

        Raises
        ------
        InputError
            The header is not whole, or contradicts itself.
        """
        data = bytes_of(self.path)
        try:
            _, size, begin, records = _HEADER.unpack_from(data.data)
            if len(data) < max(begin, _SHORTEST_HEADER):
                raise ValueError(f"the file ends at byte {len(data):,}, before its points")
            if size > begin:
                raise ValueError(f"{size:,} bytes of header do not fit before byte {begin:,}")
            # laspy reads as many records as are declared, whether they are there or not.
            self._records = _fitting_records(data, size, begin, records)
            notes = []
            if self._records < records:
                notes.append(
                    f"{self.path}: its header declares {records:,} variable length records, of "
                    f"which {self._records:,} fit before its points; these begin where it says"
                )
            with open_input(self.path) as file:
                header = laspy.LasHeader.read_from(_Overlaid(file, self._records))
            scales = np.asarray(header.scales)
            if not (np.isfinite(scales) & (scales != 0)).all():
                raise ValueError(
                    f"found scales of {', '.join(map(str, scales.tolist()))}, expected numbers "
                    "other than 0"
                )
            if not header.are_points_compressed:
                return header, True, notes
            (packing,) = header.vlrs.get("LasZipVlr")
            check_packing(header, packing)
            return header, not needs_table(header, packing, data), notes
        # laspy fails in many ways on damaged headers.
        except Exception as error:
            raise InputError(
                f"{self.path}: the header cannot be read: {one_line(error)}"
            ) from error

    def _as_many(self, header: laspy.LasHeader, left: int, end: int | None) -> _ChunkedPoints:
        """Read as many as `left` points, up to the last that can be read; see `_part`."""
        packed = header.offset_to_point_data if header.are_points_compressed else math.inf
        step = max(1, _CHUNK_BYTES // header.point_format.size)
        part = self._part(repeat(step), left, end, packed)
        for smaller in (256, 1) if part.fault else ():
            nearer = self._part(chain(part.sizes, repeat(smaller)), left, end, packed)
            part = max(part, nearer, key=lambda part: sum(part.sizes))
        return part

    def _part(
        self, steps: Iterable[int], left: int, end: int | None, packed: float
    ) -> _ChunkedPoints:
        """Read points until `left` of them have come or no more can be read.

        Parameters
        ----------
        steps : iterable of int
            How many points to read at a time.
        left : int
        end : int or None
            Offset at which they end, to read without seeking; None: with seeking.
        packed : float
            Offset at which they begin, if they are compressed.
        """
        part = _ChunkedPoints([], [], [], [], "", 0)
        with open_input(self.path) as file, muted():
            try:
                reader = laspy.LasReader(
                    _Overlaid(file, self._records, end, packed),
                    laz_backend=laspy.LazBackend.Lazrs,
                    read_evlrs=False,
                )
                reader.header.point_count = left
                label = keyframe_field(set(reader.header.point_format.extra_dimension_names))
                for step in steps:
                    if not left:
                        break
                    chunk = reader.read_points(min(step, left))
                    if not len(chunk):
                        raise EOFError("the file ends before them")
                    kept = ~np.asarray(chunk.withheld, dtype=np.bool_)
                    xyz = side_by_side([np.asarray(axis) for axis in (chunk.x, chunk.y, chunk.z)])
                    labels = None if label is None else np.asarray(chunk[label])
                    # All or nothing of a chunk: a damaged scale lets coordinates alone fail.
                    part.kept.append(kept)
                    part.points.append(xyz)
                    if labels is not None:
                        part.labels.append(labels)
                    part.sizes.append(len(chunk))
                    left -= len(chunk)
            # laspy and lazrs fail in many ways on damaged points, panics of Rust included.
            except BaseException as error:
                if not isinstance(error, Exception) and type(error).__name__ != "PanicException":
                    raise
                return part._replace(fault=one_line(error) or type(error).__name__)
            return part._replace(unread=0 if end is None else end - file.tell())


class _ChunkedPoints(NamedTuple):
    """Points as read, in chunks.

    Attributes
    ----------
    points : list of float64 (N, 3)
        Scaled coordinates.
    kept : list of bool (N,)
        Which of them are not withheld.
    labels : list of (N,)
        The keyframe of each point; empty where no dimension holds it.
    sizes : list of int
        Number of points read in each chunk.
    fault : str
        Why no more could be read; empty where all were.
    unread : int
        How many bytes were not read up to where they end, if that is known.
    """

    points: list[Float64]
    kept: list[Bool]
    labels: list[Array]
    sizes: list[int]
    fault: str
    unread: int


def _vouched(header: laspy.LasHeader, points: Float64, *, broken: bool) -> Finding[Bool]:
    """Return which points are not damaged, as far as the bounds in the header tell.

    Of compressed points, which depend on those before them, whole chunks are left out.
    """
    chained = header.are_points_compressed
    slack = 2 * np.abs(header.scales) + 1e-9 * np.abs(header.maxs)
    found = within_bounds(
        points,
        header.mins,
        header.maxs,
        slack,
        chained=chained,
        broken=chained and broken,
        unwritten=None if chained else np.asarray(header.offsets),
    )
    if not chained or found.value is None or found.value.all():
        return found
    (packing,) = header.vlrs.get("LasZipVlr")
    chunk = np.arange(len(points)) // lazrs.LazVlr(packing.record_data).chunk_size()
    bad = np.unique(chunk[~found.value])
    # Layers state their sizes, so that a chunk does not depend on the one before.
    return right(~np.isin(chunk, bad) if is_layered(header) else chunk < bad[0])


def _undamaged(
    header: laspy.LasHeader, points: Float64, kept: Bool, *, broken: bool
) -> tuple[Bool, str, list[str]]:
    """Return which points are not damaged, as far as can be told, a note, and what is of others."""
    found = _vouched(header, points, broken=broken)
    sure = found.accepted(InputError)
    faults, whole = [], some(len(points), "point")
    if damaged := len(points) - int(sure.sum()):
        faults.append(
            f"{damaged:,} of {whole} {are(damaged)} damaged: some lie outside the bounds that the "
            "header states"
        )
    if found.note or damaged or _reaches_ends(header):
        full = overflowed(points, np.asarray(header.scales), np.asarray(header.offsets))
        if count := int((full & kept & sure).sum()):
            sure = sure & ~full
            faults.append(
                f"{count:,} of {whole} {are(count)} damaged: a coordinate is the last that 32 bits "
                "hold, as it did not fit into the scale and the offset of the header"
            )
    return sure, found.note, faults


def _reaches_ends(header: laspy.LasHeader) -> bool:
    """Return whether the bounds say of no axis that its numbers stay within those of 32 bits."""
    scales, offsets = np.asarray(header.scales), np.asarray(header.offsets)
    with np.errstate(over="ignore"):
        ends = np.sort([end * scales + offsets for end in (-(2.0**31), 2.0**31 - 1)], axis=0)
    return not ((ends[0] < header.mins) & (header.maxs < ends[1])).all()


def _fitting_records(data: UInt8, begin: int, end: int, declared: int) -> int:
    """Return how many of the variable length records declared lie between two offsets."""
    count = 0
    while count < declared and begin + _VARIABLE_RECORD <= end:
        (length,) = _RECORD_LENGTH.unpack_from(data.data, begin)
        begin += _VARIABLE_RECORD + length
        if begin > end:
            break
        count += 1
    return count


def _next_file(header: laspy.LasHeader, data: UInt8) -> int | None:
    """Return the offset of another LAS file behind the points, or None where there is none."""
    begin = header.offset_to_point_data
    if header.are_points_compressed:
        begin = max(begin, points_end(header, data) % len(data))
    else:
        begin += header.point_count * header.point_format.size
    rest = data[begin:].tobytes()
    at = rest.find(_SIGNATURE)
    while 0 <= at <= len(rest) - _BEGINNING.size:
        *version, size, points = _BEGINNING.unpack_from(rest, at)
        if (*version,) in _VERSIONS and _SHORTEST_HEADER <= size <= points:
            return int(begin + at)
        at = rest.find(_SIGNATURE, at + 1)
    return None


def _whole_records(header: laspy.LasHeader, data: UInt8) -> int:
    """Return how many whole points there are in an uncompressed file."""
    begin, end = header.offset_to_point_data, len(data)
    records = header.start_of_first_evlr if header.number_of_evlrs else None
    for other in (records, header.start_of_waveform_data_packet_record):
        if other is not None and begin < other < end:
            end = other
    return int((end - begin) // header.point_format.size)


class _Overlaid(io.RawIOBase):
    """A LAS file whose header declares another number of variable length records.

    Parameters
    ----------
    file : binary file
        At its beginning.
    records : int
        The number of records.
    end : int, optional
        Offset at which it ends, and without which it is read with seeking; with it, without.
    packed : float
        Offset at which compressed points begin.
    """

    def __init__(
        self, file: BinaryIO, records: int, end: int | None = None, packed: float = math.inf
    ) -> None:
        self._file = file
        self._end = end
        self._packed = packed
        self._records = _COUNT.pack(records)

    def readable(self) -> bool:
        """Return True."""
        return True

    def seekable(self) -> bool:
        """Return whether it is not to be read one way."""
        return self._end is None

    def seek(self, offset: int, whence: int = 0, /) -> int:
        """Go to an offset."""
        if self._end is not None:
            raise io.UnsupportedOperation("seek")
        return self._file.seek(offset, whence)

    def tell(self) -> int:
        """Return the offset."""
        return self._file.tell()

    def readinto(self, buffer: Any, /) -> int:
        """Read into a buffer."""
        at = self._file.tell()
        size = len(buffer)
        if self._end is not None:
            size = min(size, self._end - at)
        if self._end is not None and at >= self._packed:
            # The decoder reads ahead; less and less of it, so that where it stopped tells much.
            size = min(size, max(_FLUSHED, (self._end - at) // 4))
        data = self._file.read(max(size, 0))
        for place, byte in enumerate(self._records, _COUNT_AT - at) if at < _COUNT_AT + 4 else ():
            if 0 <= place < len(data):
                data = data[:place] + bytes([byte]) + data[place + 1 :]
        buffer[: len(data)] = data
        return len(data)
