"""How kernels are compiled: once, kept on disk, and never without a word.

A kernel is compiled when it is first called, and loaded from then on: numba keeps it beside its
source, or in the user's cache where that cannot be written, or in the folder that
``NUMBA_CACHE_DIR`` names. It is compiled anew when a source that it is compiled from has changed;
where no folder can be written, in every run.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar, cast

from numba import njit
from numba.core import event
from numba.extending import register_jitable

from mlscli.runtime.interrupts import hold_interrupts, release_interrupts
from mlscli.runtime.kernel_sources import stamp
from mlscli.runtime.notices import notice

Function = TypeVar("Function", bound=Callable[..., Any])

COMPILE_SECONDS = 40
"""About how long all kernels take to compile, on one core."""


def kernel(function: Function) -> Function:
    """Return a function that is compiled for the types it is called with.

    It releases the interpreter's lock, and is compiled serially: threads take ranges of the work.
    """
    try:
        compiled = njit(cache=True, nogil=True, **_NO_C)(function)
    except RuntimeError:
        _Compiling.kept = False
        compiled = njit(nogil=True, **_NO_C)(function)
    else:
        # numba has no word for it: what it compares with the state in which a source was compiled.
        # Without sources, or where nothing is compiled (NUMBA_DISABLE_JIT), it does as it will.
        with suppress(OSError, AttributeError):
            compiled._cache._cache_file._source_stamp = stamp(Path(function.__code__.co_filename))
    return cast("Function", compiled)


def inner(function: Function) -> Function:
    """Return a function that kernels call: compiled into them, as part of each.

    Whoever else calls it runs it as Python.
    """
    return register_jitable(**_NO_C)(function)


# Nobody calls compiled functions by their address in C.
_NO_C: dict[str, Any] = {"no_cfunc_wrapper": True}


class _Compiling(event.Listener):
    """Says that kernels are compiled, once, as soon as the first is; what is loaded is no event."""

    kept = True
    _said = False

    def on_start(self, event: event.Event) -> None:  # noqa: ARG002
        if self._said:
            return
        self._said = True
        if self.kept:
            notice(f"compiling kernels, once (about {COMPILE_SECONDS} s for all)")
        else:
            notice(
                f"compiling kernels (about {COMPILE_SECONDS} s for all) in every run, for no "
                "folder to keep them in can be written; NUMBA_CACHE_DIR names one"
            )

    def on_end(self, event: event.Event) -> None:
        """Say nothing more."""


class _Locked(event.Listener):
    """Lets interrupts wait while a kernel is compiled or loaded, and until others have done so.

    LLVM calls back into Python meanwhile, and loses what is raised there.
    """

    def on_start(self, event: event.Event) -> None:  # noqa: ARG002
        hold_interrupts()

    def on_end(self, event: event.Event) -> None:  # noqa: ARG002
        release_interrupts()


event.register("numba:compile", _Compiling())  # type: ignore[no-untyped-call, unused-ignore]
event.register("numba:compiler_lock", _Locked())  # type: ignore[no-untyped-call, unused-ignore]
