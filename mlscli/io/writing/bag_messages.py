"""Write the messages of recorded flights and of maps to bags, with rosbags."""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
import yaml
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.rosbag2.metadata import dump_qos_v9

from mlscli.io.ros import DATATYPES, NANOSECONDS, usual_types
from mlscli.io.writing.mcap_states import StateWriter
from mlscli.io.writing.triangle_lists import TriangleLists
from mlscli.runtime.arrays import Array, Float64, Int32, UInt8

Kind = Literal["ros1", "ros2", "mcap", "states"]

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
        A file where `kind` is ros1 or states; otherwise a folder, which is created.
    kind : {"ros1", "ros2", "mcap", "states"}
        A ROS 1 bag, a ROS 2 bag of a SQLite or an MCAP file, or an MCAP file whose messages
        resemble those before them on their topics.
    topics : mapping of str to str
        The message type of each topic.
    lasting : container of str
        The topics whose last message is also sent to later subscribers.
    """

    def __init__(
        self,
        path: Path,
        kind: Kind,
        topics: Mapping[str, str],
        *,
        lasting: Container[str] = (TF_STATIC,),
    ) -> None:
        self._topics = topics
        self._lasting = lasting
        self._is_ros1 = kind == "ros1"
        self._store = usual_types(is_ros1=self._is_ros1)
        if not self._is_ros1:
            self._triangle_lists = TriangleLists(self._store)
        self._types: Any = self._store.types
        self._writer: Any
        if kind == "states":
            self._writer = StateWriter(path, self._store)
        elif self._is_ros1:
            self._writer = Writer1(path)
        else:
            plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
            self._writer = Writer2(path, version=9, storage_plugin=plugin)
        self._connections: dict[str, Any] = {}

    def __enter__(self) -> BagWriter:
        self._writer.__enter__()
        for topic, type_ in self._topics.items():
            self._connections[topic] = self._connection(topic, type_)
        return self

    def _connection(self, topic: str, type_: str) -> Any:
        """Return what the writer calls a new topic."""
        lasts = topic in self._lasting
        offered = [_lasting()] if lasts else []
        if isinstance(self._writer, StateWriter):
            profiles = lasting_profiles() if lasts else yaml.safe_dump([])
            return self._writer.add_topic(topic, type_, {"offered_qos_profiles": profiles})
        options: dict[str, Any] = {"offered_qos_profiles": offered}
        if self._is_ros1:
            options = {"latching": 1} if lasts else {}
        return self._writer.add_connection(topic, type_, typestore=self._store, **options)

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
        """Write a transform T_parent_child.

        Parameters
        ----------
        topic : str
        stamp : int
            Time in nanoseconds.
        parent, child : str
            Names of the frames.
        translation : sequence of float
            x, y, z of the child in the parent.
        rotation : sequence of float
            Unit quaternion x, y, z, w.
        """
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
        """Write the pose of the craft, with velocities and covariances of 0.

        Parameters
        ----------
        topic : str
        stamp : int
            Time in nanoseconds.
        frames : tuple of str
            The parent frame, and that of the craft.
        position : sequence of float
            x, y, z of the craft in the parent frame.
        attitude : sequence of float
            Unit quaternion x, y, z, w.
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
        self,
        topic: str,
        stamp: int,
        frame_id: str,
        stamps: Sequence[int],
        positions: Float64,
        attitudes: Float64 | None = None,
    ) -> None:
        """Write a path.

        Parameters
        ----------
        topic : str
        stamp : int
            Time of the message in nanoseconds.
        frame_id : str
        stamps : sequence of int
            Time of each position in nanoseconds.
        positions : float64 (K, 3)
        attitudes : float64 (K, 4), optional
            Unit quaternions x, y, z, w; None: they are not known.
        """
        if attitudes is None:
            attitudes = np.tile(_NO_TURN, (len(positions), 1))
        poses = [
            self._new(
                "geometry_msgs/msg/PoseStamped",
                header=self._header(passed, frame_id),
                pose=self._pose(position, attitude),
            )
            for passed, position, attitude in zip(
                stamps, positions.tolist(), attitudes.tolist(), strict=True
            )
        ]
        self._write(
            topic, stamp, self._new(PATH_TYPE, header=self._header(stamp, frame_id), poses=poses)
        )

    def cloud(self, topic: str, stamp: int, frame_id: str, points: Array) -> None:
        """Write a cloud at a stamp (ns): a structured array (N,) with the fields of the points."""
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
        """Write a marker that lists triangles; not for ROS 1.

        It replaces the marker before it on its topic; without triangles it deletes that marker.

        Parameters
        ----------
        topic : str
        stamp : int
            Time in nanoseconds.
        frame_id : str
        vertices : float64 (V, 3)
            Coordinates in that frame.
        colours : uint8 (V, 3)
            Red, green, blue of each vertex.
        triangles : int32 (T, 3)
            Indices of vertices.
        """
        data = self._triangle_lists.serialized(
            self._header(stamp, frame_id), topic, vertices, colours, triangles
        )
        self._writer.write(self._connections[topic], stamp, data)

    def lines(
        self,
        topic: str,
        stamp: int,
        frame_id: str,
        vertices: Float64,
        colours: UInt8,
        ends: Int32,
        width: float,
    ) -> None:
        """Write a marker that lists lines; not for ROS 1.

        Parameters
        ----------
        topic, stamp, frame_id, vertices, colours
            As for `triangles`.
        ends : int32 (L, 2)
            Indices of vertices.
        width : float
            How wide lines are drawn, in the unit of the vertices.
        """
        data = self._triangle_lists.serialized(
            self._header(stamp, frame_id), topic, vertices, colours, ends, width
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
        self._writer.write(connection, stamp, serialize(message, self._topics[topic]))


def lasting_profiles() -> str:
    """Return what a channel's metadata hold of a topic whose last message lasts."""
    profiles: str = yaml.safe_dump(dump_qos_v9([_lasting()]))
    return profiles


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
