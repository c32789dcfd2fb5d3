"""Which kernels a batch calls and how long they take: ``python -m benchmarks.calls`` (a minute).

Batches as in `benchmarks.topics.batch`, with the default pipeline, into a map of 10,000 patches. A
kernel's time is that of its calls from Python, the passing of arguments included: the lower
quartile of all calls, times their number in a batch. What is left of the lower quartile of whole
batches, in processor time, is Python and the watching of the calls.
"""

from __future__ import annotations

import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from types import ModuleType
from typing import Any

import click
import numpy as np

from benchmarks.table import figure, lines
from benchmarks.topics.batch import (
    BATCH,
    CELL,
    LEVELS,
    SQUARE,
    WIDTH,
    floors,
    grown,
    parameters_of,
    scattered,
)
from mlscli.runtime.arrays import Float64

PATCHES, BEFORE, WATCHED, SHOWN = 10**4, 60, 200, 12
HEAD = ("what", "calls a batch", "us a batch")


def batches(number: int, rng: np.random.Generator) -> Iterator[Float64]:
    """Yield batches (N, 3), each onto the middle of a floor."""
    for corner in rng.choice(floors(PATCHES), number):
        batch = scattered(rng, SQUARE, BATCH)
        batch[:, :2] += corner + (WIDTH - SQUARE) / 2 * CELL
        yield batch


def modules() -> list[ModuleType]:
    """Return the modules of the program that are loaded."""
    return [module for name, module in sys.modules.items() if name.startswith("mlscli.")]


def watch(taken: dict[str, list[int]]) -> None:
    """Have each call of a kernel add its time (ns) to `taken`."""

    def watched(name: str, kernel: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any) -> Any:
            begin = time.perf_counter_ns()
            result = kernel(*arguments)
            taken[name].append(time.perf_counter_ns() - begin)
            return result

        return call

    for module in modules():
        for name, value in list(vars(module).items()):
            if hasattr(value, "py_func"):
                home = value.__module__.rpartition(".")[2]
                setattr(module, name, watched(f"{home}.{value.__name__}", value))


def rows(mode: str) -> Iterator[tuple[str, ...]]:
    """Yield the cells of a row for whole batches, all kernels, and those that take longest."""
    (level,) = (each for each in LEVELS if (each.pipeline, each.mode) == ("default", mode))
    builder, rng = grown(parameters_of(level), PATCHES), np.random.default_rng(2)
    for batch in batches(BEFORE, rng):
        builder.process_cloud(batch)
    kept = [(module, dict(vars(module))) for module in modules()]
    taken, whole = defaultdict[str, list[int]](list), []
    watch(taken)
    for batch in batches(WATCHED, rng):
        begin = time.process_time_ns()
        builder.process_cloud(batch)
        whole.append(time.process_time_ns() - begin)
    for module, names in kept:
        vars(module).update(names)
    spent = {
        name: float(np.quantile(times, 0.25)) * len(times) / WATCHED / 1e3
        for name, times in taken.items()
    }
    calls = {name: len(times) / WATCHED for name, times in taken.items()}
    yield f"{mode}: all", "", figure(float(np.quantile(whole, 0.25)) / 1e3)
    yield "all kernels", figure(sum(calls.values())), figure(sum(spent.values()))
    for name in sorted(spent, key=spent.__getitem__, reverse=True)[:SHOWN]:
        yield f"`{name}`", figure(calls[name]), figure(spent[name])


@click.command()
def main() -> None:
    """Print a table for each mode."""
    for mode in ("sequential", "consistent"):
        click.echo()
        for line in lines(HEAD, rows(mode)):
            click.echo(line)


if __name__ == "__main__":
    main()
