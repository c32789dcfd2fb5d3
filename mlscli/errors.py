"""What can go wrong, as exceptions whose message is the line the user reads.

A message names the file, topic or key, what was found, and what would be right. A file that
is missing, unreadable, broken or in the way ends with exit status 1; words that were typed
wrong, in options or in a configuration, with 2. Arguments of functions stand in backquotes, as in
docstrings: `time_source`; on the command line they are options, --time-source.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence


class MlsError(Exception):
    """The work failed; the message is one line for the user."""

    exit_status = 1


class InputError(MlsError):
    """A source cannot be read, or does not hold what it should."""


class OutputError(MlsError):
    """An output exists already or cannot be written."""


class ClusterError(MlsError):
    """A cluster of machines cannot be reached, or not do what it should."""


class UsageError(MlsError):
    """An option or argument is wrong, missing or ambiguous."""

    exit_status = 2


class ConfigError(UsageError):
    """A configuration is at fault; every fault of it is listed, a line each.

    Parameters
    ----------
    faults
        One line for each fault, each with its place (``file:line:column: ...``).
    """

    def __init__(self, faults: Sequence[str]) -> None:
        super().__init__("\n".join(faults))
        self.faults = tuple(faults)


_ARGUMENT = re.compile(r"`([a-z][a-z_]*)`")
_OPTIONS = {"sets": "--set"}


def with_options(message: str) -> str:
    """Return a message with arguments named as on the command line: `time_source`, --time-source.

    Parameters
    ----------
    message : str
        Of an error, or a note.
    """
    return _ARGUMENT.sub(
        lambda found: _OPTIONS.get(found[1], f"--{found[1].rstrip('_').replace('_', '-')}"), message
    )


def expect(value: object, kinds: type | tuple[type, ...], argument: str, expected: str) -> None:
    """Refuse an argument of another type.

    Parameters
    ----------
    value : object
    kinds : type or tuple of types
        Those allowed.
    argument : str
        What the caller calls it.
    expected : str
        What would be right, in words.

    Raises
    ------
    TypeError
    """
    if not isinstance(value, kinds):
        raise TypeError(f"`{argument}`: found {type(value).__name__}; expected {expected}")


def one_line(words: object) -> str:
    """Return words, as a library's error or names that a file holds, as a line not too long."""
    return " ".join(str(words).split())[:400].rstrip(".")


def shorten(text: str, width: int = 60) -> str:
    """Cut a text that is too long for a message."""
    return text if len(text) <= width else f"{text[: width - 3]}..."


def nearest(name: str, valid: Iterable[str]) -> str:
    """Suggest the valid name that a wrong one was probably meant to be, or list them all."""
    from difflib import get_close_matches

    choices = list(valid)
    close = get_close_matches(name[:100].lower(), choices, n=1)
    return f"did you mean {close[0]}?" if close else f"valid here: {', '.join(choices)}"
