"""What share of changed bytes is told in compressed PCDs and LAZ files, which have no checksum.

    python -m benchmarks.damage

Clouds are written as liblzf and the Point Cloud Library compress them, and as LAZ. In each, 300
bytes of the points, chosen at random, are changed at random, one at a time, and the file is read.
"""

from __future__ import annotations

import random
import struct
import sys
import tempfile
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path
from typing import NamedTuple

import laspy
import numpy as np
from scipy.spatial import cKDTree

from mlscli.errors import InputError
from mlscli.io.clouds.las import LasCloud
from mlscli.io.clouds.pcd import PcdCloud
from mlscli.io.clouds.pointfile import PointFile
from mlscli.runtime.arrays import Float64
from tests.helpers.pcds import encoded, pcd

_TIMES = 300
_LIBLZF, _PCL = (16, 5, 2), (13, 1, 1)


class _Written(NamedTuple):
    """A file.

    Attributes
    ----------
    name : str
        What it holds, for the table.
    original : float64 (N, 3)
        Its points.
    head, body, tail : bytes
        The compressed points, and what stands before and behind them.
    source : callable
        Opens such a file.
    """

    name: str
    original: Float64
    head: bytes
    body: bytes
    tail: bytes
    source: Callable[[Path], PointFile]


def main() -> None:
    """Print the table."""
    write = sys.stdout.write
    write("| cloud | told | moved unnoticed | points so moved, median | most |\n")
    write("|:--|--:|--:|--:|--:|\n")
    for file in (*map(_as_pcd, *zip(*_clouds(), strict=True)), *_laz_files()):
        told, moved = _damaged(file)
        median = f"{np.median(moved):.0f}" if moved else ""
        write(
            f"| {file.name} | {told / _TIMES:.0%} | {len(moved) / _TIMES:.0%} | {median} | "
            f"{max(moved, default='')} |\n"
        )


def _clouds() -> list[tuple[str, Float64, tuple[int, int, int]]]:
    """Return clouds, each with its name and encoder."""
    rng = np.random.default_rng(1)
    y, x = (axis.ravel() for axis in np.mgrid[-10:10:60j, -20:20:100j])
    scan = np.column_stack((x, y, 2 + np.sin(x / 3) + 0.5 * np.cos(y)))
    scan += rng.normal(0, 0.01, scan.shape)
    mixed = scan[rng.permutation(len(scan))]
    v, u = (axis.ravel() for axis in np.mgrid[-0.4:0.4:64j, -0.5:0.5:100j])
    depth = np.where((abs(u) < 0.2) & (abs(v) < 0.2), 1.2, 3.0) + rng.normal(0, 0.005, u.shape)
    image = np.column_stack((u * depth, v * depth, depth))
    sparse = rng.normal(0, 0.3, (12, 400, 3)) + rng.uniform(-10, 10, (12, 1, 3))
    sparse = sparse.reshape(-1, 3)
    far = rng.random(len(sparse)) < 0.02
    sparse[far] *= rng.uniform(1, 20, (int(far.sum()), 1))
    utm = np.array([512_000.0, 5_400_000.0, 300.0])
    return [
        ("voxel centres", np.round(scan / 0.25) * 0.25, _LIBLZF),
        ("airborne, in UTM", np.round(mixed, 2) + utm, _PCL),
        ("millimetres, in any order", np.round(mixed, 3), _LIBLZF),
        ("depth image with noise", image, _LIBLZF),
        ("scan with noise", scan, _LIBLZF),
        ("the same in any order", mixed, _LIBLZF),
        ("sparse, with outliers", sparse, _LIBLZF),
    ]


def _as_pcd(name: str, points: Float64, encoder: tuple[int, int, int]) -> _Written:
    columns = points.astype("<f4").T
    plain = columns.tobytes()
    body = encoded(plain, *encoder)
    sizes = struct.pack("<II", len(body), len(plain))
    head = pcd("binary_compressed", sizes, WIDTH=len(points), POINTS=len(points))
    return _Written(name, columns.T.astype(float), head, body, b"", PcdCloud)


def _laz_files() -> Iterator[_Written]:
    """Yield clouds as LAZ, in a format of either kind of compression."""
    clouds = {name: points for name, points, _ in _clouds()}
    for name in ("airborne, in UTM", "scan with noise"):
        for point_format in (1, 6):
            points = clouds[name]
            header = laspy.LasHeader(point_format=point_format)
            header.scales, header.offsets = np.full(3, 0.001), np.round(points.mean(axis=0))
            las = laspy.LasData(header)
            las.xyz = points
            memory = BytesIO()
            las.write(memory, do_compress=True)
            data = memory.getvalue()
            at = header.offset_to_point_data + 8
            (end,) = struct.unpack_from("<q", data, at - 8)
            yield _Written(
                f"LAZ, format {point_format}: {name}",
                np.asarray(las.xyz), data[:at], data[at:end], data[end:], LasCloud,
            )  # fmt: skip


def _damaged(file: _Written) -> tuple[int, list[int]]:
    """Return how many changes are told, and how many points each of the others moved, if any.

    Those count that lie farther from all points than a hundredth of the extent.
    """
    tree, cell = cKDTree(file.original), float(np.ptp(file.original, axis=0).max()) / 100
    dice, told, moved = random.Random(5), 0, list[int]()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "damaged"
        for _ in range(_TIMES):
            damaged = bytearray(file.body)
            damaged[dice.randrange(len(damaged))] ^= dice.randrange(1, 256)
            path.write_bytes(file.head + damaged + file.tail)
            source = file.source(path)
            try:
                found = np.concatenate([cloud.points for cloud in source.clouds()])
            except InputError:
                told += 1
                continue
            if source.losses or source.notes:
                told += 1
                continue
            wrong = ~np.isfinite(found).all(axis=1)
            distances, _ = tree.query(np.where(wrong[:, None], 1e30, found))
            moved += [int((distances > cell).sum())] * bool((distances > cell).any())
    return told, moved


if __name__ == "__main__":
    main()
