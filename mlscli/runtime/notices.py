"""Notices for the user while the program works; the library itself prints nothing."""

from __future__ import annotations

from collections.abc import Callable

_hearers: list[Callable[[str], None]] = []
_hearers_of_details: list[Callable[[str], None]] = []


def hear(hearer: Callable[[str], None]) -> None:
    """Have `hearer` called with every notice of this process, a line each."""
    _hearers.append(hearer)


def hear_details(hearer: Callable[[str], None]) -> None:
    """Have `hearer` called with what is done step by step, a line each."""
    _hearers_of_details.append(hearer)


def notice(line: str) -> None:
    """Pass a line to all hearers."""
    for hearer in _hearers:
        hearer(line)


def detail(line: str) -> None:
    """Pass a line on what is being done to those who want to know each step."""
    for hearer in _hearers_of_details:
        hearer(line)
