"""The messages of recorded flights and of maps, for the bags that rosbags writes."""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2

from mlscli.io.ros import DATATYPES, NANOSECONDS, usual_types
from mlscli.io.writing.triangle_lists import TriangleLists
from mlscli.runtime.arrays import Array, Float64, Int32, UInt8

Kind = Literal["ros1", "ros2", "mcap"]

TF, TF_STATIC = "/tf", "/tf_static"

TF_TYPE = "tf2_msgs/msg/TFMessage"
CLOUD_TYPE = "sensor_msgs/msg/PointCloud2"
ODOMETRY_TYPE = "nav_msgs/msg/Odometry"
PATH_TYPE = "nav_msgs/msg/Path"

_NUMBERS = {name: number for number, name in DATATYPES.items()}
_NO_TURN = (0.0, 0.0, 0.0, 1.0)
_FOREVER = QosTime(2147483647, 4294967295)


class BagWriter:
    """A bag being written.

    Parameters
    ----------
    path : Path
        Of a file, or of a folder that is made.
    kind : {"ros1", "ros2", "mcap"}
    topics : mapping of str to str
        The topics and their types.
    lasting : container of str
        The topics whose last message is told also to those who listen later.
    compressed : bool
        Whether chunks of an MCAP file are compressed.
    """

    def __init__(
        self,
        path: Path,
        kind: Kind,
        topics: Mapping[str, str],
        *,
        lasting: Container[str] = (TF_STATIC,),
        compressed: bool = False,
    ) -> None:
        self._topics = topics
        self._lasting = lasting
        self._is_ros1 = kind == "ros1"
        self._store = usual_types(is_ros1=self._is_ros1)
        if not self._is_ros1:
            self._triangle_lists = TriangleLists(self._store)
        self._types: Any = self._store.types
        self._writer: Any
        if self._is_ros1:
            self._writer = Writer1(path)
        else:
            plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
            writer = Writer2(path, version=9, storage_plugin=plugin)
            if compressed:
                writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
            self._writer = writer
        self._connections: dict[str, Any] = {}

    def __enter__(self) -> BagWriter:
        self._writer.__enter__()
        for topic, type_ in self._topics.items():
            options: dict[str, Any] = {}
            if topic in self._lasting:
                options = (
                    {"latching": 1} if self._is_ros1 else {"offered_qos_profiles": [_lasting()]}
                )
            self._connections[topic] = self._writer.add_connection(
                topic, type_, typestore=self._store, **options
            )
        return self

    def __exit__(self, *exception: Any) -> None:
        self._writer.__exit__(*exception)

    def transform(
        self,
        topic: str,
        stamp: int,
        parent: str,
        child: str,
        translation: Sequence[float],
        rotation: Sequence[float] = _NO_TURN,
    ) -> None:
        """Write T_parent_child."""
        x, y, z = translation
        transform = self._new(
            "geometry_msgs/msg/TransformStamped",
            header=self._header(stamp, parent),
            child_frame_id=child,
            transform=self._new(
                "geometry_msgs/msg/Transform",
                translation=self._new("geometry_msgs/msg/Vector3", x=x, y=y, z=z),
                rotation=self._quaternion(rotation),
            ),
        )
        self._write(topic, stamp, self._new(TF_TYPE, transforms=[transform]))

    def odometry(
        self,
        topic: str,
        stamp: int,
        frames: tuple[str, str],
        position: Sequence[float],
        attitude: Sequence[float],
    ) -> None:
        """Write where the second of the frames is in the first, and how it is turned.

        Its speed is not told.
        """
        still = self._new("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0)
        twist = self._new("geometry_msgs/msg/Twist", linear=still, angular=still)
        message = self._new(
            ODOMETRY_TYPE,
            header=self._header(stamp, frames[0]),
            child_frame_id=frames[1],
            pose=self._new(
                "geometry_msgs/msg/PoseWithCovariance",
                pose=self._pose(position, attitude),
                covariance=np.zeros(36),
            ),
            twist=self._new(
                "geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=np.zeros(36)
            ),
        )
        self._write(topic, stamp, message)

    def path(
        self, topic: str, stamp: int, frame_id: str, stamps: Sequence[int], positions: Float64
    ) -> None:
        """Write a way through positions (K, 3), each with the time (ns) it was passed at."""
        poses = [
            self._new(
                "geometry_msgs/msg/PoseStamped",
                header=self._header(passed, frame_id),
                pose=self._pose(position, _NO_TURN),
            )
            for passed, position in zip(stamps, positions.tolist(), strict=True)
        ]
        self._write(
            topic, stamp, self._new(PATH_TYPE, header=self._header(stamp, frame_id), poses=poses)
        )

    def cloud(self, topic: str, stamp: int, frame_id: str, points: Array) -> None:
        """Write a cloud: records (N,), whose fields become those of the points."""
        layout = points.dtype
        fields = [
            self._new(
                "sensor_msgs/msg/PointField",
                name=name,
                offset=offset,
                datatype=_NUMBERS[dtype.str[1:]],
                count=1,
            )
            for name, (dtype, offset, *_) in (layout.fields or {}).items()
        ]
        message = self._new(
            CLOUD_TYPE,
            header=self._header(stamp, frame_id),
            height=1,
            width=len(points),
            fields=fields,
            is_bigendian=False,
            point_step=layout.itemsize,
            row_step=layout.itemsize * len(points),
            data=np.frombuffer(points.tobytes(), dtype=np.uint8),
            is_dense=True,
        )
        self._write(topic, stamp, message)

    def triangles(
        self,
        topic: str,
        stamp: int,
        frame_id: str,
        vertices: Float64,
        colours: UInt8,
        triangles: Int32,
    ) -> None:
        """Write a marker that lists triangles (T, 3) of vertices (V, 3), in their colours (V, 3).

        It takes the place of the marker before it on its topic; without triangles it takes that
        away. There is none in ROS 1.
        """
        data = self._triangle_lists.serialized(
            self._header(stamp, frame_id), topic, vertices, colours, triangles
        )
        self._writer.write(self._connections[topic], stamp, data)

    def _new(self, type_: str, **fields: Any) -> Any:
        return self._types[type_](**fields)

    def _header(self, stamp: int, frame_id: str) -> Any:
        seconds, nanoseconds = divmod(stamp, NANOSECONDS)
        time = self._new("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanoseconds)
        sequence = {"seq": 0} if self._is_ros1 else {}
        return self._new("std_msgs/msg/Header", **sequence, stamp=time, frame_id=frame_id)

    def _pose(self, position: Sequence[float], attitude: Sequence[float]) -> Any:
        x, y, z = position
        return self._new(
            "geometry_msgs/msg/Pose",
            position=self._new("geometry_msgs/msg/Point", x=x, y=y, z=z),
            orientation=self._quaternion(attitude),
        )

    def _quaternion(self, rotation: Sequence[float]) -> Any:
        x, y, z, w = rotation
        return self._new("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)

    def _write(self, topic: str, stamp: int, message: Any) -> None:
        connection = self._connections[topic]
        serialize = self._store.serialize_ros1 if self._is_ros1 else self._store.serialize_cdr
        self._writer.write(connection, stamp, serialize(message, connection.msgtype))


def _lasting() -> Qos:
    return Qos(
        QosHistory.KEEP_LAST,
        1,
        QosReliability.RELIABLE,
        QosDurability.TRANSIENT_LOCAL,
        _FOREVER,
        _FOREVER,
        QosLiveliness.AUTOMATIC,
        _FOREVER,
        False,
    )
