"""Check what a LAZ file states of its chunks, for which lazrs allocates memory unchecked.

(M. Isenburg, LASzip: lossless compression of LiDAR data, 2013, and its revision for LAS 1.4.)
"""

from __future__ import annotations

import struct
from typing import Any

import lazrs
import numpy as np

from mlscli.runtime.arrays import UInt8

# Where the items of a point begin in LASzip's record: type, size and version of each.
_ITEMS = 34
_ITEM = struct.Struct("<3H")
_TABLE_PLACE = struct.Struct("<q")
_TABLE_HEAD = struct.Struct("<II")
# Bytes at the end of a chunk.
_FLUSHED = 4
# Formats from 6 on are compressed in layers: those of coordinates and flags, then of each item.
_LAYERED = 6
_LAYERS = {6: 9, 7: 10, 8: 11, 9: 10, 10: 12}


def check_packing(header: Any, packing: Any) -> None:
    """Refuse points that are not compressed as their format says.

    Parameters
    ----------
    header : laspy.LasHeader
    packing : laspy VLR
        The record of LASzip.

    Raises
    ------
    ValueError
        The compressed items of a point differ from those of the format.
    """
    usual = lazrs.LazVlr.new_for_compression(
        header.point_format.id, header.point_format.num_extra_bytes
    )
    if _items(packing.record_data) != _items(usual.record_data()):
        raise ValueError("the compressed points have not the layout of their format")


def needs_table(header: Any, packing: Any, data: UInt8) -> bool:
    """Return whether chunks differ in size, so that the table of chunks at the end is needed.

    Parameters
    ----------
    header : laspy.LasHeader
    packing : laspy VLR
        The record of LASzip.
    data : uint8 (bytes,)
        The file.

    Raises
    ------
    ValueError
        The table is needed, and is missing or lists more chunks than there can be.
    """
    if not lazrs.LazVlr(packing.record_data).uses_variable_size_chunks():
        return False
    (place,) = _TABLE_PLACE.unpack_from(data.data, header.offset_to_point_data)
    if place == -1:
        (place,) = _TABLE_PLACE.unpack_from(data.data, len(data) - _TABLE_PLACE.size)
    if not 0 <= place <= len(data) - _TABLE_HEAD.size:
        raise ValueError("the table of its chunks is missing")
    _, chunks = _TABLE_HEAD.unpack_from(data.data, place)
    if chunks > len(data):
        raise ValueError(f"the table of its chunks lists {chunks:,} in {len(data):,} bytes")
    return True


def readable_points(header: Any, data: UInt8) -> int:
    """Return how many points to try to read: in layered formats, those of whole chunks.

    These are more than the header declares where all chunks, as far as their table, hold more.
    """
    count: int = header.point_count
    if not is_layered(header):
        return count
    layers = _LAYERS[header.point_format.id] + header.point_format.num_extra_bytes
    # A chunk is its first point, the number of its points, the sizes of the layers, and the layers.
    sizes = np.dtype("<u4")
    at, end, whole = header.offset_to_point_data + _TABLE_PLACE.size, points_end(header, data), 0
    while at < end:
        begin = at + header.point_format.size
        at = begin + sizes.itemsize * (1 + layers)
        if at > end:
            break
        points, *lengths = data[begin:at].view(sizes).tolist()
        at += sum(lengths)
        if at > end:
            break
        whole += points
    is_all = at == end < len(data)
    return whole if is_all else min(whole, count)


def points_end(header: Any, data: UInt8) -> int:
    """Return the offset at which points end: compressed ones, at the table of their chunks."""
    at = header.offset_to_point_data + _TABLE_PLACE.size
    if not header.are_points_compressed or at > len(data):
        return len(data)
    (place,) = _TABLE_PLACE.unpack_from(data.data, at - _TABLE_PLACE.size)
    return place if at <= place <= len(data) else len(data)


def invented_points(header: Any, data: UInt8, count: int) -> int:
    """Return how many of the last points may be made of no bits, where reading more of them fails.

    The encoder ends a chunk with up to four bytes that say nothing, and of these the decoder may
    make points beyond the last one. In a file that was cut there are none, and in formats from 6
    on chunks state how many points they hold.
    """
    begin, end = header.offset_to_point_data + _TABLE_PLACE.size, points_end(header, data)
    if is_layered(header) or end in (begin, len(data)):
        return 0
    return min(count, 1 + int(_FLUSHED * count // (end - begin)))


def is_layered(header: Any) -> bool:
    """Return whether points are compressed in layers, so that each chunk states its size."""
    layered: bool = header.point_format.id >= _LAYERED
    return layered


def _items(packing: bytes) -> list[tuple[int, int]]:
    """Return the type and size of each item."""
    return [(type_, size) for type_, size, _ in _ITEM.iter_unpack(packing[_ITEMS:])]
