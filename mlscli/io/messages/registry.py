"""The decoders of messages that hold points: from a deserialized message to coordinates.

A cloud with a field or channel named ``keyframe`` (or ``kf``, ``kf_id``) holds the points of
several keyframes and is split by it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from mlscli.io.messages.foxglove import decode_foxglove_laserscan, decode_foxglove_pointcloud
from mlscli.io.messages.laserscan import decode_laserscan
from mlscli.io.messages.markers import decode_marker, decode_markerarray
from mlscli.io.messages.parts import CloudPart, MalformedCloudError, checked
from mlscli.io.messages.pointcloud import decode_pointcloud, decode_posearray
from mlscli.io.messages.pointcloud2 import decode_pointcloud2

__all__ = ["CLOUD_TYPES", "MAPPABLE", "CloudPart", "MalformedCloudError"]

CLOUD_TYPES: dict[str, Callable[[Any], list[CloudPart]]] = {
    type_: checked(type_, decode)
    for type_, decode in {
        "sensor_msgs/msg/PointCloud2": decode_pointcloud2,
        "sensor_msgs/msg/PointCloud": decode_pointcloud,
        "sensor_msgs/msg/LaserScan": decode_laserscan,
        "visualization_msgs/msg/Marker": decode_marker,
        "visualization_msgs/msg/MarkerArray": decode_markerarray,
        "geometry_msgs/msg/PoseArray": decode_posearray,
        "foxglove.PointCloud": decode_foxglove_pointcloud,
        "foxglove.LaserScan": decode_foxglove_laserscan,
        "foxglove_msgs/msg/PointCloud": decode_foxglove_pointcloud,
        "foxglove_msgs/msg/LaserScan": decode_foxglove_laserscan,
    }.items()
}
"""The message types that can be mapped, each with its decoder.

A decoder takes a message that `Deserializer` has read, and raises `MalformedCloudError` where the
message contradicts itself or does not fit its type.
"""

MAPPABLE = ", ".join(type_ for type_ in CLOUD_TYPES if not type_.startswith("foxglove_msgs"))
"""The names of `CLOUD_TYPES` for messages to the user; of Foxglove's two spellings the first."""
