"""Containers of messages, told by their content."""

from __future__ import annotations

from pathlib import Path

from mlscli.errors import InputError
from mlscli.io import mcapfile, mcaprecords, ros1bag
from mlscli.io.container import Container

_OLD_BAGS = (b"#ROSBAG V", b"#ROSRECORD")


def open_container(path: Path) -> Container:
    """Tell by its content what a file is and open it.

    Raises
    ------
    InputError
        It is no container of messages, or one that cannot be read at all.
    """
    try:
        with path.open("rb") as file:
            head = file.read(16)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error
    if head.startswith((ros1bag.MAGIC, *_OLD_BAGS)):
        return ros1bag.Ros1Bag(path)
    if head.startswith(mcaprecords.MAGIC):
        return mcapfile.McapFile(path)
    found = f"begins with {head!r}" if head else "is empty"
    raise InputError(f"{path}: {found}, expected a ROS 1 bag or an MCAP file")
