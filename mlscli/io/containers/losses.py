"""The losses of a file: what could not be read, added up and reported in one line."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

from mlscli.io.ros import NANOSECONDS


class DamagedError(ValueError):
    """A part of a file is not what its format says; the message states what was found."""


@dataclass
class Losses:
    """The losses of one file.

    Attributes
    ----------
    path : Path
        The name of the file in messages to the user.
    messages, nanoseconds, size : int
        What is lost, as far as it can be known; `size` in bytes.
    reasons : list of str
        What is wrong, in the order in which it was found.
    """

    path: Path
    messages: int = 0
    nanoseconds: int = 0
    size: int = 0
    reasons: list[str] = field(default_factory=list)

    def add(self, reason: str, *, messages: int = 0, nanoseconds: int = 0, size: int = 0) -> None:
        """Add a loss."""
        self.messages += messages
        self.nanoseconds += nanoseconds
        self.size += size
        self.reasons.append(reason)

    def settle(self, came: int, declared: int) -> None:
        """Compare the number of messages read with the number declared, at the end of a pass."""
        missing = declared - came
        if missing > 0 and not self.reasons:
            self.reasons.append(f"yields {came:,} of {declared:,} messages declared")
        self.messages = max(self.messages, missing)

    def copy(self) -> Losses:
        """Return a copy; adding to it leaves the original as it is."""
        return replace(self, reasons=list(self.reasons))

    def lines(self) -> list[str]:
        """Return one line that sums up all losses; an empty list where there are none."""
        if not self.reasons:
            return []
        more = len(self.reasons) - 1
        line = f"{self.path}: {self.reasons[0]}"
        if more:
            line += f", and {more:,} more {'fault' if more == 1 else 'faults'}"
        amounts = [
            *([_plural(self.messages, "message")] if self.messages else []),
            *([f"{self.nanoseconds / NANOSECONDS:.3f} s"] if self.nanoseconds else []),
            *([_plural(self.size, "byte")] if self.size else []),
        ]
        return [f"{line}; lost: {', '.join(amounts)}" if amounts else line]


def _plural(count: int, noun: str) -> str:
    return f"{count:,} {noun}{'' if count == 1 else 's'}"
