"""Files as inputs: regular files alone are read, and opening one never waits."""

from __future__ import annotations

import errno
import io
import os
import stat
from pathlib import Path
from typing import BinaryIO, TextIO

from mlscli.errors import InputError


def special(path: str | os.PathLike[str]) -> str:
    """Return what lies there if it is neither a file nor a folder: ``a FIFO``; otherwise nothing.

    Links are followed. Nothing is said of what is missing or out of reach.
    """
    try:
        mode = Path(path).stat().st_mode
    except OSError:
        return ""
    return _special(mode)


def expect_file(path: str | os.PathLike[str]) -> None:
    """Refuse an input that is neither a file nor a folder, before something opens it and waits.

    Raises
    ------
    InputError
        Naming what it is: a FIFO, a device or a socket.
    """
    if found := special(path):
        raise _refused(path, found)


def open_input(path: str | os.PathLike[str]) -> BinaryIO:
    """Open a regular file for reading.

    Raises
    ------
    OSError
        It cannot be opened.
    InputError
        It is a FIFO, a device or a socket: to open or read one may take forever.
    """
    # A socket cannot be opened.
    expect_file(path)
    # What has become a FIFO meanwhile does not wait for its other end.
    handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        mode = os.fstat(handle).st_mode
        if found := _special(mode):
            raise _refused(path, found)
        if stat.S_ISDIR(mode):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    except BaseException:
        os.close(handle)
        raise
    return open(handle, "rb")  # noqa: PTH123  # a number, no path


def open_text_input(path: str | os.PathLike[str], encoding: str = "utf-8") -> TextIO:
    """Open a regular file for reading as text; what is no text of this encoding is replaced.

    Raises
    ------
    OSError, InputError
        As `open_input`.
    """
    return io.TextIOWrapper(open_input(path), encoding=encoding, errors="replace")


def read_input(path: str | os.PathLike[str]) -> bytes:
    """Return the bytes of a regular file; raises as `open_input`."""
    with open_input(path) as file:
        return file.read()


def _special(mode: int) -> str:
    if stat.S_ISFIFO(mode):
        return "a FIFO"
    if stat.S_ISCHR(mode) or stat.S_ISBLK(mode):
        return "a device"
    return "a socket" if stat.S_ISSOCK(mode) else ""


def _refused(path: str | os.PathLike[str], found: str) -> InputError:
    return InputError(f"{Path(path)}: is {found}, expected a file; save what it holds as one")
