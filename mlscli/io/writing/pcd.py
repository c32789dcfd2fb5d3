"""Patches as points in PCD files (binary, version 0.7), as PCL and Open3D read them.

Coordinates are float32: PCL's points hold no others, and its readers skip fields of another type.
"""

from __future__ import annotations

import numpy as np

from mlscli.io.writing.pointcloud import Cloud
from mlscli.runtime.arrays import Float64


def pcd_of(cloud: Cloud) -> tuple[bytes, Float64]:
    """Return the file of a cloud, and the coordinates as it holds them, float64 (N, 3)."""
    rounded = cloud.xyz.astype(np.float32)
    types = {name: np.dtype(np.float32) for name in "xyz"}
    types |= {name: values.dtype for name, values in cloud.fields.items()}
    rows = np.empty(
        len(rounded), dtype=[(name, kind.newbyteorder("<")) for name, kind in types.items()]
    )
    for axis, name in enumerate("xyz"):
        rows[name] = rounded[:, axis]
    for name, values in cloud.fields.items():
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
    return "\n".join(head).encode("ascii") + rows.tobytes(), rounded.astype(np.float64)
