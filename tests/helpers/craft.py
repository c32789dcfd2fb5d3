"""Recordings of a craft that turns and shifts, and where the points of its sensors must come out.

What must come out is computed here with 4 x 4 matrices.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from mlscli.io.reading.recording import Recording, open_recording
from mlscli.runtime.arrays import Float64
from tests.helpers.bags import Told, write_told
from tests.helpers.ros import header, vector

POINTS = np.array([[1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.5, -1.0, 3.0]])
SECOND = 10**9
BEGIN = 1_600_000_000

Pose = tuple[tuple[float, float, float], tuple[float, float, float]]
"""x, y, z, and the angles of turns about x, y and z in degrees."""

FIRST: Pose = ((10.0, -4.0, 2.0), (10.0, -20.0, 30.0))
SECOND_POSE: Pose = ((14.0, 0.0, 3.0), (-15.0, 5.0, 80.0))
MOUNT: Pose = ((0.3, 0.1, -0.2), (180.0, 10.0, 45.0))
LEVER: Pose = ((0.0, 0.5, 0.1), (0.0, 90.0, -30.0))


def rotation(pose: Pose) -> Rotation:
    return Rotation.from_euler("xyz", pose[1], degrees=True)


def matrix(pose: Pose) -> Float64:
    whole = np.eye(4)
    whole[:3, :3], whole[:3, 3] = rotation(pose).as_matrix(), pose[0]
    return whole


def between(first: Pose, second: Pose, share: float) -> Float64:
    """Return the matrix of a pose on the way from one to another."""
    whole = np.eye(4)
    turns = Rotation.concatenate([rotation(first), rotation(second)])
    whole[:3, :3] = Slerp([0.0, 1.0], turns)(share).as_matrix()
    whole[:3, 3] = (1 - share) * np.array(first[0]) + share * np.array(second[0])
    return whole


def moved(*matrices: Float64, points: Float64 = POINTS) -> Float64:
    """Return points moved by the product of matrices."""
    whole = np.eye(4)
    for each in matrices:
        whole = whole @ each
    return points @ whole[:3, :3].T + whole[:3, 3]


def content(pose: Pose, place: str, turn: str) -> dict[str, Any]:
    return {place: vector(*pose[0]), turn: vector(*rotation(pose).as_quat())}


def stamp(seconds: float) -> int:
    return round(seconds * SECOND)


def head(seconds: float, frame: str) -> dict[str, Any]:
    whole, rest = divmod(stamp(seconds), SECOND)
    return header(BEGIN + whole, rest, frame)


def log_time(seconds: float) -> int:
    """Return when a message is recorded: a while after the time in its header."""
    return (BEGIN + 1000) * SECOND + stamp(seconds)


def cloud(seconds: float, frame: str, points: Float64 = POINTS, topic: str = "/cloud") -> Told:
    listed = [vector(*point) for point in points.tolist()]
    message = {"header": head(seconds, frame), "points": listed}
    return Told(topic, "sensor_msgs/msg/PointCloud", message, log_time(seconds))


def transform(
    seconds: float, parent: str, child: str, pose: Pose, *, stays: bool = False, old: bool = False
) -> Told:
    each = {
        "header": head(seconds, parent),
        "child_frame_id": child,
        "transform": content(pose, "translation", "rotation"),
    }
    type_ = "tf/msg/tfMessage" if old else "tf2_msgs/msg/TFMessage"
    topic = "/tf_static" if stays else "/tf"
    return Told(topic, type_, {"transforms": [each]}, log_time(seconds))


def odometry(seconds: float, pose: Pose, parent: str = "odom", child: str = "base_link") -> Told:
    message = {
        "header": head(seconds, parent),
        "child_frame_id": child,
        "pose": {"pose": content(pose, "position", "orientation")},
    }
    return Told("/odometry", "nav_msgs/msg/Odometry", message, log_time(seconds))


def pose_stamped(seconds: float, pose: Pose, parent: str = "world") -> Told:
    message = {
        "header": head(seconds, parent),
        "pose": content(pose, "position", "orientation"),
    }
    return Told("/pose", "geometry_msgs/msg/PoseStamped", message, log_time(seconds))


def moving(parent: str = "map", child: str = "base_link", **options: Any) -> list[Told]:
    """Return a frame's transforms at 0 and at 4 s."""
    return [
        transform(0, parent, child, FIRST, **options),
        transform(4, parent, child, SECOND_POSE, **options),
    ]


def opened(path: Path, messages: Iterable[Told], kind: str = "ros1", **options: Any) -> Recording:
    told = sorted(messages, key=lambda message: message.log_time)
    return open_recording(write_told(path / "flight", told, kind), **options)


def at(x: float) -> Pose:
    return (x, 0.0, 0.0), (0.0, 0.0, 0.0)


def recorded(told: Told, seconds: float, topic: str = "") -> Told:
    """Return a message recorded at another time, so many seconds after the beginning."""
    when = (BEGIN + 1000) * SECOND + round(seconds * SECOND)
    return told._replace(log_time=when, topic=topic or told.topic)


def run(
    begin: float, shift: float, times: range = range(11), parent: str = "map", topic: str = "/tf"
) -> list[Told]:
    """Return the transforms of a run: at k s after its beginning the craft is at k + shift."""
    return [
        recorded(transform(k, parent, "base_link", at(k + shift)), begin + k, topic) for k in times
    ]


def seen(begin: float, *times: float, frame: str = "base_link") -> list[Told]:
    return [recorded(cloud(k, frame), begin + k + 0.01) for k in times]


def clouds_of(recording: Recording) -> list[Float64]:
    return [keyframe.points for keyframe in recording.keyframes()]


def positions_of(recording: Recording) -> list[tuple[float, float, float]]:
    return [keyframe.position for keyframe in recording.keyframes()]


def assert_near(found: Any, expected: Any) -> None:
    np.testing.assert_allclose(found, expected, atol=1e-6)
