"""The names of message types."""

from __future__ import annotations


def ros2_name(name: str) -> str:
    """Return the name of a ROS type as ROS 2 writes it, with `msg` between package and type."""
    package, slash, type_ = name.partition("/")
    return f"{package}/msg/{type_}" if slash and "/" not in type_ else name
