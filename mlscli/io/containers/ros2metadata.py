"""The `metadata.yaml` of a ROS 2 bag: which files it is made of, and what they should hold."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any, NamedTuple

from mlscli.errors import InputError, one_line
from mlscli.io.files import open_text_input
from mlscli.io.ros import METADATA_FILE

STORAGE = re.compile(r"\.(?:db3|mcap)(?:\.zstd|\.zst)?$")
"""The end of the name of a file of messages."""

# A thousand topics, or ten thousand files, take less.
_LARGEST_BYTES = 1 << 22


class Declared(NamedTuple):
    """What the metadata declare of a file; 0 where they declare nothing.

    Attributes
    ----------
    messages : int
        Number of messages.
    nanoseconds : int
        Duration.
    """

    messages: int = 0
    nanoseconds: int = 0


@dataclass
class Metadata:
    """The content of a `metadata.yaml`.

    Attributes
    ----------
    files : dict of str to Declared
        What each file should hold, by its name, in the order of recording.
    messages : int or None
        Number of messages that all files should hold; None where not stated.
    """

    files: dict[str, Declared] = field(default_factory=dict)
    messages: int | None = None

    @classmethod
    def read(cls, folder: Path, notes: list[str]) -> Metadata:
        """Read the metadata of a bag; if they cannot be read, return empty ones and add a note."""
        import yaml

        path = folder / METADATA_FILE
        try:
            with open_text_input(path) as file:
                content = yaml.safe_load(file.read(_LARGEST_BYTES))
        except FileNotFoundError:
            notes.append(f"{folder}: has no {METADATA_FILE}; all its .db3 and .mcap files are read")
            return cls()
        except InputError:
            raise
        # PyYAML fails in many ways where a value does not fit its tag.
        except Exception as error:
            notes.append(
                f"{path}: cannot be read: {one_line(error)}; all .db3 and .mcap files are read"
            )
            return cls()
        return cls._of(_get(content, "rosbag2_bagfile_information"))

    @classmethod
    def _of(cls, content: object) -> Metadata:
        details = {
            _name(entry.get("path")): Declared(
                _count(entry.get("message_count")) or 0,
                _count(_get(entry.get("duration"), "nanoseconds")) or 0,
            )
            for entry in _list(_get(content, "files"))
            if isinstance(entry, dict)
        }
        names = [_name(path) for path in _list(_get(content, "relative_file_paths"))]
        files = {name: details.get(name, Declared()) for name in [*names, *details] if name}
        messages = _count(_get(content, "message_count"))
        if len(files) == 1 and messages is not None:
            # Before version 5 nothing is declared for each file.
            nanoseconds = _count(_get(_get(content, "duration"), "nanoseconds")) or 0
            files = {name: Declared(messages, nanoseconds) for name in files}
        return cls(files, messages)


def _get(content: object, key: str) -> Any:
    return content.get(key) if isinstance(content, dict) else None


def _list(content: object) -> list[Any]:
    return content if isinstance(content, list) else []


# Counts have 64 bits; Python would refuse to print a number of thousands of digits.
_MOST = 1 << 63


def _count(content: object) -> int | None:
    return content if isinstance(content, int) and 0 <= content < _MOST else None


def _name(path: object) -> str:
    """Return the name of a file, without its folder, which metadata before version 4 state, too."""
    return PurePosixPath(PureWindowsPath(path if isinstance(path, str) else "").as_posix()).name
