"""Work on ranges, by several threads; kernels release the interpreter's lock."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

Result = TypeVar("Result")

# A range worth a thread: below, starting one costs more than it saves.
WORTHWHILE = 4096


def in_ranges(size: int, work: Callable[[int, int], Result]) -> list[Result]:
    """Call ``work(begin, end)`` on ranges that cover ``range(size)``, and list what they return.

    The ranges are disjoint and listed in order; how many there are must not change a result.
    """
    workers = max(1, min(_processors(), size // WORTHWHILE))
    # More ranges than threads, so that an uneven load evens out.
    pieces = 1 if workers == 1 else 4 * workers
    bounds = [size * piece // pieces for piece in range(pieces + 1)]
    if pieces == 1:
        return [work(0, size)]
    with ThreadPoolExecutor(workers) as pool:
        return list(pool.map(work, bounds[:-1], bounds[1:]))


def _processors() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
