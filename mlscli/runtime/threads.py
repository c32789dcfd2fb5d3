"""Work on ranges, by several threads; kernels release the interpreter's lock."""

from __future__ import annotations

import math
import os
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor, wait
from functools import cache
from itertools import pairwise
from typing import TypeVar

Result = TypeVar("Result")

# A range worth a thread: below, starting one costs more than it saves. No longer, either, so that
# an uneven load evens out, and an interrupt need not wait.
WORTHWHILE = 4096
# The weight of work that takes some nanoseconds each: only long ranges of it are worth a thread.
LIGHT = 1 / 16

_thread = threading.local()


def in_ranges(
    size: int,
    work: Callable[[int, int], Result],
    progress: Callable[[int], None] | None = None,
    *,
    weight: float = 1.0,
) -> list[Result]:
    """Call ``work(begin, end)`` on ranges that cover ``range(size)``, and list what they return.

    The ranges are disjoint and listed in order; how many there are must not change a result. An
    interrupt waits for the ranges that are being worked on, and for no others.

    Parameters
    ----------
    size : int
    work : callable
        Releases the interpreter's lock, or gains nothing.
    progress : callable, optional
        Called with how much of `size` is done, now and then.
    weight : float
        How much work each is, of which `WORTHWHILE` are worth a thread; `LIGHT` for the least.
    """
    pieces = max(1, min(size, math.ceil(size * weight / WORTHWHILE)))
    if pieces == 1:
        result = work(0, size)
        if progress is not None:
            progress(size)
        return [result]
    bounds = [size * piece // pieces for piece in range(pieces + 1)]
    if (stopping := getattr(_thread, "stopping", None)) is not None:
        return [work(*ends) for ends in pairwise(bounds) if not _stop(stopping)]
    pool = _pool(processors())
    futures = [pool.submit(work, *ends) for ends in pairwise(bounds)]
    try:
        results = []
        for future, done in zip(futures, bounds[1:], strict=True):
            results.append(future.result())
            if progress is not None:
                progress(done)
        return results
    finally:
        for future in futures:
            future.cancel()
        wait(futures)


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    """Return threads that stay: to start them takes as long as many a stage."""
    return ThreadPoolExecutor(threads)


def in_turn(calls: Iterable[Callable[[], Result]], threads: int) -> Iterator[Result]:
    """Make calls in several threads and yield what they return, in the order of the calls.

    No more results wait than there are threads. Within a call, `in_ranges` starts no threads of
    its own, and ends between two ranges when nobody waits for the result any more.

    Parameters
    ----------
    calls : iterable of callables
    threads : int
        How many calls are made at a time, at most.
    """
    stopping = threading.Event()
    pool = ThreadPoolExecutor(threads, initializer=_take_part, initargs=(stopping,))
    futures: deque[Future[Result]] = deque()
    try:
        for call in calls:
            futures.append(pool.submit(call))
            if len(futures) == threads:
                yield futures.popleft().result()
        while futures:
            yield futures.popleft().result()
    finally:
        stopping.set()
        pool.shutdown(cancel_futures=True)


def _take_part(stopping: threading.Event) -> None:
    """Make a thread one of several that make calls in turn."""
    _thread.stopping = stopping


def _stop(stopping: threading.Event) -> bool:
    """Leave a call that nobody waits for."""
    if stopping.is_set():
        raise CancelledError
    return False


def processors() -> int:
    """Return how many threads can run at a time."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
