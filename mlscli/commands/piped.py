"""``-`` as the name of an input: what comes on standard input, as a file.

It is read more than once, and at any place of it, so it is kept in a file that has no name and
disappears with the program; `STANDARD_INPUT` opens it, and stands for it in messages.
"""

from __future__ import annotations

import os
import shutil
import stat
import sys
import tempfile
from typing import Any

import click

from mlscli.errors import OutputError, UsageError

STANDARD_INPUT = "/dev/stdin"

_taken: list[str] = []


def piped(context: click.Context, option: click.Parameter, given: Any) -> Any:
    """Put a file in the place of ``-``: the callback of options and arguments that name inputs."""
    if context.resilient_parsing:
        return given
    if isinstance(given, tuple):
        return tuple(_file(each, option) for each in given)
    return _file(given, option)


def _file(name: Any, option: click.Parameter) -> Any:
    if name != "-":
        return name
    place = option.human_readable_name if isinstance(option, click.Argument) else option.opts[-1]
    if _taken:
        raise UsageError(f"{place} -: standard input is {_taken[0]} already; name a file")
    _taken.append(place)
    if sys.stdin.isatty():
        raise UsageError(f"{place} -: standard input is a terminal; send a file into it: < FILE")
    if not stat.S_ISREG(os.fstat(0).st_mode):
        _keep()
    return STANDARD_INPUT


def _keep() -> None:
    """Have standard input be a file that holds what came."""
    try:
        with tempfile.TemporaryFile() as file:
            shutil.copyfileobj(sys.stdin.buffer, file)
            file.flush()
            os.dup2(file.fileno(), 0)
    except OSError as error:
        raise OutputError(
            f"standard input cannot be kept in {tempfile.gettempdir()}: {error.strerror or error}; "
            "TMPDIR names another folder"
        ) from error
