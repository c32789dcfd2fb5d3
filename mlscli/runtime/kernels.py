"""How kernels are compiled: once, kept on disk, and never without a notice.

A kernel is compiled when it is first called, and loaded from then on: numba keeps it beside its
source, or in the user's cache where that cannot be written, or in the folder that
``NUMBA_CACHE_DIR`` names. It is compiled anew when one of its sources has changed; where no folder
can be written, in every run.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
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
    """Return a function that is compiled for the types of the arguments it is called with.

    It releases the interpreter's lock, and is not parallel: threads call it on ranges of the work.
    """
    try:
        compiled = njit(cache=True, nogil=True, **_NO_C)(function)
        # Where nothing is compiled (NUMBA_DISABLE_JIT), there is nothing to keep.
        if compiled is not function:
            _follow_sources(compiled, Path(function.__code__.co_filename))
    except RuntimeError:
        compiled = _unkept(
            function, "no folder to keep them in can be written; NUMBA_CACHE_DIR names one"
        )
    except UnknownCache as error:
        compiled = _unkept(function, str(error))
    return cast("Function", compiled)


def _unkept(function: Callable[..., Any], why: str) -> Any:
    """Return a kernel that is compiled in every run, and note why, for the user."""
    _Compiling.not_kept = why
    return njit(nogil=True, **_NO_C)(function)


class UnknownCache(Exception):  # noqa: N818
    """The installed numba keeps compiled kernels in an unknown way."""


def _follow_sources(compiled: Any, path: Path) -> None:
    """Have a kernel compiled anew when any source that is compiled into it changes.

    numba checks the file of the kernel alone, and has no public way to add others. So this sets the
    private field that numba compares with the state of the sources when a kernel was compiled.

    Raises
    ------
    UnknownCache
        Where numba has no such field: kept kernels could be older than their sources.
    """
    kept: Any = getattr(getattr(compiled, "_cache", None), "_cache_file", None)
    if not hasattr(kept, "_source_stamp"):
        raise UnknownCache(
            f"numba {numba.__version__} keeps them in a way that is not known here; install an "
            "older numba, and report this"
        )
    # Where there are no source files, none can have changed.
    with suppress(OSError):
        kept._source_stamp = stamp(path)


def inner(function: Function) -> Function:
    """Return a function that is compiled into the kernels that call it.

    Called from elsewhere, it runs as Python.
    """
    return register_jitable(**_NO_C)(function)


# Compiled functions are never called from C.
_NO_C: dict[str, Any] = {"no_cfunc_wrapper": True}


class _Compiling(event.Listener):
    """Gives one notice, when the first kernel is compiled; loading a kernel is no such event."""

    not_kept = ""
    _said = False

    def on_start(self, event: event.Event) -> None:  # noqa: ARG002
        if self._said:
            return
        self._said = True
        if self.not_kept:
            notice(
                f"compiling kernels (about {COMPILE_SECONDS} s for all) in every run, for "
                f"{self.not_kept}"
            )
        else:
            notice(f"compiling kernels, once (about {COMPILE_SECONDS} s for all)")

    def on_end(self, event: event.Event) -> None:
        """Say nothing more."""


class _Locked(event.Listener):
    """Holds interrupts while a thread compiles or loads a kernel, or waits for others to do so.

    LLVM calls back into Python meanwhile, and loses exceptions that are raised there.
    """

    def on_start(self, event: event.Event) -> None:  # noqa: ARG002
        hold_interrupts()

    def on_end(self, event: event.Event) -> None:  # noqa: ARG002
        release_interrupts()


event.register("numba:compile", _Compiling())  # type: ignore[no-untyped-call, unused-ignore]
event.register("numba:compiler_lock", _Locked())  # type: ignore[no-untyped-call, unused-ignore]
