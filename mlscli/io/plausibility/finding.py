"""The answer to whether data is what its header claims: right, right with a note, or refused."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, NamedTuple, TypeVar

T = TypeVar("T")


class Finding(NamedTuple, Generic[T]):
    """What data is, by its header and by itself.

    Attributes
    ----------
    value : T or None
        What it is taken for; None where it is refused.
    note : str
        What is doubted, and what counts instead, as part of a sentence after the name of what was
        read; empty where the header is right. It has no numbers that change from message to
        message, so that equal notes can be counted.
    refusal : str
        Why it cannot be read; empty where it can.
    """

    value: T | None
    note: str = ""
    refusal: str = ""

    def accepted(self, error: Callable[[str], Exception]) -> T:
        """Return the value, or raise what `error` makes of the refusal."""
        if self.value is None:
            raise error(self.refusal)
        return self.value


def right(value: T) -> Finding[T]:
    """Return that the header is right."""
    return Finding(value)


def doubted(value: T, note: str) -> Finding[T]:
    """Return what is read in spite of a doubt, with the doubt."""
    return Finding(value, note)


def refused(reason: str) -> Finding[T]:
    """Return that nothing can be read, and why."""
    return Finding(None, refusal=reason)
