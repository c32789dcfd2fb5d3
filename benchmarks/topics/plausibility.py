"""What the checks of plausibility cost of reading, format by format: at most 3 %.

Each file is read to keyframes with the checks of `mlscli.io.plausibility` and, in turns, with
stand-ins that find everything right; the median of the ratios counts, by processor time. What finds
no fault but does the work itself, as counting epochs or leaving out beams without a range, stays.
"""

from __future__ import annotations

import math
import struct
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from functools import cache, partial
from pathlib import Path
from statistics import median
from typing import Any
from unittest.mock import patch

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from benchmarks.cloud_files import (
    STEP,
    pcd_file,
    ply_head,
    survey,
    write_binary,
    write_las,
    write_text,
)
from benchmarks.table import Row, Timer
from benchmarks.topics import reading
from mlscli import open_recording
from mlscli.io.plausibility.finding import Finding, right
from mlscli.io.plausibility.ranges import OUT_OF_RANGE, Measured
from mlscli.runtime.arrays import Float64
from tests.helpers.pcds import encoded

POINTS, LINES = 1_000_000, 300_000
LITTLE = "binary_little_endian"
SCANS, BEAMS = 5_000, 1_080
_BAGS = {"bag of ROS 1": "ROS 1", "bag of ROS 2": "ROS 2 (SQLite)", "MCAP": "MCAP"}


def rows(timer: Timer) -> Iterator[Row]:
    """Yield for each format what the checks add to the time of reading, in per cent."""
    with tempfile.TemporaryDirectory() as folder:
        for name, write in FORMATS.items():
            path = Path(folder, name.replace(" ", "_"))
            write(path)
            ratio = _ratio(path, max(timer.repeats, 3))
            yield Row(f"{name}: the checks' share of reading", 100 * (ratio - 1), "%", most=3)


def _ratio(path: Path, repeats: int) -> float:
    """Return how many times as long reading takes with the checks as without."""
    _seconds(path)
    ratios = []
    for turn in range(repeats):
        with_checks = _seconds(path) if turn % 2 else 0.0
        with ExitStack() as stack:
            for target, stand_in in STAND_INS.items():
                stack.enter_context(patch(target, stand_in))
            without = _seconds(path)
        ratios.append((with_checks or _seconds(path)) / without)
    return median(ratios)


def _seconds(path: Path) -> float:
    begin = time.process_time()
    for keyframe in open_recording(path).keyframes():
        assert len(keyframe.points)
    return time.process_time() - begin


def _first(value: Any, *_: Any, **__: Any) -> Finding[Any]:
    """Return that what is given is right."""
    return right(value)


def _all(points: Float64, *_: Any, **__: Any) -> Finding[Any]:
    """Return that all points are right."""
    return right(_true(len(points)))


@cache
def _true(count: int) -> Any:
    return np.ones(count, dtype=np.bool_)


def _ranged(ranges: Float64, low: float, high: float) -> Finding[Any]:
    """Return the beams within the bounds that a scan states, the upper one left out."""
    beams = (ranges >= low) & (ranges < high)
    hits = int(np.count_nonzero(beams))
    out = 0 if hits == len(ranges) else int(np.count_nonzero(np.isfinite(ranges))) - hits
    return right(Measured(np.where(beams, ranges, np.nan), ((OUT_OF_RANGE, out),) if out else ()))


STAND_INS: dict[str, Callable[..., Any]] = {
    "mlscli.io.clouds.las.within_bounds": _all,
    "mlscli.io.clouds.pcdcompressed.odd_exponents": lambda *_: None,
    "mlscli.io.clouds.pcdcompressed.repeats_as_encoded": lambda *_: right(True),
    "mlscli.io.clouds.pointfile.are_lengths": _first,
    "mlscli.io.clouds.text.in_seconds": _first,
    "mlscli.io.messages.laserscan.angles_of": lambda count, low, _, step: right(
        low + np.arange(count, dtype=np.float64) * step
    ),
    "mlscli.io.messages.laserscan.measured": _ranged,
    "mlscli.io.messages.pointcloud2.layout_of": lambda _, stated, __: right(stated),
    "mlscli.io.messages.pointcloud2.looks_right": lambda *_: True,
    "mlscli.io.reading.frames.of_one_body": _first,
    "mlscli.io.reading.placing.same_clock": lambda *_: right(0.0),
    "mlscli.io.reading.rivals.alternate": lambda _: False,
    "mlscli.io.reading.rivals.of_one_body": _first,
    "mlscli.io.reading.sieve.lost_step": lambda _: 0.0,
    "mlscli.io.reading.sieve.pile": lambda _: right(0),
    "mlscli.io.reading.sieve.without_zeros": _all,
}
"""What takes the place of each check."""


def _compressed(path: Path, *, voxel: float = STEP) -> None:
    """Write points in the order in which they came, or the centres of their voxels in rows."""
    points = survey(POINTS)
    if voxel > STEP:
        points = np.round((points - points.min(axis=0)) / voxel) * voxel
        points = points[np.lexsort(points.T[:2])]
    plain = points.astype("<f4").T.tobytes()
    body = encoded(plain, 13, 1, 1)
    packed = struct.pack("<II", len(body), len(plain)) + body
    path.write_bytes(pcd_file("binary_compressed", POINTS, packed, 4))


def _scans(path: Path, *, nothing: float = math.inf) -> None:
    """Write laser scans in the frame of the map; a fifth of their beams have hit nothing."""
    store = get_typestore(Stores.LATEST)
    types: Any = store.types
    rng = np.random.default_rng(1)
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/scan", "sensor_msgs/msg/LaserScan", typestore=store)
        for number in range(SCANS):
            stamp = types["builtin_interfaces/msg/Time"](sec=number // 10, nanosec=number % 10)
            ranges = rng.uniform(0.5, 29, BEAMS)
            ranges[BEAMS // 5 : 2 * BEAMS // 5] = nothing
            message = types["sensor_msgs/msg/LaserScan"](
                header=types["std_msgs/msg/Header"](stamp=stamp, frame_id="map"),
                angle_min=-2.35, angle_max=-2.35 + (BEAMS - 1) * 0.00436, angle_increment=0.00436,
                time_increment=0.0, scan_time=0.1, range_min=0.1, range_max=30.0,
                ranges=ranges.astype("<f4"),
                intensities=np.empty(0, "<f4"),
            )  # fmt: skip
            data = store.serialize_cdr(message, "sensor_msgs/msg/LaserScan")
            writer.write(connection, number * 10**8, data)


FORMATS: dict[str, Callable[[Path], None]] = {
    "text": partial(write_text, count=LINES),
    "text with a header": partial(
        write_text, count=LINES, head="x,y,z,t\n", separator=",", rest=",1.5"
    ),
    "PTS": partial(write_text, count=LINES, head=f"{LINES}\n"),
    "PTX": partial(
        write_text,
        count=LINES,
        head=f"{LINES}\n1\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n",
        rest=" 0.5",
    ),
    "PLY of text": partial(write_text, count=LINES, head=ply_head("ascii", LINES)),
    "PLY": partial(write_binary, count=POINTS, head=ply_head(LITTLE, POINTS).encode()),
    "PCD of text": partial(write_text, count=LINES, head=pcd_file("ascii", LINES).decode()),
    "PCD": partial(write_binary, count=POINTS, head=pcd_file("binary", POINTS)),
    "PCD compressed": _compressed,
    "PCD compressed of voxels": partial(_compressed, voxel=0.25),
    "LAS": partial(write_las, count=POINTS),
    "LAZ": partial(write_las, count=POINTS, compress=True),
    **{name: partial(reading.write, kind=kind) for name, kind in _BAGS.items()},
    "laser scans in MCAP": _scans,
    "laser scans, nothing hit at range_max": partial(_scans, nothing=30.0),
}
"""How a file of each format is written."""
