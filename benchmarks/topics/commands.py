"""Whole commands, each in a new process: their time, their memory, the compilation of kernels."""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from statistics import median

from benchmarks.large import CELL, write_survey
from benchmarks.process import Ran, ran
from benchmarks.table import Row, Timer

MLS = (sys.executable, "-m", "mlscli")
SAMPLE = Path(__file__).resolve().parents[2] / "data/samples/bridge.txt"
SIZES = (10**5, 10**6, 10**7)
LARGEST = 12_000_000


def rows(timer: Timer) -> Iterator[Row]:
    """Yield times of commands, in turns; the peak of memory; and the time to compile kernels."""
    times, _ = _in_turns(timer, ["-c", "pass"], ["-m", "mlscli", "--help"], at_least=15)
    what = "`mls --help`: times an empty Python"
    yield Row(what, times[1] / times[0], "", most=6.0, short=True)
    with tempfile.TemporaryDirectory() as folder:
        text = Path(folder, "cloud.txt")
        # The first two lines are a comment and the header.
        text.write_text("".join(SAMPLE.read_text().splitlines(keepends=True)[:3002]))
        bags = [Path(folder, f"{size}.bag") for size in (*SIZES, LARGEST)]
        for size, bag in zip((*SIZES, LARGEST), bags, strict=True):
            write_survey(bag, size)
        small, *larger = [text, *bags]
        seconds, runs = _in_turns(timer, _build(small, auto=True), *map(_build, larger))
    what = "`mls build` of a text cloud of 3,000 points, warm"
    yield Row(what, seconds[0], "s", most=1.5, short=True)
    for size, spent in zip(SIZES, seconds[1:], strict=False):
        yield Row(f"`mls build` of a bag of {size:,} points", spent, "s")
    what = f"`mls build` of a bag of {LARGEST:,} points: times the sum of its parts"
    to_parts = median(run.seconds / _parts(run) for run in runs[-1])
    yield Row(what, to_parts, "", most=1.05, short=True)
    # The memory of the program itself is that of a build of a small bag.
    least, most = (median(run.peak for run in runs[at]) for at in (1, -1))
    what = "peak memory of that build, above the program itself: bytes a point"
    yield Row(what, (most - least) / (LARGEST - SIZES[0]), "", most=80.0, short=True)
    measured_by = ["--cpu"] if timer.cpu else []
    output = ran([sys.executable, "-m", "benchmarks.compiling", *measured_by]).output
    compiling, kernels, *unused = output.splitlines()[-1].split()
    what = f"compiling all {kernels} kernels, once" + "".join(f"; not {name}" for name in unused)
    yield Row(what, float(compiling), "s", most=15.0, short=True)


def _parts(run: Ran) -> float:
    """Return the sum of the times (s) that a build reports: reading, stages, writing."""
    seconds: dict[str, float] = json.loads(run.output)["seconds"]
    return sum(seconds.values()) - seconds["total"]


def _build(source: Path, *, auto: bool = False) -> list[str]:
    """Return the arguments of Python for a build; with `auto`, the cell size is not given."""
    size = [] if auto else ["--set", f"map.cell_size={CELL}"]
    output = source.with_suffix(".npz")
    return ["-m", "mlscli", "build", str(source), "-o", str(output), "--overwrite", "--json", *size]


def _in_turns(
    timer: Timer, *commands: Sequence[str], at_least: int = 1
) -> tuple[list[float], list[list[Ran]]]:
    """Run Python with the arguments of each command in turns.

    Parameters
    ----------
    timer : Timer
        How many runs there are, and which time is measured.
    *commands : sequence of str
        Arguments of Python.
    at_least : int
        The least number of runs.

    Returns
    -------
    times : list of float
        The median time (s) of each command.
    runs : list of list of Ran
        All runs of each command.
    """
    runs: list[list[Ran]] = [[] for _ in commands]
    for turn in range(max(timer.repeats, at_least) + 1):
        for command, each in zip(commands, runs, strict=True):
            run = ran([sys.executable, *command])
            if turn:
                each.append(run)
    times = [median(run.cpu if timer.cpu else run.seconds for run in each) for each in runs]
    return times, runs
