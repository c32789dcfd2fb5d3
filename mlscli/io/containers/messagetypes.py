"""The names of message types."""

from __future__ import annotations


def ros2_name(name: str) -> str:
    """Return the name of a ROS type as ROS 2 writes it, with `msg` between package and type.

    Recorders of DDS name the same types as C++ and DDS do, ``sensor_msgs::msg::PointCloud2`` and
    ``sensor_msgs::msg::dds_::PointCloud2_``.
    """
    if "::" in name:
        name = name.replace("::", "/")
        if "/dds_/" in name:
            name = name.replace("/dds_/", "/").removesuffix("_")
    package, slash, type_ = name.partition("/")
    return f"{package}/msg/{type_}" if slash and "/" not in type_ else name
