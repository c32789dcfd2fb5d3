"""Patches as points in LAS files (1.4, point format 6), and compressed as LAZ, by laspy.

The fields are extra dimensions. Coordinates are whole multiples of a power of ten, a thousandth of
a cell or finer, from an offset near the least, and coarser only where that would exceed 32 bits.
"""

from __future__ import annotations

import io
import math

import numpy as np

from mlscli.errors import UsageError
from mlscli.io.writing.pointcloud import FIELDS, Cloud
from mlscli.runtime.arrays import Float64
from mlscli.version import __version__

# Multiples are int32.
_MOST = 2.0**31 - 1

# The day and the year of the file's creation, in the header; 0: not known.
_DATE = slice(90, 94)


def las_of(cloud: Cloud, *, compress: bool, wkt: str | None = None) -> tuple[bytes, Float64]:
    """Return the file of a cloud, and the coordinates as it holds them, float64 (N, 3).

    Parameters
    ----------
    cloud : Cloud
    compress : bool
        Whether it is LAZ.
    wkt : str, optional
        The text of the reference system that the coordinates are in.

    Raises
    ------
    UsageError
        Where there are no points: LAS has no bounds of nothing.
    """
    xyz = cloud.xyz
    if not len(xyz):
        raise UsageError("the map is empty; there is nothing to make a cloud of")

    import laspy

    low, span = np.floor(xyz.min(axis=0)), float(np.ptp(xyz, axis=0).max()) + 1.0
    exponent = math.floor(math.log10(cloud.cell_size / 1000) + 1e-9)
    scale = 10.0 ** max(exponent, math.ceil(math.log10(span / _MOST)))
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.scales, header.offsets = np.full(3, scale), low
    header.generating_software = f"mls {__version__}"
    header.add_extra_dims(
        [laspy.ExtraBytesParams(name, kind, what[:31]) for name, (kind, what) in FIELDS.items()]
    )
    if wkt is not None:
        # Points of format 6 have no other way; the flag says so.
        header.vlrs.append(laspy.vlrs.known.WktCoordinateSystemVlr(wkt))
        header.global_encoding.wkt = True
    points = laspy.LasData(header)
    points.x, points.y, points.z = xyz.T
    for name, values in cloud.fields.items():
        points[name] = values
    written = io.BytesIO()
    points.write(written, do_compress=compress)
    # laspy dates every file; the same map gives the same bytes on any day.
    written.getbuffer()[_DATE] = bytes(4)
    return written.getvalue(), np.asarray(points.xyz)
