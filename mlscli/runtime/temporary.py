"""Temporary files and folders that do not outlive their program, also if it is killed.

Each is locked as long as the program that made it lives, by the system, which lets go of locks
however a program ends. What is found without a lock was left behind, and is removed by the next
program that makes one in the same folder.
"""

from __future__ import annotations

import fcntl
import os
import re
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

_MARK = ".mls-"
_NAME = re.compile(r"\..*\.mls-\w{8}")
# The system limits names to 255 bytes; a character takes up to 4.
_MOST_OF_NAME = 40

KEPT = "replaced"
"""A folder with an entry of this name is not removed, as it may hold the only copy of something."""

_present: set[Path] = set()


@contextmanager
def temporary_file(folder: Path, name: str) -> Iterator[tuple[BinaryIO, Path]]:
    """Make a file for the time of the block, if it is not renamed meanwhile.

    Parameters
    ----------
    folder : Path
        Where it lies.
    name : str
        What its name tells: what it is for.

    Yields
    ------
    stream : binary file
        Open for writing.
    path : Path

    Raises
    ------
    OSError
        No file can be made there.
    """
    remove_abandoned(folder)
    while True:
        handle, path = tempfile.mkstemp(prefix=_prefix(name), dir=folder)
        # Another program may have found it in the moment before it was locked.
        if _lock(handle, wait=True) is None or os.fstat(handle).st_nlink:
            break
        os.close(handle)
    with os.fdopen(handle, "wb") as stream, _while_present(Path(path)):
        yield stream, Path(path)


@contextmanager
def temporary_folder(folder: str | os.PathLike[str] | None, name: str) -> Iterator[Path]:
    """Make a folder for the time of the block; see `temporary_file`.

    Parameters
    ----------
    folder : path or None
        Where it lies; None: in the system's folder for temporary files.
    name : str
    """
    parent = Path(folder or tempfile.gettempdir())
    remove_abandoned(parent)
    while True:
        made = Path(tempfile.mkdtemp(prefix=_prefix(name), dir=parent))
        with suppress(FileNotFoundError):
            handle = os.open(made, os.O_RDONLY | os.O_DIRECTORY)
            if _lock(handle, wait=True) is None or made.exists():
                break
            os.close(handle)
    try:
        with _while_present(made):
            yield made
    finally:
        os.close(handle)


def remove_abandoned(folder: Path) -> None:
    """Remove the temporary files and folders in a folder whose programs have ended."""
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            if _NAME.fullmatch(entry.name):
                _remove_if_abandoned(Path(entry.path))


def remove_present() -> None:
    """Remove the temporary files and folders of this program, which is about to end."""
    for path in tuple(_present):
        _remove(path)


def _remove_if_abandoned(path: Path) -> None:
    with suppress(OSError):
        if path.lstat().st_uid != os.geteuid() or (path / KEPT).exists():
            return
        handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOFOLLOW | os.O_CLOEXEC)
        try:
            if _lock(handle, wait=False):
                _remove(path)
        finally:
            os.close(handle)


@contextmanager
def _while_present(path: Path) -> Iterator[None]:
    _present.add(path)
    try:
        yield
    finally:
        _remove(path)
        _present.discard(path)


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        with suppress(FileNotFoundError):
            path.unlink()


def _prefix(name: str) -> str:
    return f".{name[:_MOST_OF_NAME]}{_MARK}"


def _lock(handle: int, *, wait: bool) -> bool | None:
    """Return whether a file could be locked; None where its disk knows no locks."""
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
    except BlockingIOError:
        return False
    except OSError:
        return None
    return True
