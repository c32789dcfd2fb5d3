"""Interrupts that wait: in some code an exception raised by a signal would be lost, or do harm."""

from __future__ import annotations

import threading
from collections.abc import Callable

# How often the main thread, which handles signals, holds them at present.
_held = 0
_waiting: list[Callable[[], None]] = []


def when_safe(act: Callable[[], None]) -> None:
    """Do what a signal asks for, now or as soon as interrupts are no longer held."""
    if _held:
        _waiting.append(act)
    else:
        act()


def hold_interrupts() -> None:
    """Let signals wait until `release_interrupts` is called as often; main thread only."""
    global _held
    if _in_main_thread():
        _held += 1


def release_interrupts() -> None:
    """Undo one call of `hold_interrupts`; the last one does what waiting signals ask for."""
    global _held
    if _in_main_thread():
        _held -= 1
        while not _held and _waiting:
            _waiting.pop(0)()


def _in_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()
