"""How kernels are compiled: once, kept on disk, and never without a notice.

A kernel is compiled when it is first called, and loaded from then on: it is kept in the package, or
in the user's cache where that cannot be written, or in the folder that ``NUMBA_CACHE_DIR`` names
(`kernel_files`). It is compiled anew when what it is compiled from has changed (`kernel_sources`);
where no folder can be written, in every run.
"""

from __future__ import annotations

import gc
from collections.abc import Callable
from typing import Any, TypeVar, cast

from numba import njit
from numba.core import event
from numba.extending import register_jitable

from mlscli.runtime.interrupts import hold_interrupts, release_interrupts
from mlscli.runtime.kernel_files import UnknownCache, folder, keep, mismatch
from mlscli.runtime.notices import detail, notice

Function = TypeVar("Function", bound=Callable[..., Any])

COMPILE_SECONDS = 40
"""About how long all kernels take to compile, on one core."""


def kernel(function: Function) -> Function:
    """Return a function that is compiled for the types of the arguments it is called with.

    It releases the interpreter's lock, and is not parallel: threads call it on ranges of the work.
    """
    compiled = njit(nogil=True, **_NO_C)(function)
    # Where nothing is compiled (NUMBA_DISABLE_JIT), there is nothing to keep.
    if compiled is not function:
        _compiling.kernels.add(id(compiled))
        try:
            keep(compiled)
        except UnknownCache as error:
            _compiling.not_kept = str(error)
    return cast("Function", compiled)


def inner(function: Function) -> Function:
    """Return a function that is compiled into the kernels that call it.

    Called from elsewhere, it runs as Python.
    """
    return register_jitable(**_NO_C)(function)


# Compiled functions are never called from C.
_NO_C: dict[str, Any] = {"no_cfunc_wrapper": True}


class _Compiling(event.Listener):
    """Gives one notice, when the first kernel is compiled; loading a kernel is no such event.

    No garbage is collected meanwhile.
    """

    def __init__(self) -> None:
        # Others may compile theirs in the same process.
        self.kernels: set[int] = set()
        self.not_kept = ""
        self._said = False
        self._depth, self._collects = 0, True

    def on_start(self, event: event.Event) -> None:
        if id(event.data["dispatcher"]) not in self.kernels:
            return
        # What numba makes is kept, or goes without it: collecting it took a tenth of the time.
        if not self._depth:
            self._collects = gc.isenabled()
            gc.disable()
        self._depth += 1
        if not self._said:
            self._said = True
            self._say()
        function = event.data["dispatcher"].py_func
        detail(f"compiling {function.__module__}.{function.__qualname__}")

    def _say(self) -> None:
        why = self.not_kept
        if not folder():
            why = "no folder to keep them in can be written; NUMBA_CACHE_DIR names one"
        for_all = f"(about {COMPILE_SECONDS} s for those of all commands)"
        if why:
            notice(f"compiling kernels {for_all} in every run, for {why}")
        else:
            unlike = mismatch()
            those = f": those that came with the program are for {unlike}" if unlike else ""
            ahead = "; mls warmup compiles all" if not those else ""
            notice(f"compiling kernels of this command, once {for_all}{ahead}{those}")

    def on_end(self, event: event.Event) -> None:
        if id(event.data["dispatcher"]) in self.kernels:
            self._depth -= 1
            if not self._depth and self._collects:
                gc.enable()


_compiling = _Compiling()


class _Locked(event.Listener):
    """Holds interrupts while a thread compiles or loads a kernel, or waits for others to do so.

    LLVM calls back into Python meanwhile, and loses exceptions that are raised there.
    """

    def on_start(self, event: event.Event) -> None:  # noqa: ARG002
        hold_interrupts()

    def on_end(self, event: event.Event) -> None:  # noqa: ARG002
        release_interrupts()


event.register("numba:compile", _compiling)  # type: ignore[no-untyped-call, unused-ignore]
event.register("numba:compiler_lock", _Locked())  # type: ignore[no-untyped-call, unused-ignore]
