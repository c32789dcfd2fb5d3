"""Open containers of messages, recognised by their content."""

from __future__ import annotations

from pathlib import Path

from mlscli.errors import InputError
from mlscli.io.containers import mcapfile, mcaprecords, ros1bag, sqlitefile
from mlscli.io.containers.compression import ZSTD_MAGIC
from mlscli.io.containers.container import Container
from mlscli.io.files import open_input

_OLD_BAGS = (b"#ROSBAG V", b"#ROSRECORD")


def open_container(path: Path) -> Container:
    """Recognise a container by its content and open it.

    A folder, or a file compressed with zstd, is taken as a ROS 2 bag.

    Raises
    ------
    InputError
        The path is no container of messages, or one that cannot be read at all.
    """
    try:
        if path.is_dir():
            head = b""
        elif path.exists() and not path.is_file():
            raise InputError(f"{path}: is neither a file nor a folder")
        else:
            with open_input(path) as file:
                head = file.read(16)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error
    if path.is_dir() or head.startswith(ZSTD_MAGIC):
        from mlscli.io.containers.ros2bag import Ros2Bag

        return Ros2Bag(path)
    if head.startswith((ros1bag.MAGIC, *_OLD_BAGS)):
        return ros1bag.Ros1Bag(path)
    if head.startswith(mcaprecords.MAGIC):
        return mcapfile.McapFile(path)
    if head.startswith(sqlitefile.MAGIC):
        return sqlitefile.SqliteFile(path)
    found = f"begins with {head!r}" if head else "is empty"
    raise InputError(
        f"{path}: {found}, expected a ROS 1 bag, an MCAP file, or a ROS 2 bag: a folder or a "
        "SQLite file"
    )
