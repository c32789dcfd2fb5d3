"""What can go wrong, as exceptions whose message is the line the user reads.

A message names the file, topic or key, what was found, and what would be right. A file that
is missing, unreadable, broken or in the way ends with exit status 1; words that were typed
wrong, in options or in a configuration, with 2.
"""

from __future__ import annotations

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
