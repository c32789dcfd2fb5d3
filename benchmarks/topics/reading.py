"""Bags to points, beside rosbags alone, which does not decode the points.

600 PointCloud2 messages of 20,000 points as drivers send them, x, y, z and intensity in float32,
are written as a ROS 1 bag, a ROS 2 bag and an MCAP file. In one more bag of ROS 1, 20,000 messages
of three transforms move a hundred clouds of 1,000 points. `open_recording`, whose keyframes are
read, takes turns with rosbags' `AnyReader`, which only deserializes the messages. Each run is a new
process: ``python -m benchmarks.topics.reading READER BAG``.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from benchmarks.process import ran
from benchmarks.table import Row, Timer

MESSAGES, POINTS = 600, 20_000
TYPE = "sensor_msgs/msg/PointCloud2"
FLOAT32 = 7
TRANSFORMS, CLOUDS, SMALL = 20_000, 100, 1_000
LINKS = (("map", "odom"), ("odom", "base"), ("base", "lidar"))
INSTEAD = "rosbags' AnyReader"
KINDS = {"ROS 1": "flight.bag", "ROS 2 (SQLite)": "flight", "MCAP": "flight_mcap"}


def rows(timer: Timer) -> Iterator[Row]:
    """Yield for each kind of recording the rate and the peak of memory."""
    for kind, name in KINDS.items():
        with tempfile.TemporaryDirectory() as folder:
            bag = Path(folder, name)
            write(bag, kind)
            (mine, peak), (other, others) = _in_turn(bag, timer)
        what, amount = f"{kind}, {MESSAGES * POINTS:,} points", MESSAGES * POINTS / 1e6
        yield Row(what, amount / mine, "M points/s", INSTEAD, amount / other, 0.9)
        yield Row(f"{what}: peak of memory", peak, "MB", INSTEAD, others)
    with tempfile.TemporaryDirectory() as folder:
        bag = Path(folder, "transforms.bag")
        write_transforms(bag)
        (mine, _), (other, _) = _in_turn(bag, timer)
    amount = TRANSFORMS * len(LINKS) / 1e3
    what = f"{TRANSFORMS * len(LINKS):,} transforms, {CLOUDS} clouds"
    yield Row(what, amount / mine, "thousand transforms/s", INSTEAD, amount / other)


def _in_turn(bag: Path, timer: Timer) -> list[tuple[float, float]]:
    """Return for each reader the median time (s) and the median peak of memory (MB)."""
    runs: list[list[tuple[float, float]]] = [[] for _ in READERS]
    for _ in range(timer.repeats):
        for reader, each in zip(READERS, runs, strict=True):
            each.append(_measured(reader, bag, cpu=timer.cpu))
    return [(median(s for s, _ in each), median(most for _, most in each)) for each in runs]


def write(path: Path, kind: str) -> None:
    """Write the messages as a recording of a kind, one of `KINDS`."""
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


def write_transforms(path: Path) -> None:
    """Write clouds in the frame of a sensor, and the transforms that move them, as a ROS 1 bag."""
    store = get_typestore(Stores.ROS1_NOETIC)
    tf = "tf2_msgs/msg/TFMessage"
    store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", tf))
    types, geometry = store.types, "geometry_msgs/msg/"
    rng = np.random.default_rng(1)
    with Writer1(path) as writer:
        moves = writer.add_connection("/tf", tf, typestore=store)
        clouds = writer.add_connection("/cloud", TYPE, typestore=store)
        for number in range(TRANSFORMS):
            nanoseconds = number * 5_000_000
            cloud = message(types, 0, rng.uniform(-5, 5, (SMALL, 4)).astype("<f4"), is_ros1=True)
            header = cloud.header
            header.stamp.sec, header.stamp.nanosec = divmod(nanoseconds, 10**9)
            at = types[f"{geometry}Vector3"](x=number / 100, y=0.0, z=1.0)
            turn = types[f"{geometry}Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0)
            told = [
                types[f"{geometry}TransformStamped"](
                    header=replace(header, frame_id=parent),
                    child_frame_id=child,
                    transform=types[f"{geometry}Transform"](translation=at, rotation=turn),
                )
                for parent, child in LINKS
            ]
            content = store.serialize_ros1(types[tf](transforms=told), tf)
            writer.write(moves, nanoseconds, content)
            if number % (TRANSFORMS // CLOUDS) == 0:
                header.frame_id = LINKS[-1][1]
                writer.write(clouds, nanoseconds, store.serialize_ros1(cloud, TYPE))


def message(types: Any, number: int, points: Any, *, is_ros1: bool) -> Any:
    """Return a PointCloud2 message in the frame ``map``.

    Parameters
    ----------
    types : mapping
        Message classes of rosbags, by name.
    number : int
        Number of the message; its time is a tenth of it, in seconds.
    points : float32 (N, 4)
        x, y, z and intensity.
    is_ros1 : bool
        Whether its header has a sequence number.
    """
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
    """Read all keyframes; return how many points they have."""
    from mlscli import open_recording

    return sum(len(keyframe.points) for keyframe in open_recording(path).keyframes())


def by_anyreader(path: Path) -> int:
    """Deserialize all messages; return how many points they declare."""
    from rosbags.highlevel import AnyReader

    with AnyReader([path]) as reader:
        messages: Any = (
            reader.deserialize(data, connection.msgtype)
            for connection, _, data in reader.messages()
        )
        return sum(getattr(message, "width", 0) for message in messages)


READERS: dict[str, Callable[[Path], int]] = {"mls": by_mls, "AnyReader": by_anyreader}


def _measured(reader: str, bag: Path, *, cpu: bool) -> tuple[float, float]:
    """Return how long (s) a new process takes to read, and its peak of memory (MB)."""
    run = ran([sys.executable, "-m", "benchmarks.topics.reading", reader, str(bag)])
    seconds: list[float] = json.loads(run.output)
    return seconds[cpu], run.peak / 2**20


def _main(reader: str, bag: Path) -> None:
    """Read twice, as modules are imported late; print wall and CPU time (s) of the second pass."""
    READERS[reader](bag)
    begin, cpu = time.perf_counter(), time.process_time()
    found = READERS[reader](bag)
    spent = time.perf_counter() - begin, time.process_time() - cpu
    if found not in (MESSAGES * POINTS, CLOUDS * SMALL):
        raise SystemExit(f"{reader} found {found} points in {bag}")
    sys.stdout.write(json.dumps(spent))


if __name__ == "__main__":
    _main(sys.argv[1], Path(sys.argv[2]))
