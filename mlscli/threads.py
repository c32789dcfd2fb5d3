"""Work on ranges, by several threads; kernels release the interpreter's lock."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import TypeVar

Result = TypeVar("Result")

# A range worth a thread: below, starting one costs more than it saves. No longer, either, so that
# an uneven load evens out, and an interrupt need not wait.
WORTHWHILE = 4096


def in_ranges(
    size: int, work: Callable[[int, int], Result], told: Callable[[int], None] | None = None
) -> list[Result]:
    """Call ``work(begin, end)`` on ranges that cover ``range(size)``, and list what they return.

    The ranges are disjoint and listed in order; how many there are must not change a result. An
    interrupt waits for the ranges that are being worked on, and for no others.

    Parameters
    ----------
    size : int
    work : callable
        Releases the interpreter's lock, or gains nothing.
    told : callable, optional
        Called with how much of `size` is done, now and then.
    """
    pieces = max(1, -(-size // WORTHWHILE))
    bounds = [size * piece // pieces for piece in range(pieces + 1)]
    pool = ThreadPoolExecutor(min(_processors(), pieces))
    try:
        futures = [pool.submit(work, *ends) for ends in pairwise(bounds)]
        results = []
        for future, done in zip(futures, bounds[1:], strict=True):
            results.append(future.result())
            if told is not None:
                told(done)
        return results
    finally:
        pool.shutdown(cancel_futures=True)


def _processors() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
