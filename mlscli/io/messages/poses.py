"""Decode messages that hold poses or transforms: from deserialized messages to arrays.

References
----------
geometry_msgs, nav_msgs/Odometry and Path, tf2_msgs/TFMessage, and Foxglove's PoseInFrame and
FrameTransform: each gives the pose of the child frame in the parent frame.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import wraps
from typing import Any, TypeAlias

import numpy as np

from mlscli.geometry.poses import are_poses, unit
from mlscli.geometry.transforms import bare
from mlscli.io.messages.parts import checked, seconds
from mlscli.io.source import StampedPoses
from mlscli.runtime.arrays import Bool, Float64

PoseRow: TypeAlias = tuple[str, str, float, float, float, float, float, float, float, float]
"""Parent and child frame, time (s), x, y, z, and the quaternion x, y, z, w, of any length."""

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


def _table(rows: Callable[[Any], Iterator[_Row]]) -> Callable[[Any], list[PoseRow]]:
    """Return a decoder that makes names and numbers of what rows hold."""

    @wraps(rows)
    def decode(message: Any) -> list[PoseRow]:
        return [
            (
                bare(parent), bare(child), seconds(time), float(at.x), float(at.y), float(at.z),
                float(turn.x), float(turn.y), float(turn.z), float(turn.w),
            )
            for parent, child, time, at, turn in rows(message)
        ]  # fmt: skip

    return decode


def stamped(messages: Sequence[Sequence[PoseRow]]) -> list[list[StampedPoses]]:
    """Return the poses of each message, a set for each pair of frames, in order of appearance.

    Of many messages at once, as arrays of a row each take a hundred times as long.
    """
    table = np.array([row[2:] for rows in messages for row in rows]).reshape(-1, 8)
    with np.errstate(all="ignore"):
        good = are_poses(table[:, 0], table[:, 1:4], table[:, 4:])
        quaternions = unit(table[:, 4:])
    found, begin = [], 0
    for rows in messages:
        places: dict[tuple[str, str], list[int]] = {}
        for place, row in enumerate(rows, begin):
            places.setdefault(row[:2], []).append(place)
        begin += len(rows)
        found.append([_poses(table, quaternions, good, *each) for each in places.items()])
    return found


def _poses(
    table: Float64, quaternions: Float64, good: Bool, frames: tuple[str, str], places: list[int]
) -> StampedPoses:
    """Return the good ones of the poses at some places, ascending."""
    first, last = places[0], places[-1] + 1
    rows: slice | list[int] = slice(first, last)
    if last - first > len(places) or not good[rows].all():
        rows = [place for place in places if good[place]]
    count = last - first if isinstance(rows, slice) else len(rows)
    return StampedPoses(
        table[rows, 0], table[rows, 1:4], quaternions[rows], *frames, len(places) - count
    )


POSE_TYPES: dict[str, Callable[[Any], list[PoseRow]]] = {
    type_: checked(type_, _table(rows))
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

TRANSFORM_TYPES: dict[str, Callable[[Any], list[PoseRow]]] = {
    type_: checked(type_, _table(rows))
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
