"""The reference system that the header of a LAS file states, as WKT or as GeoTIFF keys.

(ASPRS, LAS Specification 1.4 R15, "Coordinate Reference System VLRs"; OGC 19-008r4.)
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import laspy
from laspy.vlrs.known import GeoKeyDirectoryVlr, WktCoordinateSystemVlr

from mlscli.errors import UsageError, printable, shorten
from mlscli.maps.georeference import Georeference, named_crs
from mlscli.runtime.arrays import UInt8
from mlscli.words import some

_PROJECTED, _GEODETIC, _VERTICAL = 3072, 2048, 4096
# A key whose value stands in the key itself, and is a code of EPSG.
_HERE = 0
_CODES = range(1024, 32767)
# An extended record: whose, its number, and how long it is; and the most that is read of a text.
_EXTENDED, _LONGEST = struct.Struct("<2x16sHQ32x"), 1 << 20


def georeference_of(
    path: Path, header: laspy.LasHeader, data: UInt8
) -> tuple[Georeference | None, list[str]]:
    """Return the georeference of a file, and notes on what it states and cannot be used.

    Where there are WKT and keys, the flag of the header says which of them counts; WKT may stand
    behind the points, too. Coordinates are those of the system itself: the offset is 0.

    Parameters
    ----------
    path : Path
    header : laspy.LasHeader
    data : uint8 (bytes,)
        The whole file.
    """
    said = f"header of {path.name}"
    texts = [text for text in (*map(_text, header.vlrs), *_behind(header, data)) if text]
    keys = [vlr for vlr in header.vlrs if isinstance(vlr, GeoKeyDirectoryVlr)]
    notes: list[str] = []
    if texts and (header.global_encoding.wkt or not keys):
        try:
            return Georeference(named_crs(texts[0]), source=said), []
        except UsageError:
            notes.append(
                f"{path}: its header states a reference system that is none on Earth, "
                f"{shorten(printable(texts[0]), 40)!r}; `crs` says which it is"
            )
    elif keys:
        code = _code({key.id: key for vlr in keys for key in vlr.geo_keys})
        if code:
            return Georeference(code, source=said), []
        entries = some(sum(len(vlr.geo_keys) for vlr in keys), "GeoTIFF key")
        notes.append(
            f"{path}: its header states a reference system by {entries} without a code of EPSG; "
            "`crs` says which it is"
        )
    return None, notes


def _text(record: Any) -> str:
    """Return the text of a record of WKT; empty where it is another, or holds none."""
    if isinstance(record, WktCoordinateSystemVlr):
        return str(record.string).strip(" \0")
    # What is no UTF-8 is left as bytes.
    if record.record_id == WktCoordinateSystemVlr.official_record_ids()[0] and (
        record.user_id == WktCoordinateSystemVlr.official_user_id()
    ):
        return str(record.record_data_bytes().decode("latin-1")).strip(" \0")
    return ""


def _behind(header: laspy.LasHeader, data: UInt8) -> Iterator[str]:
    """Yield the texts of WKT in the extended records, which lie behind the points."""
    begin = header.start_of_first_evlr
    for _ in range(header.number_of_evlrs):
        if begin + _EXTENDED.size > len(data):
            return
        user, number, length = _EXTENDED.unpack_from(data.data, begin)
        begin += _EXTENDED.size
        if user.rstrip(b"\0").decode("latin-1") == WktCoordinateSystemVlr.official_user_id() and (
            number in WktCoordinateSystemVlr.official_record_ids()
        ):
            text = data[begin : begin + min(length, _LONGEST)].tobytes()
            try:
                yield text.decode().strip(" \0")
            except UnicodeDecodeError:
                yield text.decode("latin-1").strip(" \0")
        begin += length


def _code(keys: dict[int, Any]) -> str:
    """Return the code of GeoTIFF keys, with that of heights, if any; empty where there is none."""

    def value(name: int) -> int | None:
        key = keys.get(name)
        if key is None or key.tiff_tag_location != _HERE or key.value_offset not in _CODES:
            return None
        return int(key.value_offset)

    # One that is stated and has no code is of the file's own making, whatever it builds on.
    plane = value(_PROJECTED) if _PROJECTED in keys else value(_GEODETIC)
    if plane is None:
        return ""
    heights = value(_VERTICAL)
    return f"EPSG:{plane}" + (f"+{heights}" if heights else "")
