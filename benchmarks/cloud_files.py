"""Files of points that benchmarks read: hills in UTM coordinates, rounded as survey data are."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import laspy
import numpy as np

from mlscli.runtime.arrays import Float64
from tests.helpers.pcds import pcd

STEP = 0.01
_BLOCK = 250_000


def survey(count: int) -> Float64:
    """Return the points of all these files, float64 (count, 3)."""
    rng = np.random.default_rng(1)
    x, y = rng.uniform(0, 400, (2, count))
    z = 300 + 20 * np.sin(x / 70) * np.cos(y / 90) + rng.normal(0, 0.05, count)
    points = np.column_stack((512_000 + x, 5_400_000 + y, z))
    return np.asarray(np.round(points / STEP) * STEP)


def write_text(
    path: Path, count: int, head: str = "", separator: str = " ", rest: str = ""
) -> None:
    """Write a point a line, with two decimals, after a head."""
    points = survey(count)
    form = separator.join(["%.2f"] * 3) + rest + "\n"
    with path.open("w", encoding="ascii") as file:
        file.write(head)
        for begin in range(0, count, _BLOCK):
            some = points[begin : begin + _BLOCK]
            file.write((form * len(some)) % tuple(some.ravel().tolist()))


def write_binary(path: Path, count: int, head: bytes) -> None:
    """Write three float64 a point, after a head."""
    path.write_bytes(head + survey(count).astype("<f8").tobytes())


def ply_head(form: str, count: int, names: Iterable[str] = "xyz") -> str:
    """Return the header of a PLY file whose points have these numbers of double precision."""
    properties = "".join(f"property double {name}\n" for name in names)
    return f"ply\nformat {form} 1.0\nelement vertex {count}\n{properties}end_header\n"


def pcd_file(form: str, count: int, body: bytes = b"", size: int = 8) -> bytes:
    """Return a PCD file of x, y and z, `size` bytes each, or its header alone."""
    return pcd(form, body, SIZE=f"{size} {size} {size}", WIDTH=count, POINTS=count)


def write_las(path: Path, count: int, *, compress: bool = False) -> None:
    """Write a LAS file, or with `compress` a LAZ file, of points of format 6."""
    header = laspy.LasHeader(point_format=6, version="1.4")
    points = survey(count)
    header.scales, header.offsets = np.full(3, STEP), np.floor(points.min(axis=0))
    las = laspy.LasData(header)
    las.x, las.y, las.z = points.T
    with path.open("wb") as file:
        las.write(file, do_compress=compress, laz_backend=laspy.LazBackend.Lazrs)
