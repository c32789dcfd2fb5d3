"""Bags to points, beside rosbags alone, which leaves the points where they lie."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path
from statistics import median

from benchmarks.reading import KINDS, MESSAGES, POINTS, READERS, measure, write
from benchmarks.table import Row, Timer


def rows(timer: Timer) -> Iterator[Row]:
    """Yield a rate for each kind of recording; each run is a process of its own."""
    for kind, name in KINDS.items():
        with tempfile.TemporaryDirectory() as folder:
            bag = Path(folder, name)
            write(bag, kind)
            taken: dict[str, list[float]] = {reader: [] for reader in READERS}
            for _ in range(timer.repeats):
                for reader, times in taken.items():
                    seconds, cpu, _ = measure(reader, bag)
                    times.append(cpu if timer.cpu else seconds)
        rates = {reader: MESSAGES * POINTS / median(times) / 1e6 for reader, times in taken.items()}
        what = f"{kind}, {MESSAGES * POINTS:,} points"
        yield Row(what, rates["mls"], "M points/s", "rosbags' AnyReader", rates["AnyReader"])
