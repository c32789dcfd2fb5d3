"""Clouds drawn as markers, as SLAM systems show their maps in RViz.

Points, spheres and cubes stand for points: their centres. RViz moves the list of a marker by
the marker's pose; the scale is the size of each point, not of the list.

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
    """Read a ``visualization_msgs/Marker``; there is no part where it adds nothing."""
    return _parts([message])


def decode_markerarray(message: Any) -> list[CloudPart]:
    """Read a ``visualization_msgs/MarkerArray``; there is a part for each frame and time."""
    return _parts(message.markers)


def _parts(markers: Iterable[Any]) -> list[CloudPart]:
    clouds: dict[tuple[str, float], list[CloudPart]] = {}
    for marker in markers:
        # What is deleted was a point once, and has been read then.
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
    """Return the points of a marker in its frame; None where its type holds none."""
    if marker.type in (_POINTS, _SPHERE_LIST, _CUBE_LIST):
        return placed(vectors(marker.points), marker.pose)
    if marker.type in (_SPHERE, _CUBE):
        centre = marker.pose.position
        return np.array([[centre.x, centre.y, centre.z]], dtype=np.float64)
    return None
