"""Interrupts that wait: in some code an exception that a signal raises would be lost, or worse."""

from __future__ import annotations

import threading
from collections.abc import Callable

# How many times the main thread, which handles signals, has asked that they wait.
_held = 0
_waiting: list[Callable[[], None]] = []


def when_safe(act: Callable[[], None]) -> None:
    """Do what a signal asks for, now or as soon as nothing holds it up."""
    if _held:
        _waiting.append(act)
    else:
        act()


def hold_interrupts() -> None:
    """Let signals wait until `release_interrupts` is called as often."""
    global _held
    if _in_main_thread():
        _held += 1


def release_interrupts() -> None:
    """Let signals wait no longer, and do what those ask for that came."""
    global _held
    if _in_main_thread():
        _held -= 1
        while not _held and _waiting:
            _waiting.pop(0)()


def _in_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()
