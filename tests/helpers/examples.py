"""A recording of each format, with the same points in it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import laspy
import numpy as np
import zstandard

from mlscli.io.writing.flight_bag import write_bag
from mlscli.keyframes.keyframe import Keyframe
from mlscli.runtime.arrays import Float64

POINTS: Float64 = np.round(np.random.default_rng(1).uniform(-5, 5, (600, 3)), 3)
LINES = "".join(f"{x} {y} {z}\n" for x, y, z in POINTS.tolist())


def bag(kind: str) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        keyframes = [
            Keyframe(part, 1.0 + number, (0.0, 0.0, 1.0))
            for number, part in enumerate(np.split(POINTS, 6))
        ]
        attitudes = np.tile([0.0, 0.0, 0.0, 1.0], (6, 1))
        write_bag(folder / "flight", keyframes, attitudes, kind)  # type: ignore[arg-type]
        return folder / "flight"

    return write


def database(folder: Path) -> Path:
    (file,) = bag("ros2")(folder).glob("*.db3")
    return file


def compressed(folder: Path) -> Path:
    plain = bag("mcap")(folder)
    (folder / "packed").write_bytes(zstandard.compress(plain.read_bytes()))
    return folder / "packed"


def written(content: str | bytes) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        (folder / "some").write_bytes(content if isinstance(content, bytes) else content.encode())
        return folder / "some"

    return write


def las(folder: Path) -> Path:
    points = laspy.create(point_format=0)
    points.x, points.y, points.z = POINTS.T
    points.write(folder / "some.las")
    return (folder / "some.las").rename(folder / "some")


def colmap(folder: Path) -> Path:
    rows = [f"{n} {x} {y} {z} 0 0 0 0.1 1 0\n" for n, (x, y, z) in enumerate(POINTS.tolist())]
    (folder / "points3D.txt").write_text("# 3D point list\n" + "".join(rows))
    (folder / "images.txt").write_text("# Image list\n")
    return folder


def opensfm(folder: Path) -> Path:
    points = {str(n): {"coordinates": xyz} for n, xyz in enumerate(POINTS.tolist())}
    model = {"cameras": {}, "shots": {}, "points": points}
    return written(json.dumps([model]))(folder)


PLY = "ply\nformat ascii 1.0\nelement vertex 600\n" + "".join(
    f"property double {axis}\n" for axis in "xyz"
)
PCD = (
    "VERSION 0.7\nFIELDS x y z\nSIZE 8 8 8\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 600\nHEIGHT 1\n"
    "POINTS 600\nDATA ascii\n"
)

PTS = "".join(f"{line} -100 1 2 3\n" for line in LINES.splitlines())

PTX = "60\n10\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n" + "".join(
    f"{line} 0.5\n" for line in LINES.splitlines()
)

EXAMPLES: dict[str, Callable[[Path], Path]] = {
    "ROS 1 bag": bag("ros1"),
    "ROS 2 bag": bag("ros2"),
    "MCAP": bag("mcap"),
    "SQLite": database,
    "a file of a ROS 2 bag, compressed": compressed,
    "text": written(LINES),
    "PLY": written(f"{PLY}end_header\n{LINES}"),
    "PCD": written(f"{PCD}{LINES}"),
    "PTS": written(f"600\n{PTS}"),
    "PTX": written(PTX),
    "LAS": las,
    "COLMAP model": colmap,
    "OpenSfM": opensfm,
}
"""A recording of each format, that holds `POINTS` and no name that says what it is."""
