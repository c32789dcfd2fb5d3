"""The formats there are, and how they are told: by content, never by name."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from mlscli.errors import InputError
from mlscli.io.base import Source

READABLE = "text clouds, ROS 1 bags, and ROS 2 bags (a folder with metadata.yaml, .db3, .mcap)"

_HEAD = 1 << 16
_CONTROL = re.compile(rb"[\x00-\x08\x0e-\x1f\x7f]")


def open_source(path: Path, topic: str | None = None, columns: str | None = None) -> Source:
    """Tell the format of a file or folder by its content and open it.

    Parameters
    ----------
    path : Path
    topic : str, optional
        The topic of the clouds, in formats that have topics.
    columns : str, optional
        What the columns of a text cloud are, such as ``x,y,z,-,keyframe``.

    Raises
    ------
    InputError
        It is missing, unreadable, broken, or of a format that cannot be read.
    """
    for format_ in _FORMATS:
        if format_.holds(path, _head(path)):
            if format_.open is None:
                raise InputError(
                    f"{path}: is {format_.name}, which cannot be read; can be read: {READABLE}"
                )
            return format_.open(path, topic, columns)
    raise InputError(f"{path}: holds {_content(path)}; can be read: {READABLE}")


class _Format(NamedTuple):
    name: str
    holds: Callable[[Path, bytes], bool]
    open: Callable[[Path, str | None, str | None], Source] | None = None


def _starting(*magics: bytes) -> Callable[[Path, bytes], bool]:
    return lambda _, head: head.removeprefix(b"\xef\xbb\xbf").startswith(magics)


def _folder_with(*names: str) -> Callable[[Path, bytes], bool]:
    return lambda path, _: any((path / name).exists() for name in names)


def _open_rosbag(kind: str, suffix: str) -> Callable[[Path, str | None, str | None], Source]:
    def open_(path: Path, topic: str | None, _: str | None) -> Source:
        from mlscli.io.rosbag import RosBag

        return RosBag(path, kind, suffix, topic)

    return open_


def _open_text(path: Path, _: str | None, columns: str | None) -> Source:
    from mlscli.io.text import TextCloud

    return TextCloud(path, columns)


def _is_text(path: Path, head: bytes) -> bool:
    return path.is_file() and bool(head.strip()) and not _CONTROL.search(head)


_FORMATS = (
    _Format("ROS 2 bag", _folder_with("metadata.yaml"), _open_rosbag("ROS 2 bag", "")),
    _Format("ROS 1 bag", _starting(b"#ROSBAG V2.0"), _open_rosbag("ROS 1 bag", ".bag")),
    _Format("MCAP", _starting(b"\x89MCAP0\r\n"), _open_rosbag("ROS 2 bag (MCAP)", ".mcap")),
    _Format("SQLite", _starting(b"SQLite format 3\0"), _open_rosbag("ROS 2 bag (SQLite)", ".db3")),
    _Format("a bag of a ROS 1 version before 2.0", _starting(b"#ROSBAG V", b"#ROSRECORD")),
    _Format("a PLY file", _starting(b"ply\n", b"ply\r")),
    _Format("a PCD file", _starting(b"# .PCD", b"VERSION 0.", b"VERSION .")),
    _Format("a LAS or LAZ file", _starting(b"LASF")),
    _Format(
        "a COLMAP text model", _starting(b"# 3D point list", b"# Image list", b"# Camera list")
    ),
    _Format("a COLMAP model", _folder_with("points3D.bin", "points3D.txt")),
    _Format("an OpenSfM reconstruction", _folder_with("reconstruction.json")),
    _Format("a JSON file", _starting(b"{", b"[")),
    _Format("a gzip archive", _starting(b"\x1f\x8b")),
    _Format("a zip archive or numpy's .npz", _starting(b"PK\x03\x04")),
    _Format("text", _is_text, _open_text),
)


def _head(path: Path) -> bytes:
    """Return the first bytes of a file; none of a folder."""
    try:
        if path.is_dir():
            return b""
        if not path.exists():
            raise InputError(f"{path}: there is no such file or folder")
        if not path.is_file():
            raise InputError(f"{path}: is neither a file nor a folder")
        with path.open("rb") as file:
            return file.read(_HEAD)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error


def _content(path: Path) -> str:
    """Say what a file or folder of no known format holds."""
    if path.is_dir():
        names = sorted(os.listdir(path))  # noqa: PTH208
        listed = ", ".join(names[:5]) + (", ..." if len(names) > 5 else "")
        return f"{listed or 'nothing'}, and no metadata.yaml, which makes a folder a ROS 2 bag"
    head = _head(path)
    return "binary data of no known format" if head.strip() else "nothing"
