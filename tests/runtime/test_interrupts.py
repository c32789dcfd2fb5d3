"""Interrupts wait while they are held up, and come then."""

from __future__ import annotations

import threading

import pytest
from numba.core import event

from mlscli.runtime.interrupts import hold_interrupts, release_interrupts, when_safe
from mlscli.runtime.kernels import kernel


class StopError(Exception):
    pass


def stop() -> None:
    raise StopError


def test_what_is_not_held_up_comes_at_once() -> None:
    with pytest.raises(StopError):
        when_safe(stop)


def test_what_is_held_up_comes_once_when_all_have_let_go() -> None:
    hold_interrupts()
    hold_interrupts()
    when_safe(stop)
    release_interrupts()
    with pytest.raises(StopError):
        release_interrupts()
    hold_interrupts()
    release_interrupts()


def test_other_threads_hold_up_nothing() -> None:
    # Signals come to the main thread, whatever the others do.
    thread = threading.Thread(target=hold_interrupts)
    thread.start()
    thread.join()
    with pytest.raises(StopError):
        when_safe(stop)


@kernel
def doubled(x: int) -> int:
    return 2 * x


class Interrupting(event.Listener):
    """Interrupts as soon as a kernel is about to be compiled or loaded, once."""

    done = False

    def on_start(self, event: event.Event) -> None:  # noqa: ARG002
        if not self.done:
            self.done = True
            when_safe(stop)

    def on_end(self, event: event.Event) -> None:
        pass


def test_a_kernel_is_made_whole_before_an_interrupt_comes() -> None:
    with event.install_listener("numba:compiler_lock", Interrupting()), pytest.raises(StopError):
        doubled(1)
    assert len(doubled.signatures) == 1  # type: ignore[attr-defined]
    assert doubled(1) == 2
