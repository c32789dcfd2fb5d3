"""The map as it grew, as an MCAP file of ROS 2 messages, for Lichtblick, Foxglove and RViz.

==================== ========================= =================================================
topic                type                      content
==================== ========================= =================================================
``/mls/patches``     sensor_msgs/PointCloud2   every patch of the map so far
``/mls/surface``     visualization_msgs/Marker its surfaces, as a list of triangles
``/mls/walls``       visualization_msgs/Marker its walls
``/mls/artificial``  visualization_msgs/Marker artificial triangles of both
``/mls/route``       nav_msgs/Path             where the craft was so far
``/tf``              tf2_msgs/TFMessage        map frame -> mls_craft, at every keyframe
``/tf_static``       tf2_msgs/TFMessage        map frame -> mls_map, always the same
==================== ========================= =================================================

Each message holds the whole state: a viewer that jumps to a time shows the map of that time, and a
late subscriber gets the last state (all topics but ``/tf`` are transient local). The transform to
`mls_map` is repeated with every state, because ``ros2 bag play --start-offset`` skips all earlier
messages. A state is written once a certain share of the map has changed since the last one, so that
the file grows with what changes and not with the number of batches; the finished map comes last.

RViz draws clouds in float32 only. The map therefore has a frame of its own, `mls_map`, whose origin
lies near the map: no precision is lost far from the origin of the map frame. Besides the
coordinates to draw, patches carry their cell indices, and their heights in float64.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from mlscli.errors import expect, expect_items
from mlscli.io.writing.bag_messages import CLOUD_TYPE, PATH_TYPE, TF, TF_STATIC, TF_TYPE, BagWriter
from mlscli.io.writing.flight_bag import nanoseconds, whole_bag
from mlscli.io.writing.triangle_lists import MARKER_TYPE
from mlscli.maps.change import Change
from mlscli.maps.kept_map import KeptMap
from mlscli.maps.surface_map import SurfaceMap
from mlscli.maps.uncovering import patch_places
from mlscli.mesh import build_mesh
from mlscli.mesh.colours import height_range, origin_at, patch_colours
from mlscli.runtime.arrays import Array, Float64
from mlscli.view.layers import faces

PATCHES, ROUTE = "/mls/patches", "/mls/route"
FACES = {name: f"/mls/{name}" for name in ("surface", "walls", "artificial")}
TOPICS = {
    TF_STATIC: TF_TYPE,
    TF: TF_TYPE,
    PATCHES: CLOUD_TYPE,
    **dict.fromkeys(FACES.values(), MARKER_TYPE),
    ROUTE: PATH_TYPE,
}
MAP, CRAFT = "mls_map", "mls_craft"

PATCH_POINT = np.dtype(
    [
        ("x", "<f4"),
        ("y", "<f4"),
        ("z", "<f4"),
        ("rgb", "<u4"),
        ("ix", "<i4"),
        ("iy", "<i4"),
        ("count", "<u4"),
        ("noise", "<f4"),
        ("height", "<f8"),
        ("depth", "<f8"),
        ("variance", "<f8"),
        ("origin", "u1"),
        ("moved", "u1"),
    ],
    align=True,
)
"""A patch in the cloud: position in `mls_map`, colour (0xRRGGBB), unchanged columns of the map."""

_COLUMNS = ("ix", "iy", "count", "noise", "height", "depth", "variance", "origin", "moved")

# A state is written once this share of its patches has come or gone since the last.
SHARE = 1 / 16

# The origin of `mls_map` is a multiple of so many cells away from that of the map frame, along each
# axis, and near the map: viewers start at the origin of a frame, and should see the map from there.
_ROUND = 10

# A keyframe whose time is unknown, or outside the range of ROS's clocks, comes so much later (ns)
# than the one before. No keyframe is at 0: to ROS, that is a clock that is not set yet.
_INTERVAL_NANOSECONDS = 10**8
_EARLIEST, _LATEST = 1, (2**31 - 1) * 10**9


def write_replay(
    path: str | os.PathLike[str],
    surface: SurfaceMap,
    changes: Iterable[Change],
    *,
    overwrite: bool = False,
) -> None:
    """Write a map as it grew, whole or not at all.

    Parameters
    ----------
    path : path-like
        The MCAP file.
    surface : SurfaceMap
        The finished map.
    changes : iterable of Change
        The changes of each batch, as a follower of `MapBuilder` receives them, or as
        `mlscli.maps.uncovering.growth` derives them from a finished map.
    overwrite : bool
        Whether an existing file is replaced.

    Raises
    ------
    OutputError
        Where the file exists and `overwrite` is False, or it cannot be written.
    """
    expect(surface, SurfaceMap, "surface", "a map (SurfaceMap)")
    expect_items(changes, "changes", "the changes of batches (Change)")
    with open_replay(path, overwrite=overwrite) as replay:
        for change in changes:
            replay.follow(change)
        replay.finish(surface)


@contextmanager
def open_replay(path: str | os.PathLike[str], *, overwrite: bool = False) -> Iterator[Replay]:
    """Open a replay; the file appears at `path` when the block ends without an error.

    States are written to the file as they come, and not held in memory.

    Yields
    ------
    Replay

    Raises
    ------
    OutputError
        As `write_replay`.

    Examples
    --------
    >>> import mlscli
    >>> with mlscli.open_replay("flight.mcap") as replay:  # doctest: +SKIP
    ...     replay.finish(mlscli.build_map(recording, parameters, follow=replay.follow))
    """
    with (
        whole_bag(path, "states", overwrite=overwrite) as target,
        BagWriter(target, "states", TOPICS, lasting=TOPICS.keys() - {TF}) as bag,
    ):
        yield Replay(bag)


class Replay:
    """Follows a map as it grows, and writes its states and the route of the craft.

    Parameters
    ----------
    bag : BagWriter
        The bag to write to, with the topics `TOPICS`.
    """

    def __init__(self, bag: BagWriter) -> None:
        self._bag = bag
        self._state: KeptMap | None = None
        self._size = self._changed = 0
        self._stamps: list[int] = []
        self._has_clock = False
        self._positions = [np.empty((0, 3))]
        self._passed = 0
        self._origin: Float64 | None = None

    def follow(self, change: Change) -> None:
        """Take the change of a batch; write the state before it first if enough has changed."""
        if self._state is None:
            self._state = KeptMap(change.grid)
        elif self._changed >= max(SHARE * self._size, 1):
            self._write(self._state.whole())
        cells = change.cells
        self._state.replace(cells, change.applied_to(self._state.extract(cells)))
        self._changed += change.added.size + change.removed.size
        self._size += change.added.size - change.removed.size
        self._pass(change.route)

    def finish(self, surface: SurfaceMap) -> None:
        """Write the finished map and the rest of its route."""
        self._pass(surface.route[len(self._stamps) :])
        self._write(surface)

    def _pass(self, route: Float64) -> None:
        """Take further rows of the route, float64 (K, 4)."""
        for time in route[:, 0].tolist():
            self._stamps.append(self._stamp(time))
        self._positions.append(route[:, 1:])

    def _stamp(self, time: float) -> int:
        """Return the time (ns) of the next keyframe, never before the previous one.

        `time` is in seconds. Times count only if that of the first keyframe is usable.
        """
        is_known = 0 <= time * 10**9 <= _LATEST
        if not self._stamps:
            self._has_clock = is_known
        before = self._stamps[-1] if self._stamps else 0
        if self._has_clock and is_known:
            return max(before, nanoseconds(time), _EARLIEST)
        return min(before + _INTERVAL_NANOSECONDS, _LATEST)

    def _write(self, surface: SurfaceMap) -> None:
        """Write a state of the map at the time of the latest keyframe, and the route up to it."""
        self._changed = 0
        stamps = self._stamps or [_INTERVAL_NANOSECONDS]
        if self._origin is None:
            self._origin = _near(surface)
            self._transform(TF_STATIC, stamps[0], surface.frame_id, MAP, self._origin)
        position = np.concatenate(self._positions)
        self._positions = [position]
        known = np.flatnonzero(np.isfinite(position).all(axis=1))
        for row in known[known >= self._passed]:
            self._transform(TF, self._stamps[row], surface.frame_id, CRAFT, position[row])
        self._passed = len(position)
        stamp = stamps[-1]
        self._transform(TF_STATIC, stamp, surface.frame_id, MAP, self._origin)
        self._bag.cloud(PATCHES, stamp, MAP, _records(surface, self._origin))
        mesh = build_mesh(replace(surface, route=surface.route[:0]))
        vertices = mesh.vertices - self._origin
        for name, triangles in faces(mesh).items():
            self._bag.triangles(FACES[name], stamp, MAP, vertices, mesh.colours, triangles)
        passed = [self._stamps[row] for row in known]
        self._bag.path(ROUTE, stamp, MAP, passed, position[known] - self._origin)

    def _transform(self, topic: str, stamp: int, parent: str, child: str, place: Float64) -> None:
        self._bag.transform(topic, stamp, parent, child, place.tolist())


def _near(surface: SurfaceMap) -> Float64:
    """Return a place (3,) near a map, multiples of `_ROUND` cells from the map frame's origin."""
    if not surface.size:
        return np.zeros(3)
    step = _ROUND * surface.cell_size
    place: Float64 = step * np.rint(np.median(patch_places(surface), axis=0) / step) + 0.0
    return place


def _records(surface: SurfaceMap, origin: Float64) -> Array:
    """Return the patches as `PATCH_POINT` records (P,), placed relative to `origin` (3,)."""
    records = np.zeros(surface.size, PATCH_POINT)
    place = patch_places(surface) - origin
    with np.errstate(over="ignore"):
        for axis, name in enumerate("xyz"):
            records[name] = place[:, axis]
    origins = origin_at(surface, np.arange(surface.size), surface.height)
    colours = patch_colours(surface.height, origins, *height_range(surface))
    records["rgb"] = colours.astype(np.uint32) @ (1 << 16, 1 << 8, 1)
    for name in _COLUMNS:
        records[name] = getattr(surface, name)
    return records
