"""The machine's own limits, which no program can exceed."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.table import Row, Timer

SIZE, KEYS = 64_000_000, 1_000_000


def rows(timer: Timer) -> Iterator[Row]:
    """Yield the rates at which memory is copied, keys are sorted and a file is read."""
    memory = np.ones(SIZE // 8)
    (copied,) = timer.rates(SIZE, memory.copy)
    yield Row("memory copy", copied / 1000, "GB/s")
    keys = np.random.default_rng(1).integers(0, 2**63, KEYS)
    (ordered,) = timer.rates(KEYS, partial(np.sort, keys))
    yield Row("numpy's sort of int64", ordered, "M/s")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "file")
        path.write_bytes(memory.tobytes())
        (read,) = timer.rates(SIZE, path.read_bytes)
        yield Row("reading a file, from the system's cache", read / 1000, "GB/s")
