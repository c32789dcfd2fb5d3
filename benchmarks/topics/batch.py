"""A batch into a growing map, by the size of the map; always in time of the processor."""

from __future__ import annotations

from collections.abc import Iterator

from benchmarks.growing import BATCH, GROWTH, LEVELS, SIZES, milliseconds, parameters_of
from benchmarks.table import Row, Timer


def rows(timer: Timer) -> Iterator[Row]:  # noqa: ARG001  # it has its own repeats
    """Yield what a batch costs by pipeline, mode and patches, and how that grows."""
    for level in LEVELS:
        spent = milliseconds(parameters_of(level))
        pipeline = f"{level.pipeline} alone" if level.pipeline == "median" else level.pipeline
        what = f"batch of {BATCH}, {level.mode}, {pipeline}"
        most, matters = level.milliseconds, level.milliseconds is not None
        for patches, cost in spent.items():
            largest = patches == SIZES[-1]
            size = f"{what}, {patches:,} patches"
            yield Row(size, cost, "ms", most=most, short=matters and largest)
        growth = max(spent.values()) / spent[SIZES[0]]
        grown = f"{what}: growth from {SIZES[0]:,} patches"
        yield Row(grown, growth, "times", most=GROWTH, short=matters)
