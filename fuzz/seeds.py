"""Small whole files of every kind, from which changes begin, by the makers that there are.

A maker writes each seed into a folder of its own, under the names that the target's commands have.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import zstandard

import mlscli
from fuzz.targets import TARGETS, Seed
from mlscli.config import preset_text
from mlscli.keyframes.keyframe import Keyframe
from mlscli.maps.surface_map import SurfaceMap
from tests.helpers import craft
from tests.helpers.bags import Sent, Told, write_bag, write_told
from tests.helpers.broken import Sent as SentBytes
from tests.helpers.broken import write_mcap
from tests.helpers.examples import EXAMPLES, LINES, POINTS
from tests.helpers.foxglove import message
from tests.helpers.las import write as write_las
from tests.helpers.maps import Patch, map_of, random_map
from tests.helpers.pcds import packed, pcd
from tests.helpers.plys import ply
from tests.helpers.ros import vector
from tests.io.clouds import test_colmap, test_opensfm
from tests.io.clouds.test_trajectory import FORMATS as TRAJECTORIES
from tests.io.clouds.test_trajectory import UNTIMED
from tests.io.messages.test_hostile_messages import FOXGLOVE
from tests.io.messages.test_markers import ARRAY, SPHERE_LIST, marker
from tests.scenes.test_sceneio import SHED

Maker = Callable[[Path], Iterator[Path]]
"""Writes seeds below a folder, and yields the file or folder of each."""


def seeds_of(target: str, folder: Path) -> list[Seed]:
    """Return the seeds of a target, made below a new folder."""
    folder.mkdir()
    name = TARGETS[target].damaged
    beside = _beside() if TARGETS[target].has_others else {}
    return [Seed.read(path, name, beside) for path in MAKERS[target](folder)]


@cache
def _beside() -> dict[str, bytes]:
    """Return what commands are given beside the file that is changed."""
    return {"cloud.txt": _timed().encode(), "good.npz": _written(_flown())}


def _timed() -> str:
    """Return a text cloud with times, so that a route places its points."""
    rows = np.round(np.random.default_rng(3).uniform(0, 3, (150, 3)) * (1, 1, 0.1), 3).tolist()
    lines = [f"{x} {y} {z} {n // 25} {1403636580 + n / 100}" for n, (x, y, z) in enumerate(rows)]
    return "\n".join(["x y z keyframe t", *lines, ""])


def _flown() -> SurfaceMap:
    """Return a map of blocks and a bridge over them, with a route and free space."""
    rng = np.random.default_rng(1)
    # The sizes are those of `random_map`, so that the two go together.
    sizes = ["map.cell_size=0.5", "map.gap_size=0.75", "map.thickness=0.25", "map.free_space=true"]
    builder = mlscli.MapBuilder(mlscli.load_parameters(None, sizes))
    heights = rng.uniform(0, 2, (4, 4))
    for x in range(8):
        xy = rng.uniform(0, 8, (300, 2))
        z = heights[tuple((xy // 2).astype(int).T)] + rng.normal(0, 0.02, 300)
        z[(abs(xy[:, 1] - 4) < 0.5) & (rng.random(300) < 0.5)] = 4
        builder.add(Keyframe(np.column_stack((xy, z)), float(x), (float(x), 4.0, 7.0)))
    return builder.finish()


def _written(surface: SurfaceMap) -> bytes:
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        mlscli.write_map(f"{folder}/map.npz", surface)
        return Path(folder, "map.npz").read_bytes()


def _new(folder: Path) -> Path:
    fresh = folder / str(len([*folder.iterdir()]))
    fresh.mkdir()
    return fresh


def _files(contents: Mapping[str, str] | Sequence[str | bytes]) -> Maker:
    """Return a maker of a file for each content."""
    held = list(contents.values()) if isinstance(contents, Mapping) else contents

    def make(folder: Path) -> Iterator[Path]:
        for content in held:
            path = _new(folder) / "file"
            path.write_bytes(content if isinstance(content, bytes) else content.encode())
            yield path

    return make


def _example(name: str, *more: Maker) -> Maker:
    def make(folder: Path) -> Iterator[Path]:
        yield EXAMPLES[name](_new(folder))
        for maker in more:
            yield from maker(folder)

    return make


def _told() -> list[list[Told]]:
    """Return recordings of many types: clouds, markers or scans in frames that move, and poses."""
    frames = [*craft.moving(), craft.transform(0, "base_link", "lidar", craft.MOUNT, stays=True)]
    frames += [craft.odometry(k, craft.FIRST) for k in range(4)]
    clouds = [craft.cloud(k, "lidar", POINTS[:40] + k) for k in range(4)]
    points = [vector(*point) for point in POINTS[:20].tolist()]
    held = marker(SPHERE_LIST, points=points) | {"header": craft.head(1, "map")}
    scan = {
        "header": craft.head(1, "lidar"),
        "angle_min": -1.0,
        "angle_max": 1.0,
        "angle_increment": 0.5,
        "range_max": 20.0,
        "ranges": [1.0, 2.0, 3.0, 2.0, 1.0],
    }
    time = craft.log_time(1)
    markers = [Told("/markers", ARRAY, {"markers": [held]}, time)]
    scans = [Told("/scan", "sensor_msgs/msg/LaserScan", scan, time)]
    return [
        sorted([*frames, *each], key=lambda told: told.log_time)
        for each in (clouds, markers, scans)
    ]


def _messages(kind: str) -> Maker:
    def make(folder: Path) -> Iterator[Path]:
        clouds = [Sent(POINTS[k::20] + k, k * 10**9, labels=[k] * 30) for k in range(3)]
        yield write_bag(_new(folder) / "bag", clouds, kind)
        for told in _told():
            yield write_told(_new(folder) / "bag", told, kind)

    return make


def _packed_ros1(folder: Path) -> Iterator[Path]:
    for compression in ("lz4", "bz2"):
        yield write_told(_new(folder) / "bag", _told()[0], "ros1", compression)


def _packed_mcap(folder: Path) -> Iterator[Path]:
    for spelling in ("protobuf", "json"):
        data = POINTS[:40].astype("<f4").tobytes()
        content = {**FOXGLOVE["PointCloud"], "frame_id": "map", "data": data}
        cloud = message(spelling, "PointCloud", content)
        sent = [SentBytes("/cloud", k * 10**9, bytes(cloud.data)) for k in range(5)]
        schema: dict[str, Any] = {
            "encoding": spelling,
            "schema": cloud.channel.schema_encoding,
            "type_": cloud.channel.type,
            "definition": cloud.channel.schema,
        }
        for compression in ("none", "lz4", "zstd"):
            path = _new(folder) / "file"
            yield write_mcap(path, sent, compression, **schema, enable_crcs=False)


def _plys() -> list[bytes]:
    axes = [f"property float {axis}" for axis in "xyz"]
    faces = ["element face 2", "property list uchar int vertex_indices"]
    body = POINTS[:50].astype("<f4").tobytes() + struct.pack("<B3iB3i", 3, 0, 1, 2, 3, 2, 3, 4)
    big = POINTS[:50].astype(">f4").tobytes()
    colours = "".join(f"{line} 1 2 3\n" for line in LINES.splitlines()[:50])
    return [
        ply("binary_little_endian", "element vertex 50", *axes, *faces, body=body),
        ply("binary_big_endian", "element vertex 50", *axes, body=big),
        ply("ascii", "comment a", "element vertex 50", *axes, "property uchar red",
            "property uchar green", "property uchar blue", body=colours.encode()),
    ]  # fmt: skip


def _pcds() -> list[bytes]:
    points = POINTS[:50].astype("<f4")
    sizes = {"WIDTH": 50, "POINTS": 50}
    columns = [np.ascontiguousarray(points[:, axis]) for axis in range(3)]
    return [
        pcd("binary", points.tobytes(), **sizes),
        pcd("binary_compressed", packed(columns), **sizes),
    ]


def _las(folder: Path) -> Iterator[Path]:
    for name, version in (("a.las", 1), ("b.las", 6), ("a.laz", 3), ("b.laz", 7)):
        yield write_las(_new(folder) / name, 60, version)


def _colmap(folder: Path) -> Iterator[Path]:
    for write in (test_colmap.write_text, test_colmap.write_binary):
        yield write(_new(folder), *test_colmap.many())


def _opensfm(folder: Path) -> Iterator[Path]:
    for version in (0, 2):
        yield test_opensfm.write(_new(folder), version=version).parent


def _compressed(folder: Path) -> Iterator[Path]:
    bag = EXAMPLES["ROS 2 bag"](_new(folder))
    (file,) = bag.glob("*.db3")
    path = _new(folder) / "file"
    path.write_bytes(zstandard.compress(file.read_bytes()))
    yield path


_TEXTS: list[str | bytes] = [
    "".join(f"{n % 3} {n // 3 % 3} {n % 2 * 2}\n" for n in range(18)),
    *(_timed(), "x,y,z\n" + LINES[:2000].replace(" ", ","), LINES[:1500].replace(".", ",")),
    *("\ufeff# x y z r g b\n" + LINES[:500].replace("\n", " 1 2 3\n"),),
    *("x;y;z\n" + LINES[:800].replace(" ", ";"), LINES[:900].encode("utf-16")),
]


def _maps(folder: Path) -> Iterator[Path]:
    rng = np.random.default_rng(7)
    few = map_of(
        [Patch(0, 0, 0.25, 0.0, 0, 3), Patch(0, 1, 2.0, 0.5, 0, 9), Patch(3, 1, 1.0, 0, 1, 0)]
    )
    for surface in (_flown(), random_map(rng, fill=0.9), few):
        path = _new(folder) / "map.npz"
        mlscli.write_map(path, surface)
        yield path


_CONFIGURATIONS = [
    *(preset_text(name) for name in ("default", "thesis", "plain")),
    "map: {cell_size: 0.5, free_space: true}\npipeline:\n"
    "  - median: {nb_radius: 2 cells}\n  - plaster\n",
    "vehicle: {width: 0.6, height: 0.4}\nmap:\n  cell_size: auto\nmode: sequential\n",
]

_SCENES = [
    SHED,
    "- horizontal: {position: [0, 0, 0], size: [3, 3], texture: 0.8}\n",
    "surfaces:\n- vertical: {position: [0, 1, 0.75], size: [3, 1.5]}\n"
    "legs:\n- {start: [-3, -1, 0.7], end: [3, -1, 0.7], tilt: 75, yaw: 90}\n",
]

_LEGS = [
    "- {start: [0, 0, 2], end: [3, 3, 2], tilt: 30, yaw: 0}\n- {start: [3, 3, 2], end: [0, 3, 2]}\n"
]

_EYE = np.eye(4)
_TRANSFORMS = [
    json.dumps({"transform": _EYE.tolist(), "frame_id": "map"}),
    json.dumps({"transform": (np.diag((2.0, 2, 2, 1)) + _EYE * 0).tolist(), "frame_id": "site",
                "turn": _EYE.tolist(), "from": _EYE.tolist()}, indent=1),
]  # fmt: skip

_TIMES = [
    json.dumps({"rows": [{"size": 20, "batches": 160, "seconds": 0.012, "thesis": 0.01}],
                "first_call": 0.9, "exponent": None}, indent=2),
]  # fmt: skip

_WAYS = [*TRAJECTORIES.values(), *UNTIMED.values(), "x,y,z\n0,2,1.5\n3,2,1.5\n", "0 2 1.5\n3 2 1\n"]

READERS: dict[str, tuple[str, tuple[Maker, ...]]] = {
    "ros1": ("ROS 1 bag", (_messages("ros1"), _packed_ros1)),
    "ros2": ("ROS 2 bag", (_messages("ros2"),)),
    "sqlite": ("SQLite", ()),
    "mcap": ("MCAP", (_messages("mcap"), _packed_mcap)),
    "compressed": ("a file of a ROS 2 bag, compressed", (_compressed,)),
    "text": ("text", (_files(_TEXTS),)),
    "ply": ("PLY", (_files(_plys()),)),
    "pcd": ("PCD", (_files(_pcds()),)),
    "pts": ("PTS", ()),
    "ptx": ("PTX", ()),
    "las": ("LAS", (_las,)),
    "colmap": ("COLMAP model", (_colmap,)),
    "opensfm": ("OpenSfM", (_opensfm,)),
}
"""The targets that are formats of recordings: the format, and what makes more than its example."""

MAKERS: dict[str, Maker] = {
    **{target: _example(name, *more) for target, (name, more) in READERS.items()},
    "config": _files(_CONFIGURATIONS),
    "scene": _files(_SCENES),
    "legs": _files(_LEGS),
    "route": _files(_WAYS),
    "path": _files(_WAYS),
    "seen": _files([_timed()]),
    "times": _files(_TIMES),
    "transform": _files(_TRANSFORMS),
    **{name: _maps for name, target in TARGETS.items() if target.damaged == "map.npz"},
}
"""What makes the seeds of each target."""
