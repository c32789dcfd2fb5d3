"""What can go wrong, as exceptions whose message is the line that the user reads.

A message names the file, topic or key, what was found, and what would be right. A file that is
missing, unreadable, broken or in the way ends the program with exit status 1; wrong usage or
configuration with 2. Arguments of functions stand in backquotes, as in docstrings: `time_source`;
on the command line they are options, --time-source.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Sequence
from typing import Any


class MlsError(Exception):
    """The work failed; the message is one line for the user."""

    exit_status = 1


class InputError(MlsError):
    """A source cannot be read, or does not hold what it should."""


class OutputError(MlsError):
    """An output exists already or cannot be written."""


class ClusterError(MlsError):
    """A cluster of machines cannot be reached, or fails."""


class UsageError(MlsError):
    """An option or argument is wrong, missing or ambiguous."""

    exit_status = 2


class ConfigError(UsageError):
    """A configuration is at fault; every fault of it is listed, a line each.

    Parameters
    ----------
    faults : sequence of str
        One line for each fault, each with its place (``file:line:column: ...``).
    """

    def __init__(self, faults: Sequence[str]) -> None:
        super().__init__("\n".join(faults))
        self.faults = tuple(faults)


# Arguments that are options of a command, under the same name with dashes; and those under others.
_ARGUMENTS = (
    *("add_param", "columns", "crop", "crs", "crs_offset", "cumulative", "end", "every"),
    *("extrinsic", "features", "field_of_view", "filled", "flying_height", "frame", "free_space"),
    *("grid", "headroom", "holes", "jobs", "keep_points", "latest", "legs", "level", "max_slope"),
    *("memory", "origin", "outliers", "overwrite", "pose_gap", "pose_topic", "range"),
    *("reference", "resume", "route", "route_height", "salt_pepper", "scene", "scheduler"),
    *("scratch", "section", "seed", "seeds", "sigma", "scale", "size", "sizes", "slope", "start"),
    *("step", "survey", "time_source", "topic", "transform", "up", "within"),
)
OPTIONS = {name: f"--{name.replace('_', '-')}" for name in _ARGUMENTS}
OPTIONS |= {"kind": "--format", "most": "--views", "sets": "--set", "type_": "--type"}

# A word by itself: names of files and topics that hold backquotes are left alone.
_ARGUMENT = re.compile(r"(?<![^\s(])`([a-z_]+)`(?=[\s:;,]|$)")


def with_options(message: str) -> str:
    """Return a message with arguments named as on the command line: `time_source`, --time-source.

    Parameters
    ----------
    message : str
        Of an error, or a note.
    """
    return _ARGUMENT.sub(lambda found: OPTIONS.get(found[1], found[0]), message)


def expect(value: object, kinds: Any, argument: str, expected: str) -> None:
    """Refuse an argument of a wrong type.

    Parameters
    ----------
    value : object
        The value of the argument.
    kinds : type, or tuple of types
        The types allowed; `Callable` for functions.
    argument : str
        The name of the argument.
    expected : str
        What would be right, in words.

    Raises
    ------
    TypeError
        Where the value is of none of these types.
    """
    if not isinstance(value, kinds):
        raise TypeError(f"`{argument}`: found {type(value).__name__}; expected {expected}")


def expect_path(value: object, argument: str, what: str) -> None:
    """Refuse what is neither a text nor path-like; `what` lies there, in words. See `expect`."""
    expect(value, (str, os.PathLike), argument, f"the path of {what}")


def expect_items(value: object, argument: str, expected: str) -> None:
    """Refuse what cannot be iterated, and a text, whose items are letters. See `expect`."""
    expect(value, Iterable, argument, expected)
    if isinstance(value, str):
        raise TypeError(f"`{argument}`: found the text {value!r}; expected {expected}")


def one_line(words: object) -> str:
    """Return text, such as a library's error, as one line of at most 400 characters."""
    return " ".join(str(words).split())[:400].rstrip(".")


def printable(text: str) -> str:
    """Return text as one line that a terminal shows and does not obey.

    What a recording, or the name of a file, holds beside letters is escaped: controls such as ESC,
    ends of lines, marks that turn the direction of writing, halves of surrogates.
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)


def shorten(text: str, width: int = 60) -> str:
    """Cut a text that is longer than `width` characters."""
    return text if len(text) <= width else f"{text[: width - 3]}..."


def meant(name: str, valid: Iterable[str]) -> str | None:
    """Return the valid name that a wrong one was probably meant to be; None: no one knows."""
    from difflib import get_close_matches

    return next(iter(get_close_matches(name[:100].lower(), list(valid), n=1)), None)


def nearest(name: str, valid: Iterable[str]) -> str:
    """Suggest the valid name that a wrong one was probably meant to be, or list them all."""
    choices = list(valid)
    close = meant(name, choices)
    return f"did you mean {close}?" if close else f"valid here: {', '.join(choices)}"
