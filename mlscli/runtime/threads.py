"""Work done by several threads, on ranges or call by call."""

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

# The length of a range: with shorter ones, starting a thread costs more than it saves; with longer
# ones, the load is less even, and an interrupt waits longer.
WORTHWHILE = 4096
# The weight of items that take some nanoseconds each: only long ranges of them are worth a thread.
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
        Number of items.
    work : callable
        Called by several threads; faster only where it releases the interpreter's lock.
    progress : callable, optional
        Called with the number of items done, now and then.
    weight : float
        Work for each item: `WORTHWHILE` items of weight 1 are worth a thread; `LIGHT` is the least.
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
    """Return threads that stay: starting them takes as long as a short stage."""
    return ThreadPoolExecutor(threads)


def in_turn(calls: Iterable[Callable[[], Result]], threads: int) -> Iterator[Result]:
    """Make calls in several threads and yield what they return, in the order of the calls.

    At most as many results wait as there are threads. Within a call, `in_ranges` starts no threads
    of its own, and stops between two ranges once the iterator is closed.

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
    """Mark a thread as one of `in_turn`, with the event that stops it."""
    _thread.stopping = stopping


def _stop(stopping: threading.Event) -> bool:
    """Raise CancelledError in a call whose result is no longer wanted; else return False."""
    if stopping.is_set():
        raise CancelledError
    return False


def processors() -> int:
    """Return how many threads can run at a time."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
