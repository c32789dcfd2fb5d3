"""The losses of a file: what could not be read, added up and reported in one line."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from mlscli.io.ros import NANOSECONDS
from mlscli.words import some

_NAMED = 4
"""How many topics a line names."""


class DamagedError(ValueError):
    """A part of a file is not what its format says; the message states what was found.

    Parameters
    ----------
    fault : str
    content : bytes, optional
        What it holds, by which the loss can be counted.
    """

    def __init__(self, fault: str, content: bytes = b"") -> None:
        super().__init__(fault)
        self.content = content


@dataclass
class Losses:
    """The losses of one file.

    Attributes
    ----------
    path : Path
        The name of the file in messages to the user.
    messages : Counter of str
        How many messages of each topic are lost, as far as it can be known; "" is an unknown one.
    nanoseconds, size : int
        How long a time and how many bytes are lost.
    reasons : list of str
        What is wrong, in the order in which it was found.
    """

    path: Path
    messages: Counter[str] = field(default_factory=Counter)
    nanoseconds: int = 0
    size: int = 0
    reasons: list[str] = field(default_factory=list)

    def add(
        self,
        reason: str,
        *,
        messages: int | Mapping[str, int] = 0,
        nanoseconds: int = 0,
        size: int = 0,
    ) -> None:
        """Add a loss; messages of one number are of an unknown topic."""
        self.messages.update({"": messages} if isinstance(messages, int) else messages)
        self.nanoseconds += nanoseconds
        self.size += size
        self.reasons.append(reason)

    def settle(self, came: Mapping[str, int], declared: Mapping[str, int]) -> None:
        """Compare the messages read with those declared, by topic, at the end of a pass."""
        missing = Counter({topic: declared[topic] - came.get(topic, 0) for topic in declared})
        if any(count > 0 for count in missing.values()) and not self.reasons:
            messages = some(sum(declared.values()), "message")
            self.reasons.append(f"yields {sum(came.values()):,} of {messages} declared")
        unknown = self.messages.pop("", 0)
        self.messages |= missing
        self.messages[""] = max(0, unknown - sum((+missing).values()))

    @property
    def total(self) -> int:
        """How many messages are lost."""
        return sum(self.messages.values())

    def copy(self) -> Losses:
        """Return a copy; adding to it leaves the original as it is."""
        return replace(self, messages=self.messages.copy(), reasons=list(self.reasons))

    def lines(self) -> list[str]:
        """Return one line that sums up all losses; an empty list where there are none."""
        if not self.reasons:
            return []
        more = len(self.reasons) - 1
        line = f"{self.path}: {self.reasons[0]}"
        if more:
            line += f", and {some(more, 'more fault')}"
        amounts = [
            *([some(self.total, "message") + self._topics()] if self.total else []),
            *([f"{self.nanoseconds / NANOSECONDS:.3f} s"] if self.nanoseconds else []),
            *([some(self.size, "byte")] if self.size else []),
        ]
        return [f"{line}; lost: {', '.join(amounts)}" if amounts else line]

    def _topics(self) -> str:
        """Return in brackets how many messages of which topics are lost, where they are known."""
        known = +self.messages
        if not known or set(known) == {""}:
            return ""
        order = sorted(known.items(), key=lambda item: (not item[0], -item[1], item[0]))
        named = [f"{count:,} of {topic or 'unknown topics'}" for topic, count in order[:_NAMED]]
        rest = sum(count for _, count in order[_NAMED:])
        return f" ({', '.join(named)}{f', {rest:,} of others' if rest else ''})"
