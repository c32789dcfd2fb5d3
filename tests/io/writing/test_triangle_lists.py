"""Markers put together from arrays are, byte for byte, what rosbags makes of objects.

Ways to pass without being right: names of one length, so that no gap is ever needed before the
points; a marker that is never empty.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from mlscli.io.writing.triangle_lists import MARKER_TYPE, TriangleLists

STORE = get_typestore(Stores.LATEST)
LISTS = TriangleLists(STORE)


def header(frame_id: str) -> Any:
    types: Any = STORE.types
    stamp = types["builtin_interfaces/msg/Time"](sec=7, nanosec=8)
    return types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame_id)


@pytest.mark.parametrize("triangles", [0, 1, 5])
@pytest.mark.parametrize("name", ["", "a", "ab", "abc", "abcd", "abcde", "abcdef", "/mls/surface"])
def test_bytes_are_those_of_the_library(name: str, triangles: int) -> None:
    rng = np.random.default_rng(triangles)
    vertices, colours = rng.normal(size=(9, 3)), rng.integers(0, 256, (9, 3), dtype=np.uint8)
    corners = rng.integers(0, 9, (triangles, 3), dtype=np.int32)
    data = LISTS.serialized(header("map"), name, vertices, colours, corners)
    marker: Any = STORE.deserialize_cdr(data, MARKER_TYPE)
    assert bytes(STORE.serialize_cdr(marker, MARKER_TYPE)) == data
    assert (marker.ns, marker.type, marker.action) == (name, 11, 0 if triangles else 2)
    found = [(p.x, p.y, p.z) for p in marker.points]
    assert found == [tuple(row) for row in vertices[corners.ravel()].tolist()]
    tints = np.array([(c.r, c.g, c.b) for c in marker.colors]).reshape(-1, 3) * 255
    assert np.rint(tints).tolist() == colours[corners.ravel()].tolist()
    assert marker.mesh_use_embedded_materials is False
