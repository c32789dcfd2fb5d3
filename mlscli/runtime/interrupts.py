"""Interrupts that wait, and an end that does not.

In some code an exception raised by a signal would be lost, or do harm: there it waits. In other
code the main thread cannot take a signal for long, as in a kernel, or while it waits for those of
others. So another thread ends the program where it is still there some time after a signal.
"""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable
from functools import partial

GRACE = 0.7
"""How long the program has to end by itself after a signal, in seconds."""

_PATIENCE = 10.0


class _Undisturbed:
    """Blocks of code, of any threads, in which the program is not ended half way."""

    def __init__(self) -> None:
        self._blocks = 0
        self._changed = threading.Condition()

    def __enter__(self) -> None:
        with self._changed:
            self._blocks += 1

    def __exit__(self, *_: object) -> None:
        with self._changed:
            self._blocks -= 1
            self._changed.notify_all()

    def when_over(self, act: Callable[[], None]) -> None:
        """Do something when all blocks are over, or have taken too long; none begins meanwhile."""
        with self._changed:
            self._changed.wait_for(lambda: not self._blocks, _PATIENCE)
            act()


undisturbed = _Undisturbed()
"""For code that must not be ended half way: while files change their names, a cluster is closed."""

# How often the main thread, which handles signals, holds them at present.
_held = 0
_waiting: list[Callable[[], None]] = []


def when_safe(act: Callable[[], None]) -> None:
    """Do what a signal asks for, now or as soon as interrupts are no longer held."""
    if _held:
        _waiting.append(act)
    else:
        act()


def end_in_time(end: Callable[[int], None], grace: float = GRACE) -> None:
    """Have another thread call `end` some time after SIGINT or SIGTERM; main thread only.

    Parameters
    ----------
    end : callable
        Called with the signal's number; ends the program.
    grace : float
        Seconds between the signal and that.
    """
    receive, send = os.pipe()
    os.set_blocking(send, False)
    # Python writes the numbers of signals there as they come, whatever the main thread does.
    signal.set_wakeup_fd(send, warn_on_full_buffer=False)

    def watch() -> None:
        while number := os.read(receive, 1):
            if number[0] in (signal.SIGINT, signal.SIGTERM):
                time.sleep(grace)
                undisturbed.when_over(partial(end, number[0]))

    threading.Thread(target=watch, daemon=True).start()


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
