"""Decode clouds whose points are listed one by one.

References
----------
sensor_msgs/PointCloud, sensor_msgs/ChannelFloat32, geometry_msgs/PoseArray.
"""

from __future__ import annotations

from typing import Any

from mlscli.io.messages.parts import CloudPart, MalformedCloudError, part_of, vectors
from mlscli.io.source import keyframe_field


def decode_pointcloud(message: Any) -> list[CloudPart]:
    """Decode a ``sensor_msgs/PointCloud`` whose points are a structured array.

    Raises
    ------
    MalformedCloudError
        The channel of keyframes does not have one value for each point.
    """
    points = vectors(message.points)
    channels = {channel.name: channel.values for channel in reversed(message.channels)}
    name = keyframe_field(channels)
    keyframes = None if name is None else channels[name]
    if keyframes is not None and len(keyframes) != len(points):
        raise MalformedCloudError(
            f"{len(keyframes)} values in channel {name}, expected one for each of "
            f"{len(points)} points"
        )
    return [part_of(points, message.header.frame_id, message.header.stamp, keyframes)]


def decode_posearray(message: Any) -> list[CloudPart]:
    """Decode the positions of a ``geometry_msgs/PoseArray`` whose poses are a structured array."""
    points = vectors(message.poses["position"])
    return [part_of(points, message.header.frame_id, message.header.stamp)]
