"""Patches as points in PCD files (binary, version 0.7), as PCL and Open3D read them.

Coordinates are float32: PCL's points hold no others, and its readers skip fields of another type.
"""

from __future__ import annotations

import os

import numpy as np

from mlscli.io.writing.atomic import atomic_write, refuse_existing
from mlscli.io.writing.pointcloud import cloud_of
from mlscli.maps.surface_map import SurfaceMap


def write_pcd(
    path: str | os.PathLike[str],
    surface: SurfaceMap,
    *,
    filled: bool = False,
    artificial: bool = True,
    as_recorded: bool = False,
    overwrite: bool = False,
) -> tuple[int, float]:
    """Write the patches of a map as points with fields, as PCD.

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
        As `cloud_of`.
    OutputError
        Where the file exists and `overwrite` is False, or cannot be written.
    """
    refuse_existing(path, overwrite=overwrite)
    xyz, fields = cloud_of(surface, filled=filled, artificial=artificial, as_recorded=as_recorded)
    rounded = xyz.astype(np.float32)
    off = float(np.abs(rounded - xyz).max(initial=0.0))
    types = {name: np.dtype(np.float32) for name in "xyz"}
    types |= {name: values.dtype for name, values in fields.items()}
    rows = np.empty(
        len(xyz), dtype=[(name, kind.newbyteorder("<")) for name, kind in types.items()]
    )
    for axis, name in enumerate("xyz"):
        rows[name] = rounded[:, axis]
    for name, values in fields.items():
        rows[name] = values
    head = [
        "# .PCD v0.7 - Point Cloud Data file format",
        "VERSION 0.7",
        f"FIELDS {' '.join(types)}",
        f"SIZE {' '.join(str(kind.itemsize) for kind in types.values())}",
        f"TYPE {' '.join(kind.kind.upper() for kind in types.values())}",
        f"COUNT {' '.join('1' for _ in types)}",
        f"WIDTH {len(rows)}",
        "HEIGHT 1",
        "VIEWPOINT 0 0 0 1 0 0 0",
        f"POINTS {len(rows)}",
        "DATA binary",
        "",
    ]
    with atomic_write(path, overwrite=overwrite) as stream:
        stream.write("\n".join(head).encode("ascii"))
        stream.write(rows.tobytes())
    return len(rows), off
