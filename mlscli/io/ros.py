"""Constants and types of ROS, for readers and writers of its files."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

NANOSECONDS = 10**9
"""Nanoseconds in a second."""

METADATA_FILE = "metadata.yaml"
"""The file that marks a folder as a ROS 2 bag."""

DATATYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""The datatype numbers of sensor_msgs/PointField, each with its numpy type."""

# Types of ROS 1 that rosbags lacks for Noetic.
_TRANSFORMS = "geometry_msgs/TransformStamped[] transforms"
_BESIDE_ROS1 = {"tf2_msgs/msg/TFMessage": _TRANSFORMS, "tf/msg/tfMessage": _TRANSFORMS}


def usual_types(*, is_ros1: bool) -> Typestore:
    """Return the message types of ROS 1 Noetic, or of the latest distribution of ROS 2."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    if not is_ros1:
        return get_typestore(Stores.LATEST)
    store = get_typestore(Stores.ROS1_NOETIC)
    for type_, text in _BESIDE_ROS1.items():
        store.register(get_types_from_msg(text, type_))
    return store
