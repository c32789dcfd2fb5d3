"""What of a file could not be read, added up and told in one line."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

from mlscli.io.ros import NANOSECONDS


class DamagedError(ValueError):
    """A part of a file is not what its format says; says what was found there."""


@dataclass
class Losses:
    """The losses of one file.

    Attributes
    ----------
    path : Path
        What messages to the user call the file.
    messages, nanoseconds, size : int
        What is lost, as far as it can be known; `size` in bytes.
    reasons : list of str
        Why, in the order of their finding.
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
        """Compare how many messages came with how many were declared, when a pass has ended."""
        missing = declared - came
        if missing > 0 and not self.reasons:
            self.reasons.append(f"yields {came:,} of {declared:,} messages declared")
        self.messages = max(self.messages, missing)

    def copy(self) -> Losses:
        """Return losses to which can be added without changing these."""
        return replace(self, reasons=list(self.reasons))

    def lines(self) -> list[str]:
        """Return the line that tells all of it, or nothing."""
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
