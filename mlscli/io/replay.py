"""The map as it grew, as an MCAP file of ROS 2 messages, for Foxglove Studio and RViz.

==================== ======================= ===================================================
topic                type                    content
==================== ======================= ===================================================
``/mls/patches``     sensor_msgs/PointCloud2 every patch of the map so far
``/mls/surface``     visualization_msgs/Marker its surfaces, as a list of triangles
``/mls/walls``       visualization_msgs/Marker its walls
``/mls/artificial``  visualization_msgs/Marker what of both is artificial
``/mls/route``       nav_msgs/Path           where the craft was so far
``/tf``              tf2_msgs/TFMessage      map frame -> mls_craft, at every keyframe
``/tf_static``       tf2_msgs/TFMessage      map frame -> mls_map, once
==================== ======================= ===================================================

Each message holds the whole state: whoever jumps to a time sees the map of that time. So that the
file grows with what changes, and not with the batches times the map, a state is written when a
share of the map has changed since the last; the finished map comes at the end.

RViz draws clouds in float32 alone. The map is told in a frame of its own, `mls_map`, whose origin
is a cell near the map, so that nothing is lost far from the origin of the map frame; beside the
coordinates to be drawn, patches have their cells, and their heights in float64.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from mlscli.growth import patch_places
from mlscli.io.bagfile import nanoseconds, whole_bag
from mlscli.io.bagwriter import (
    CLOUD_TYPE,
    PATH_TYPE,
    TF,
    TF_STATIC,
    TF_TYPE,
    BagWriter,
)
from mlscli.io.trianglelist import MARKER_TYPE
from mlscli.mesh import build_mesh
from mlscli.pipeline.change import Change
from mlscli.pipeline.tiles import TiledMap
from mlscli.surface_map import SurfaceMap
from mlscli.typing import Array, Float64
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

PATCH = np.dtype(
    [
        ("x", "<f4"),
        ("y", "<f4"),
        ("z", "<f4"),
        ("ix", "<i4"),
        ("iy", "<i4"),
        ("count", "<u4"),
        ("height", "<f8"),
        ("depth", "<f8"),
        ("variance", "<f8"),
        ("origin", "u1"),
    ],
    align=True,
)
"""A patch in the cloud: its place in `mls_map`, and columns of the map as they are."""

# A state is written once this share of its patches has come or gone since the last.
SHARE = 1 / 16

# The frame of the map begins at a cell whose indices are multiples of this.
_ROUND = 1000

# Where times are not known, or no clock of ROS can show them, keyframes are this far apart (ns).
_INTERVAL = 10**8
_LATEST = 2**31 - 1

_NO_TURN = (0.0, 0.0, 0.0, 1.0)


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
    path
        The MCAP file.
    surface
        The finished map; its route has the times.
    changes : iterable of Change
        What came and went, batch by batch, as a follower of `MapBuilder` is told; or as
        `mlscli.growth.growth` makes it up for a map whose making nobody followed.
    overwrite : bool

    Raises
    ------
    OutputError
        Where the file exists and `overwrite` is False, or it cannot be written.
    """
    with (
        whole_bag(path, "mcap", overwrite=overwrite) as target,
        BagWriter(target, "mcap", TOPICS, compressed=True) as bag,
    ):
        replay = _Replay(bag, surface)
        state = TiledMap(
            replace(surface.take(np.empty(0, dtype=np.int64)), route=surface.route[:0])
        )
        keyframe, changed, size = 0, 0, 0
        for change in changes:
            if changed and changed >= SHARE * size:
                replay.write(state.whole(), keyframe)
                changed = 0
            cells = change.cells
            state.replace(cells, change.applied_to(state.extract(cells)))
            keyframe = max(keyframe, int(change.added.last_keyframe.max(initial=0)))
            changed += change.added.size + change.removed.size
            size += change.added.size - change.removed.size
        replay.write(surface, len(surface.route) - 1)


class _Replay:
    """Writes states of a map, and where the craft was meanwhile."""

    def __init__(self, bag: BagWriter, surface: SurfaceMap) -> None:
        self._bag = bag
        self._frame_id = surface.frame_id
        self._stamps = _stamps(surface.route[:, 0])
        self._position = surface.route[:, 1:]
        self._told = 0
        cell = np.median((surface.ix, surface.iy), axis=1) if surface.size else np.zeros(2)
        self._cell = (_ROUND * np.rint(cell / _ROUND)).astype(np.int64)
        height = _ROUND * np.rint(np.median(surface.height) / _ROUND) if surface.size else 0.0
        self._origin = np.array([*(self._cell * surface.cell_size), height])
        bag.transform(
            TF_STATIC, self._stamps[0], self._frame_id, MAP, self._origin.tolist(), _NO_TURN
        )

    def write(self, surface: SurfaceMap, keyframe: int) -> None:
        """Write a state of the map at the time of a keyframe, and the way until there."""
        known = np.flatnonzero(np.isfinite(self._position[: keyframe + 1]).all(axis=1))
        for row in known[known >= self._told]:
            self._bag.transform(
                TF, self._stamps[row], self._frame_id, CRAFT, self._position[row].tolist(), _NO_TURN
            )
        self._told = keyframe + 1
        stamp = self._stamps[max(keyframe, 0)]
        self._bag.cloud(PATCHES, stamp, MAP, self._patches(surface))
        mesh = build_mesh(replace(surface, route=surface.route[:0]))
        vertices = mesh.vertices - self._origin
        for name, triangles in faces(mesh).items():
            self._bag.triangles(FACES[name], stamp, MAP, vertices, mesh.colours, triangles)
        passed = [self._stamps[row] for row in known]
        self._bag.path(ROUTE, stamp, MAP, passed, self._position[known] - self._origin)

    def _patches(self, surface: SurfaceMap) -> Array:
        records = np.zeros(surface.size, PATCH)
        place = patch_places(surface) - self._origin
        with np.errstate(over="ignore"):
            for axis, name in enumerate("xyz"):
                records[name] = place[:, axis]
        for name in ("ix", "iy", "count", "height", "depth", "variance", "origin"):
            records[name] = getattr(surface, name)
        return records


def _stamps(times: Float64) -> list[int]:
    """Return the time of each keyframe (ns), never before the one before it; at least one."""
    if not len(times):
        return [0]
    if not np.isfinite(times).all() or times.min() < 0 or times.max() > _LATEST:
        return [number * _INTERVAL for number in range(len(times))]
    return [nanoseconds(time) for time in np.maximum.accumulate(times).tolist()]
