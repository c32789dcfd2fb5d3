"""Serialize markers that list triangles or lines, from arrays.

A marker holds a point and a colour for every corner. As objects, those of a large mesh would take
seconds for every message. Here the fields before and after them are serialized as two messages of
their own, and the arrays are put between these, laid out as in CDR.

References
----------
visualization_msgs/Marker; OMG, *DDS-XTypes* 1.3, section 7.4.1 (plain CDR, version 1).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from rosbags.typesys.store import Typestore

from mlscli.runtime.arrays import Array, Float64, Int32, UInt8

MARKER_TYPE = "visualization_msgs/msg/Marker"

_BEGIN, _END = "mls_msgs/msg/MarkerBegin", "mls_msgs/msg/MarkerEnd"
# Types of markers, by the corners that an element has.
_LISTS = {2: 5, 3: 11}
_ADD, _DELETE = 0, 2
_HEADER = 4  # bytes before the message; alignment counts from their end


class TriangleLists:
    """Serializes markers with the types of a ROS 2 distribution."""

    def __init__(self, store: Typestore) -> None:
        fields = store.fielddefs[MARKER_TYPE][1]
        points = [name for name, _ in fields].index("points")
        # The colours follow the points.
        store.register({_BEGIN: ([], fields[:points]), _END: ([], fields[points + 2 :])})
        self._store = store
        self._types: Any = store.types

    def serialized(
        self,
        header: Any,
        name: str,
        vertices: Float64,
        colours: UInt8,
        elements: Int32,
        width: float = 1.0,
    ) -> bytes:
        """Return a serialized marker that lists triangles or lines.

        Without elements it deletes the marker of that name: RViz calls an empty one an error.

        Parameters
        ----------
        header : std_msgs/msg/Header
        name : str
            The namespace of the marker.
        vertices : float64 (V, 3)
        colours : uint8 (V, 3)
            Red, green, blue of each vertex.
        elements : int32 (E, 3) or (E, 2)
            Indices of vertices: the corners of triangles, or the ends of lines.
        width : float
            How wide lines are drawn, in the unit of the vertices.
        """
        corner = elements.ravel()
        tints = np.ones((len(corner), 4), dtype="<f4")
        tints[:, :3] = colours[corner] / 255
        action = _ADD if len(corner) else _DELETE
        before = self._before(header, name, elements.shape[1], action, width)
        data = bytearray(self._store.serialize_cdr(before, _BEGIN))
        _append_sequence(data, vertices[corner].astype("<f8"))
        _append_sequence(data, tints)
        # The offset is a multiple of four, and nothing that follows is aligned to eight bytes.
        data += self._store.serialize_cdr(self._after(header), _END)[_HEADER:]
        return bytes(data)

    def _before(self, header: Any, name: str, corners: int, action: int, width: float) -> Any:
        return self._new(
            _BEGIN,
            header=header,
            ns=name,
            id=0,
            type=_LISTS[corners],
            action=action,
            pose=self._new(
                "geometry_msgs/msg/Pose",
                position=self._new("geometry_msgs/msg/Point", x=0.0, y=0.0, z=0.0),
                orientation=self._new("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0),
            ),
            scale=self._new("geometry_msgs/msg/Vector3", x=width, y=1.0, z=1.0),
            color=self._new("std_msgs/msg/ColorRGBA", r=1.0, g=1.0, b=1.0, a=1.0),
            lifetime=self._new("builtin_interfaces/msg/Duration", sec=0, nanosec=0),
            frame_locked=False,
        )

    def _after(self, header: Any) -> Any:
        nothing = np.empty(0, dtype=np.uint8)
        return self._new(
            _END,
            texture_resource="",
            texture=self._new(
                "sensor_msgs/msg/CompressedImage", header=header, format="", data=nothing
            ),
            uv_coordinates=[],
            text="",
            mesh_resource="",
            mesh_file=self._new("visualization_msgs/msg/MeshFile", filename="", data=nothing),
            mesh_use_embedded_materials=False,
        )

    def _new(self, type_: str, **fields: Any) -> Any:
        return self._types[type_](**fields)


def _append_sequence(data: bytearray, rows: Array) -> None:
    """Append a sequence of structures, each a row of numbers, to a message in CDR.

    Its length is aligned to four bytes, the first structure to the size of its numbers; an empty
    sequence is only a length.

    Parameters
    ----------
    data : bytearray
        The message so far, with its header of four bytes.
    rows : (N, K)
        Little-endian.
    """
    data += bytes(-(len(data) - _HEADER) % 4)
    data += len(rows).to_bytes(4, "little")
    if len(rows):
        data += bytes(-(len(data) - _HEADER) % rows.itemsize)
        data += rows.tobytes()
