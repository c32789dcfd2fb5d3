"""Recordings to points: ``python benchmarks/reading.py`` (a minute).

600 PointCloud2 messages of 20,000 points as drivers send them, x, y, z and intensity in float32,
are written as a ROS 1 bag, a ROS 2 bag and an MCAP file. `open_recording` and its keyframes take
turns with rosbags' `AnyReader`, which deserializes the messages and does nothing with them. Each
run is a process of its own, whose peak of memory it tells (on Linux); the figures are medians.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

import click
import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

MESSAGES, POINTS = 600, 20_000
TYPE = "sensor_msgs/msg/PointCloud2"
FLOAT32 = 7
KINDS = {"ROS 1": "flight.bag", "ROS 2 (SQLite)": "flight", "MCAP": "flight_mcap"}


def write(path: Path, kind: str) -> None:
    """Write the messages as a recording of a kind."""
    is_ros1 = kind == "ROS 1"
    store = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.LATEST)
    plugin = StoragePlugin.MCAP if kind == "MCAP" else StoragePlugin.SQLITE3
    writer: Any = Writer1(path) if is_ros1 else Writer2(path, version=9, storage_plugin=plugin)
    serialize = store.serialize_ros1 if is_ros1 else store.serialize_cdr
    rng = np.random.default_rng(1)
    with writer:
        connection = writer.add_connection("/cloud", TYPE, typestore=store)
        for number in range(MESSAGES):
            points = rng.uniform(-50, 50, (POINTS, 4)).astype("<f4")
            content = message(store.types, number, points, is_ros1=is_ros1)
            writer.write(connection, number * 10**8, serialize(content, TYPE))


def message(types: Any, number: int, points: Any, *, is_ros1: bool) -> object:
    """Return a cloud of float32 (N, 4) in the map's frame."""
    stamp = types["builtin_interfaces/msg/Time"](sec=number // 10, nanosec=number % 10 * 10**8)
    sequence = {"seq": number} if is_ros1 else {}
    header = types["std_msgs/msg/Header"](**sequence, stamp=stamp, frame_id="map")
    field = types["sensor_msgs/msg/PointField"]
    return types[TYPE](
        header=header,
        height=1,
        width=len(points),
        fields=[
            field(name=name, offset=4 * place, datatype=FLOAT32, count=1)
            for place, name in enumerate(("x", "y", "z", "intensity"))
        ],
        is_bigendian=False,
        point_step=16,
        row_step=16 * len(points),
        data=points.reshape(-1).view(np.uint8),
        is_dense=True,
    )


def by_mls(path: Path) -> int:
    """Read the points of all keyframes."""
    from mlscli import open_recording

    return sum(len(keyframe.points) for keyframe in open_recording(path).keyframes())


def by_anyreader(path: Path) -> int:
    """Deserialize all messages."""
    from rosbags.highlevel import AnyReader

    with AnyReader([path]) as reader:
        messages: Any = (
            reader.deserialize(data, connection.msgtype)
            for connection, _, data in reader.messages()
        )
        return sum(message.width for message in messages)


READERS: dict[str, Callable[[Path], int]] = {"mls": by_mls, "AnyReader": by_anyreader}


def measure(reader: str, path: Path) -> tuple[float, float, float]:
    """Return seconds, seconds of the processor, and the peak of memory in MB, in a new process."""
    program = [sys.executable, __file__, "--reader", reader, "--path", str(path)]
    run = subprocess.run(program, capture_output=True, text=True, check=True)
    seconds, cpu, peak = map(float, run.stdout.split())
    return seconds, cpu, peak


def run_once(reader: str, path: Path) -> None:
    """Read once to load what is imported late, and once to measure."""
    READERS[reader](path)
    begin, cpu = time.perf_counter(), time.process_time()
    found = READERS[reader](path)
    spent = time.perf_counter() - begin, time.process_time() - cpu
    if found != MESSAGES * POINTS:
        raise SystemExit(f"{reader} found {found} points in {path}")
    # What getrusage tells would be the peak of the parent as well.
    status = Path("/proc/self/status").read_text()
    peak = int(status.split("VmHWM:")[1].split()[0]) / 1024
    click.echo(f"{spent[0]} {spent[1]} {peak}")


@click.command()
@click.option("--rounds", default=5, show_default=True)
@click.option("--reader", hidden=True)
@click.option("--path", hidden=True, type=click.Path(path_type=Path))
def main(rounds: int, reader: str | None, path: Path | None) -> None:
    """Print a row for each kind of recording."""
    if reader is not None and path is not None:
        run_once(reader, path)
        return
    click.echo(
        "| recording | MB | AnyReader, s (cpu) | mls, s (cpu) | ratio (cpu) | million points/s | "
        "peak, MB: AnyReader, mls |\n|:--|--:|--:|--:|--:|--:|--:|"
    )
    for kind, name in KINDS.items():
        with tempfile.TemporaryDirectory() as folder:
            bag = Path(folder) / name
            write(bag, kind)
            files = [bag] if bag.is_file() else list(bag.iterdir())
            size = sum(file.stat().st_size for file in files) / 1e6
            taken = defaultdict(list)
            for _ in range(rounds):
                for each in READERS:
                    taken[each].append(measure(each, bag))
        mls, other = (
            [median(column) for column in zip(*taken[each], strict=True)] for each in READERS
        )
        click.echo(
            f"| {kind} | {size:.0f} | {other[0]:.2f} ({other[1]:.2f}) | {mls[0]:.2f} "
            f"({mls[1]:.2f}) | {mls[0] / other[0]:.2f} ({mls[1] / other[1]:.2f}) | "
            f"{MESSAGES * POINTS / mls[0] / 1e6:.0f} | {other[2]:.0f}, {mls[2]:.0f} |"
        )


if __name__ == "__main__":
    main()
