"""Notices for the user while the program works; the library itself prints nothing."""

from __future__ import annotations

from collections.abc import Callable

_hearers: list[Callable[[str], None]] = []


def hear(hearer: Callable[[str], None]) -> None:
    """Have `hearer` called with every notice of this process, a line each."""
    _hearers.append(hearer)


def notice(line: str) -> None:
    """Pass a line to all hearers."""
    for hearer in _hearers:
        hearer(line)
