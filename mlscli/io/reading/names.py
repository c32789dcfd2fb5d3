"""What the names of frames tell, by the customs of ROS."""

from __future__ import annotations

from mlscli.geometry.transforms import bare
from mlscli.keyframes.keyframe import Axes

WORLD_FRAMES = (
    *("map", "odom", "odom_combined", "world", "earth", "global", "origin", "local_origin"),
    *("camera_init", "vicon"),
)
"""Names of world frames, which stand still, in any namespace."""

BODY_FRAMES = ("base_link", "base_footprint", "base", "body", "base_stabilized", "imu_link")
"""Usual names of the craft's own frame, the likeliest first."""

LEVEL_FRAMES = ("base_link", "base_footprint", "base", "base_stabilized")
"""Names of frames whose z points up on a craft that is level, by REP 103 and REP 105 of ROS."""


def is_world(frame: str) -> bool:
    """Return whether a frame has the name of a world frame, in any namespace."""
    return bare(frame).rpartition("/")[2] in WORLD_FRAMES


def is_body(frame: str) -> bool:
    """Return whether a frame has a usual name of the craft's own, in any namespace."""
    return bare(frame).rpartition("/")[2] in BODY_FRAMES


def axes_of(frame: str) -> Axes:
    """Return whose axes those of a frame are, by its name: REP 103 of ROS."""
    name = bare(frame).rpartition("/")[2]
    if "optical" in name:
        return "camera"
    return "body" if name in LEVEL_FRAMES else "unknown"
