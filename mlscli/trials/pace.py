"""How long a batch takes by its size: the thesis's figure 6.8, measured again.

The points of a synthetic flight, in the order in which they were seen, are cut into batches of one
size, and each is taken into a growing map through the whole pipeline. The thesis timed the cloud
of its own flight, some 3,100 points, on a laptop of 2005. Where such a flight does not hold two
batches of the largest size, all batches are cut from a longer one, whose points are as dense.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from statistics import mean
from typing import TYPE_CHECKING, Any

import numpy as np

from mlscli.building.builder import MapBuilder
from mlscli.errors import InputError, UsageError
from mlscli.pipeline.parameters import AUTO, Parameters
from mlscli.runtime.arrays import Float64
from mlscli.trials.quality import CELL_SIZE, flown

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Time of a batch (s) by its points, read off the figure.
THESIS: Mapping[int, float] = {
    20: 0.01, 40: 0.02, 60: 0.03, 80: 0.06, 100: 0.07, 120: 0.11, 140: 0.15, 160: 0.17, 180: 0.21,
    200: 0.24, 240: 0.43, 280: 0.61, 320: 1.37, 360: 1.63, 400: 2.06,
}  # fmt: skip

OUTLIERS, POINTS, LARGEST_BATCH = 0.1, 3200, 10_000


@dataclass(frozen=True)
class BatchPace:
    """How long batches of one size take.

    Attributes
    ----------
    size : int
        Points in a batch.
    batches : int
        How many batches were timed.
    seconds : float
        Mean wall time of a batch.
    thesis : float or None
        The thesis's time (s) for this size; None where it has none.
    """

    size: int
    batches: int
    seconds: float
    thesis: float | None


@dataclass(frozen=True)
class Pace:
    """How long batches take.

    Attributes
    ----------
    rows : list of BatchPace
        One for each size.
    first_call : float
        How much longer (s) the very first batch took than the same batch again: kernels are
        loaded, or compiled where no cache holds them.
    exponent : float or None
        The power of the size with which the time of a batch grows; None with fewer than two sizes.
    """

    rows: list[BatchPace]
    first_call: float
    exponent: float | None


def parse_sizes(text: str) -> list[int]:
    """Return the sizes that ``A..B[:STEP]`` or a list names; ``20..400`` are the thesis's.

    Without a step, sizes are 20 apart.

    Raises
    ------
    UsageError
        Where the text is neither, or a size is below 1 or above `LARGEST_BATCH`.
    """
    if text == "20..400":
        return list(THESIS)
    sizes: Sequence[int]
    try:
        if ".." in text:
            ends, _, step = text.partition(":")
            least, greatest = map(int, ends.split(".."))
            sizes = range(least, greatest + 1, int(step or 20))
        else:
            sizes = [int(part) for part in text.split(",")]
            least, greatest = min(sizes), max(sizes)
    except ValueError:
        sizes, least, greatest = [], 0, 0
    # Check the ends before the range becomes a list: it may be huge.
    if not (least >= 1 and greatest <= LARGEST_BATCH and sizes):
        raise UsageError(
            f"`sizes` {text}: expected A..B, A..B:STEP or a list such as 20,52,400, of numbers "
            f"from 1 to {LARGEST_BATCH:,}"
        )
    return list(sizes)


def measured(
    sizes: Sequence[int],
    parameters: Parameters,
    progress: Callable[[str, int, int | None], None] | None = None,
) -> Pace:
    """Time batches of each size, after the kernels are loaded.

    Parameters
    ----------
    sizes : sequence of int
        Points in a batch.
    parameters : Parameters
        Those of the map; a cell size of ``auto`` becomes the thesis's.
    progress : callable, optional
        Called with what is being done, how many sizes are done, and how many there are.
    """
    if parameters.map.cell_size == AUTO:
        parameters = parameters.with_cell_size(CELL_SIZE)
    points = _points(max(POINTS, 2 * max(sizes)))
    first, later = (_until_first(points[: sizes[0]], parameters) for _ in range(2))
    # Later batches may use kernels that the first does not: load these, too.
    _times(points, sizes[0], parameters)
    rows = []
    for number, size in enumerate(sizes):
        if progress is not None:
            progress("batches", number, len(sizes))
        times = _times(points, size, parameters)
        rows.append(BatchPace(size, len(times), mean(times), THESIS.get(size)))
    return Pace(rows, max(0.0, first - later), _exponent(rows))


def _points(size: int) -> Float64:
    """Return the first points of a flight in the order seen, float64 (`size`, 3)."""
    scene = "house" if size <= POINTS else "village"
    keyframes = flown(scene, OUTLIERS, seed=1).keyframes
    return np.concatenate([keyframe.points for keyframe in keyframes])[:size]


def _until_first(points: Float64, parameters: Parameters) -> float:
    """Return how long (s) it takes to make a map and take a first batch into it."""
    begin = time.perf_counter()
    MapBuilder(parameters).process_cloud(points)
    return time.perf_counter() - begin


def _times(points: Float64, size: int, parameters: Parameters) -> list[float]:
    """Return how long (s) each batch takes; points left over at the end make no batch."""
    builder = MapBuilder(parameters)
    # Reading the map prepares it to grow, which is not to be timed with the first batch.
    _ = builder.surface
    times = []
    for begin in range(0, len(points) - size + 1, size):
        before = time.perf_counter()
        builder.process_cloud(points[begin : begin + size])
        times.append(time.perf_counter() - before)
    return times


def _exponent(rows: Sequence[BatchPace]) -> float | None:
    """Return the slope of log time over log size; None with fewer than two sizes."""
    if len({row.size for row in rows}) < 2:
        return None
    sizes, seconds = (np.log([getattr(row, name) for row in rows]) for name in ("size", "seconds"))
    return float(np.polyfit(sizes, seconds, 1)[0])


# --- reports ---


def to_dict(pace: Pace, before: Mapping[int, float] | None = None) -> dict[str, Any]:
    """Return the times, ready for JSON.

    Parameters
    ----------
    pace : Pace
    before : mapping of int to float, optional
        Earlier times (s) by size, which are put beside.
    """
    report = asdict(pace)
    if before is not None:
        for row in report["rows"]:
            old = before.get(row["size"])
            row |= {"before": old, "ratio": None if old is None else row["seconds"] / old}
    return report


def seconds_of(report: Any, name: str) -> dict[int, float]:
    """Return the times (s) by size of a report that `to_dict` made; messages call it `name`.

    Raises
    ------
    InputError
        Where it is no such report.
    """
    try:
        times = {int(row["size"]): float(row["seconds"]) for row in report["rows"]}
        if not all(0 < seconds < math.inf for seconds in times.values()):
            raise ValueError
        return times
    except (KeyError, OverflowError, TypeError, ValueError):
        raise InputError(
            f"{name}: holds no times of batches; expected what mls bench --sizes --json wrote"
        ) from None


def to_markdown(pace: Pace, before: Mapping[int, float] | None = None) -> str:
    """Return the times as a table; takes what `to_dict` takes."""
    head = ["points", "batches", "ms a batch", "thesis, ms", "times as fast"]
    head += ["before, ms", "now / before"] if before is not None else []
    lines = [f"| {' | '.join(head)} |", f"|{'--:|' * len(head)}"]
    for row in pace.rows:
        cells = [f"{row.size}", f"{row.batches}", f"{1e3 * row.seconds:.2f}"]
        if row.thesis is None:
            cells += ["", ""]
        else:
            cells += [f"{1e3 * row.thesis:.0f}", f"{row.thesis / row.seconds:.3g}"]
        if before is not None:
            old = before.get(row.size)
            cells += ["", ""] if old is None else [f"{1e3 * old:.2f}", f"{row.seconds / old:.2f}"]
        lines.append(f"| {' | '.join(cells)} |")
    lines += ["", f"The first batch of all cost {pace.first_call:.2f} s more."]
    if pace.exponent is not None:
        thesis = [BatchPace(size, 1, seconds, None) for size, seconds in THESIS.items()]
        lines.append(
            f"Time grows with the size to the power of {pace.exponent:.2f}; the thesis's with "
            f"{_exponent(thesis):.2f}."
        )
    return "\n".join(lines) + "\n"


def drawn(pace: Pace) -> Figure:
    """Return a plot of the times over the sizes, with the thesis's, both axes logarithmic."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import LogLocator, NullLocator, StrMethodFormatter

    figure = Figure(figsize=(7, 5), layout="constrained")
    axes = figure.add_subplot()
    axes.loglog(list(THESIS), list(THESIS.values()), "o-", label="thesis, a laptop of 2005")
    axes.loglog([r.size for r in pace.rows], [r.seconds for r in pace.rows], "s-", label="mls")
    axes.set(xlabel="points in a batch", ylabel="average time of a batch (s)")
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 4)))
    axes.xaxis.set_minor_locator(NullLocator())
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axes.legend()
    return figure
