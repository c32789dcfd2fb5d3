"""What the user should hear while the program works; the library itself says nothing."""

from __future__ import annotations

from collections.abc import Callable

_hearers: list[Callable[[str], None]] = []


def hear(hearer: Callable[[str], None]) -> None:
    """Have every notice of this process told to `hearer`, a line each."""
    _hearers.append(hearer)


def notice(line: str) -> None:
    """Tell a line to whoever wants to hear it."""
    for hearer in _hearers:
        hearer(line)
