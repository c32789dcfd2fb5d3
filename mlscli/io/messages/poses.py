"""Decode messages that hold poses or transforms: from a deserialized message to arrays.

References
----------
geometry_msgs, nav_msgs/Odometry and Path, tf2_msgs/TFMessage, and Foxglove's PoseInFrame and
FrameTransform: each gives the pose of the child frame in the parent frame.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import wraps
from typing import Any, TypeAlias

import numpy as np

from mlscli.geometry.poses import are_poses, unit
from mlscli.geometry.transforms import bare
from mlscli.io.messages.parts import checked, seconds
from mlscli.io.source import StampedPoses

# Parent frame, child frame, time, position, orientation.
_Row: TypeAlias = tuple[str, str, Any, Any, Any]


def _odometry(message: Any) -> Iterator[_Row]:
    header, pose = message.header, message.pose.pose
    yield header.frame_id, message.child_frame_id, header.stamp, pose.position, pose.orientation


def _pose_stamped(message: Any) -> Iterator[_Row]:
    header, pose = message.header, message.pose
    yield header.frame_id, "", header.stamp, pose.position, pose.orientation


def _pose_with_covariance_stamped(message: Any) -> Iterator[_Row]:
    header, pose = message.header, message.pose.pose
    yield header.frame_id, "", header.stamp, pose.position, pose.orientation


def _path(message: Any) -> Iterator[_Row]:
    for each in message.poses:
        # Poses that name no frame are in that of the path.
        parent = each.header.frame_id or message.header.frame_id
        yield parent, "", each.header.stamp, each.pose.position, each.pose.orientation


def _transform_stamped(message: Any) -> Iterator[_Row]:
    header, transform = message.header, message.transform
    yield (
        header.frame_id, message.child_frame_id, header.stamp, transform.translation,
        transform.rotation,
    )  # fmt: skip


def _tf_message(message: Any) -> Iterator[_Row]:
    for each in message.transforms:
        yield from _transform_stamped(each)


def _pose_in_frame(message: Any) -> Iterator[_Row]:
    pose = message.pose
    yield message.frame_id, "", message.timestamp, pose.position, pose.orientation


def _frame_transform(message: Any) -> Iterator[_Row]:
    yield (
        message.parent_frame_id, message.child_frame_id, message.timestamp, message.translation,
        message.rotation,
    )  # fmt: skip


def _frame_transforms(message: Any) -> Iterator[_Row]:
    for each in message.transforms:
        yield from _frame_transform(each)


def _gathered(rows: Callable[[Any], Iterator[_Row]]) -> Callable[[Any], list[StampedPoses]]:
    """Return a decoder that gathers rows into arrays, one set for each pair of frames.

    The pairs come in order of first appearance.
    """

    @wraps(rows)
    def decode(message: Any) -> list[StampedPoses]:
        tables: dict[tuple[str, str], list[tuple[float, ...]]] = {}
        for parent, child, time, at, turn in rows(message):
            tables.setdefault((bare(parent), bare(child)), []).append(
                (seconds(time), at.x, at.y, at.z, turn.x, turn.y, turn.z, turn.w)
            )
        return [_poses(table, *frames) for frames, table in tables.items()]

    return decode


def _poses(rows: list[tuple[float, ...]], parent: str, child: str) -> StampedPoses:
    table = np.array(rows, dtype=np.float64)
    good = are_poses(table[:, 0], table[:, 1:4], table[:, 4:])
    refused = int(np.count_nonzero(~good))
    table = table[good]
    return StampedPoses(table[:, 0], table[:, 1:4], unit(table[:, 4:]), parent, child, refused)


POSE_TYPES: dict[str, Callable[[Any], list[StampedPoses]]] = {
    type_: checked(type_, _gathered(rows))
    for type_, rows in {
        "nav_msgs/msg/Odometry": _odometry,
        "geometry_msgs/msg/PoseStamped": _pose_stamped,
        "geometry_msgs/msg/PoseWithCovarianceStamped": _pose_with_covariance_stamped,
        "geometry_msgs/msg/TransformStamped": _transform_stamped,
        "nav_msgs/msg/Path": _path,
        "foxglove.PoseInFrame": _pose_in_frame,
        "foxglove_msgs/msg/PoseInFrame": _pose_in_frame,
    }.items()
}
"""The message types that hold poses of the craft, each with its decoder."""

TRANSFORM_TYPES: dict[str, Callable[[Any], list[StampedPoses]]] = {
    type_: checked(type_, _gathered(rows))
    for type_, rows in {
        "tf2_msgs/msg/TFMessage": _tf_message,
        "tf/msg/tfMessage": _tf_message,
        "foxglove.FrameTransform": _frame_transform,
        "foxglove.FrameTransforms": _frame_transforms,
        "foxglove_msgs/msg/FrameTransform": _frame_transform,
        "foxglove_msgs/msg/FrameTransforms": _frame_transforms,
    }.items()
}
"""The message types that hold transforms between frames, each with its decoder.

Like those of `POSE_TYPES`, they raise `MalformedCloudError` where a message does not fit its type.
"""
