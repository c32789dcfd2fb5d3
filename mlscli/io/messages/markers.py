"""Decode clouds drawn as markers, as SLAM systems show their maps in RViz.

Points, spheres and cubes are read as points at their centres. As in RViz, the pose of a marker
moves the points of its list; its scale is the size of each point and moves nothing.

References
----------
visualization_msgs/Marker and RViz's description of it, DisplayTypes/Marker.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from mlscli.io.messages.parts import CloudPart, part_of, placed, vectors
from mlscli.runtime.arrays import Float64

# visualization_msgs/Marker: the type of an object and what to do with it.
_CUBE, _SPHERE, _CUBE_LIST, _SPHERE_LIST, _POINTS = 1, 2, 6, 7, 8
_ADD = 0

_NONE = np.empty((0, 3))


def decode_marker(message: Any) -> list[CloudPart]:
    """Decode a ``visualization_msgs/Marker``; there is no part where its action is not to add."""
    return _parts([message])


def decode_markerarray(message: Any) -> list[CloudPart]:
    """Decode a ``visualization_msgs/MarkerArray``; there is a part for each frame and time."""
    return _parts(message.markers)


def _parts(markers: Iterable[Any]) -> list[CloudPart]:
    clouds: dict[tuple[str, float], list[CloudPart]] = {}
    for marker in markers:
        # Points that are deleted now were read when they were added.
        if marker.action == _ADD:
            header, points = marker.header, _centres(marker)
            part = part_of(
                _NONE if points is None else points,
                header.frame_id,
                header.stamp,
                skipped=int(points is None),
            )
            clouds.setdefault((part.frame_id, part.stamp), []).append(part)
    return [
        parts[0]._replace(
            points=np.concatenate([part.points for part in parts]),
            skipped=sum(part.skipped for part in parts),
        )
        for parts in clouds.values()
    ]


def _centres(marker: Any) -> Float64 | None:
    """Return a marker's points (N, 3) in the frame of its header; None where its type has none."""
    if marker.type in (_POINTS, _SPHERE_LIST, _CUBE_LIST):
        return placed(vectors(marker.points), marker.pose)
    if marker.type in (_SPHERE, _CUBE):
        centre = marker.pose.position
        return np.array([[centre.x, centre.y, centre.z]], dtype=np.float64)
    return None
