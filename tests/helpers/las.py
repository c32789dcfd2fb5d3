"""LAS and LAZ files written by laspy, and their points parsed by the format's description."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import laspy
import numpy as np

from mlscli.io.clouds.las import LasCloud
from mlscli.runtime.arrays import Float64

OFFSET = (572273.0, 4498560.0, -100.0)


def write(path: Path, count: int = 1000, point_format: int = 3, **dimensions: Any) -> Path:
    """Write points of UTM coordinates, to the millimetre."""
    version = "1.2" if point_format < 4 else "1.3" if point_format < 6 else "1.4"
    header = laspy.LasHeader(point_format=point_format, version=version)
    header.scales, header.offsets = np.full(3, 0.001), np.array(OFFSET)
    las = laspy.LasData(header)
    rng = np.random.default_rng(1)
    las.X, las.Y, las.Z = (rng.integers(-(10**6), 10**6, count) for _ in "xyz")
    for name, values in dimensions.items():
        if name not in las.point_format.dimension_names:
            las.add_extra_dim(laspy.ExtraBytesParams(name, np.asarray(values).dtype))
        las[name] = values
    las.write(path)
    return path


def parsed(path: Path) -> Float64:
    """Return the points of an uncompressed file by the format's description."""
    content = path.read_bytes()
    begin, _, _, size, legacy = struct.unpack_from("<IIBHI", content, 96)
    scale, offset = struct.unpack_from("<3d", content, 131), struct.unpack_from("<3d", content, 155)
    count = struct.unpack_from("<Q", content, 247)[0] if content[25] == 4 else legacy
    rows = [struct.unpack_from("<3i", content, begin + size * k) for k in range(count)]
    points: Float64 = np.array(rows) * scale + offset
    return points


def read(path: Path) -> tuple[list[Any], list[str]]:
    """Return the points of each keyframe, and what is lost."""
    source = LasCloud(path)
    return [cloud.points.tolist() for cloud in source.clouds()], list(source.losses)
