"""The topics and messages of a recorded flight, for the bags that rosbags writes."""

from __future__ import annotations

from collections.abc import Sequence
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
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from mlscli.typing import Float64

Kind = Literal["ros1", "ros2", "mcap"]

CLOUD, ODOMETRY, TF, TF_STATIC = "/cloud", "/odom", "/tf", "/tf_static"
MAP, BASE, CAMERA = "map", "base_link", "camera"

_CLOUD_TYPE = "sensor_msgs/msg/PointCloud2"
_ODOMETRY_TYPE = "nav_msgs/msg/Odometry"
_TF_TYPE = "tf2_msgs/msg/TFMessage"
_FLOAT64 = 8
_NANOSECONDS = 10**9
_FOREVER = QosTime(2147483647, 4294967295)


class BagWriter:
    """A bag being written, with its four topics."""

    def __init__(self, path: Path, kind: Kind) -> None:
        self._is_ros1 = kind == "ros1"
        self._store = get_typestore(Stores.ROS1_NOETIC if self._is_ros1 else Stores.LATEST)
        if self._is_ros1:
            # ROS 1 has it in a package that the types of its distribution lack.
            definition = "geometry_msgs/TransformStamped[] transforms"
            self._store.register(get_types_from_msg(definition, _TF_TYPE))
        self._types: Any = self._store.types
        plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
        self._writer: Any = (
            Writer1(path) if self._is_ros1 else Writer2(path, version=9, storage_plugin=plugin)
        )
        self._connections: dict[str, Any] = {}

    def __enter__(self) -> BagWriter:
        self._writer.__enter__()
        for topic, type_ in (
            (TF_STATIC, _TF_TYPE), (TF, _TF_TYPE), (ODOMETRY, _ODOMETRY_TYPE), (CLOUD, _CLOUD_TYPE),
        ):  # fmt: skip
            options: dict[str, Any] = {}
            if topic == TF_STATIC:
                # It is told once, also to those who listen later.
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
        rotation: Sequence[float],
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
        self._write(topic, stamp, self._new(_TF_TYPE, transforms=[transform]))

    def odometry(self, stamp: int, position: Sequence[float], attitude: Sequence[float]) -> None:
        """Write where the craft is in the map, and its attitude; its speed is not told."""
        x, y, z = position
        pose = self._new(
            "geometry_msgs/msg/Pose",
            position=self._new("geometry_msgs/msg/Point", x=x, y=y, z=z),
            orientation=self._quaternion(attitude),
        )
        still = self._new("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0)
        twist = self._new("geometry_msgs/msg/Twist", linear=still, angular=still)
        message = self._new(
            _ODOMETRY_TYPE,
            header=self._header(stamp, MAP),
            child_frame_id=BASE,
            pose=self._new(
                "geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=np.zeros(36)
            ),
            twist=self._new(
                "geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=np.zeros(36)
            ),
        )
        self._write(ODOMETRY, stamp, message)

    def cloud(self, stamp: int, frame_id: str, points: Float64) -> None:
        """Write a cloud (N, 3)."""
        step = 3 * 8
        fields = [
            self._new(
                "sensor_msgs/msg/PointField",
                name=name,
                offset=8 * place,
                datatype=_FLOAT64,
                count=1,
            )
            for place, name in enumerate("xyz")
        ]
        message = self._new(
            _CLOUD_TYPE,
            header=self._header(stamp, frame_id),
            height=1,
            width=len(points),
            fields=fields,
            is_bigendian=False,
            point_step=step,
            row_step=step * len(points),
            data=np.frombuffer(points.astype("<f8").tobytes(), dtype=np.uint8),
            is_dense=True,
        )
        self._write(CLOUD, stamp, message)

    def _new(self, type_: str, **fields: Any) -> Any:
        return self._types[type_](**fields)

    def _header(self, stamp: int, frame_id: str) -> Any:
        seconds, nanoseconds = divmod(stamp, _NANOSECONDS)
        time = self._new("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanoseconds)
        sequence = {"seq": 0} if self._is_ros1 else {}
        return self._new("std_msgs/msg/Header", **sequence, stamp=time, frame_id=frame_id)

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
