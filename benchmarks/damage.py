"""What share of changed bytes is told in compressed PCDs, which have no checksum.

    python -m benchmarks.damage

Clouds are written as liblzf and the Point Cloud Library compress them. In each, 300 bytes chosen at
random are changed at random, one at a time, and the file is read.
"""

from __future__ import annotations

import random
import struct
import sys
import tempfile
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from mlscli.errors import InputError
from mlscli.io.clouds.pcd import PcdCloud
from mlscli.runtime.arrays import Float64
from tests.helpers.pcds import encoded, pcd

_TIMES = 300
_LIBLZF, _PCL = (16, 5, 2), (13, 1, 1)


def main() -> None:
    """Print the table."""
    write = sys.stdout.write
    write("| cloud | told | moved unnoticed | points so moved, median | most |\n")
    write("|:--|--:|--:|--:|--:|\n")
    for name, points, encoder in _clouds():
        told, moved = _damaged(points, encoder)
        median = f"{np.median(moved):.0f}" if moved else ""
        write(
            f"| {name} | {told / _TIMES:.0%} | {len(moved) / _TIMES:.0%} | {median} | "
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


def _damaged(points: Float64, encoder: tuple[int, int, int]) -> tuple[int, list[int]]:
    """Return how many changes are told, and how many points each of the others moved, if any.

    Those count that lie farther from all points than a hundredth of the extent.
    """
    columns = points.astype("<f4").T
    plain = columns.tobytes()
    body = encoded(plain, *encoder)
    original = columns.T.astype(float)
    tree, cell = cKDTree(original), float(np.ptp(original, axis=0).max()) / 100
    dice, told, moved = random.Random(5), 0, list[int]()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "damaged.pcd"
        for _ in range(_TIMES):
            damaged = bytearray(body)
            damaged[dice.randrange(len(body))] ^= dice.randrange(1, 256)
            packed = struct.pack("<II", len(body), len(plain)) + damaged
            entries = {"WIDTH": len(points), "POINTS": len(points)}
            path.write_bytes(pcd("binary_compressed", packed, **entries))
            source = PcdCloud(path)
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
