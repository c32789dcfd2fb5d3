"""Patches as points in LAS files (1.4, point format 6), and compressed as LAZ, by laspy.

The fields are extra dimensions. Coordinates are whole multiples of a power of ten, a thousandth of
a cell or finer, from an offset near the least, and coarser only where that would exceed 32 bits.
"""

from __future__ import annotations

import io
import math
import os
from pathlib import Path

import numpy as np

from mlscli.errors import UsageError
from mlscli.io.writing.atomic import atomic_write, refuse_existing
from mlscli.io.writing.pointcloud import FIELDS, cloud_of
from mlscli.maps.surface_map import SurfaceMap
from mlscli.version import __version__

# Multiples are int32.
_MOST = 2.0**31 - 1

# The day and the year of the file's creation, in the header; 0: not known.
_DATE = slice(90, 94)


def write_las(
    path: str | os.PathLike[str],
    surface: SurfaceMap,
    *,
    filled: bool = False,
    artificial: bool = True,
    as_recorded: bool = False,
    overwrite: bool = False,
) -> tuple[int, float]:
    """Write the patches of a map as points with fields, as LAS; as LAZ where the name ends so.

    Parameters
    ----------
    path
    surface : SurfaceMap
    filled, artificial, as_recorded : bool
        As `mlscli.io.writing.pointcloud.cloud_of` has them.
    overwrite : bool

    Returns
    -------
    points : int
        How many there are.
    off : float
        By how much a coordinate is rounded at most, in the unit of the map.

    Raises
    ------
    InputError, UsageError
        As `cloud_of`; and where the map is empty: LAS has no bounds of nothing.
    OutputError
        Where the file exists and `overwrite` is False, or cannot be written.
    """
    refuse_existing(path, overwrite=overwrite)
    xyz, fields = cloud_of(surface, filled=filled, artificial=artificial, as_recorded=as_recorded)
    if not len(xyz):
        raise UsageError("the map is empty; there is nothing to make a cloud of")

    import laspy

    low, span = np.floor(xyz.min(axis=0)), float(np.ptp(xyz, axis=0).max()) + 1.0
    exponent = math.floor(math.log10(surface.cell_size / 1000) + 1e-9)
    scale = 10.0 ** max(exponent, math.ceil(math.log10(span / _MOST)))
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.scales, header.offsets = np.full(3, scale), low
    header.generating_software = f"mls {__version__}"
    header.add_extra_dims(
        [laspy.ExtraBytesParams(name, kind, what[:31]) for name, (kind, what) in FIELDS.items()]
    )
    cloud = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = xyz.T
    for name, values in fields.items():
        cloud[name] = values
    written = io.BytesIO()
    cloud.write(written, do_compress=Path(path).suffix.lower() == ".laz")
    # laspy dates every file; the same map gives the same bytes on any day.
    written.getbuffer()[_DATE] = bytes(4)
    with atomic_write(path, overwrite=overwrite) as stream:
        stream.write(written.getbuffer())
    return len(xyz), float(np.abs(np.asarray(cloud.xyz) - xyz).max())
