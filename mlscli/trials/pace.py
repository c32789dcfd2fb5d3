"""How long a batch takes by its size: the thesis's figure 6.8, measured anew.

The points of a synthetic flight, in the order in which they were seen, are cut into batches of one
size, and each is taken into a growing map through the whole pipeline. The thesis timed the cloud
of its own flight, some 3,100 points, on a laptop of 2005; batches that such a flight holds less
than twice are cut from a longer one, whose points lie as close.
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
from mlscli.pipeline.parameters import Parameters
from mlscli.runtime.arrays import Float64
from mlscli.trials.quality import CELL_SIZE, flown

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Seconds a batch by its points, read off the figure.
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
        How many were timed.
    seconds : float
        Wall time of a batch on the average.
    thesis : float or None
        The thesis's time (s) for this size.
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
    first_call : float
        What the first batch of all cost (s) beyond a later one like it: the kernels are loaded, or
        compiled where no cache holds them.
    exponent : float or None
        The time of a batch grows with this power of its size; None with fewer than two sizes.
    """

    rows: list[BatchPace]
    first_call: float
    exponent: float | None


def parse_sizes(text: str) -> list[int]:
    """Return the sizes that ``A..B[:STEP]`` or a list names; ``20..400`` are the thesis's.

    Raises
    ------
    UsageError
        Where it is neither, or a size is below 1 or above `LARGEST_BATCH`.
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
    # The ends first: in between there may be more numbers than anyone has time for.
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
    """Time batches of each size, the program warm."""
    if parameters.map.cell_size == "auto":
        parameters = parameters.with_cell_size(CELL_SIZE)
    points = _points(max(POINTS, 2 * max(sizes)))
    first, later = (_until_first(points[: sizes[0]], parameters) for _ in range(2))
    # What the first batch alone does not load, later ones may.
    _times(points, sizes[0], parameters)
    rows = []
    for number, size in enumerate(sizes):
        if progress is not None:
            progress("batches", number, len(sizes))
        times = _times(points, size, parameters)
        rows.append(BatchPace(size, len(times), mean(times), THESIS.get(size)))
    return Pace(rows, max(0.0, first - later), _exponent(rows))


def _points(size: int) -> Float64:
    """Return so many points of a flight, in the order in which they were seen."""
    scene = "house" if size <= POINTS else "village"
    keyframes = flown(scene, OUTLIERS, seed=1).keyframes
    return np.concatenate([keyframe.points for keyframe in keyframes])[:size]


def _until_first(points: Float64, parameters: Parameters) -> float:
    """Return how long it takes until the first batch is in the map."""
    begin = time.perf_counter()
    MapBuilder(parameters).process_cloud(points)
    return time.perf_counter() - begin


def _times(points: Float64, size: int, parameters: Parameters) -> list[float]:
    """Return how long each batch takes; what is left over at the end is none."""
    builder = MapBuilder(parameters)
    # A map that is looked at is ready to grow: that is no part of the first batch.
    _ = builder.surface
    times = []
    for begin in range(0, len(points) - size + 1, size):
        before = time.perf_counter()
        builder.process_cloud(points[begin : begin + size])
        times.append(time.perf_counter() - before)
    return times


def _exponent(rows: Sequence[BatchPace]) -> float | None:
    if len({row.size for row in rows}) < 2:
        return None
    sizes, seconds = (np.log([getattr(row, name) for row in rows]) for name in ("size", "seconds"))
    return float(np.polyfit(sizes, seconds, 1)[0])


# --- reports ---


def to_dict(pace: Pace, before: Mapping[int, float] | None = None) -> dict[str, Any]:
    """Return what was measured, ready for JSON, with earlier times beside where there are any."""
    report = asdict(pace)
    if before is not None:
        for row in report["rows"]:
            old = before.get(row["size"])
            row |= {"before": old, "ratio": None if old is None else row["seconds"] / old}
    return report


def seconds_of(report: Any, name: str) -> dict[int, float]:
    """Return seconds by size of a report that `to_dict` made.

    Raises
    ------
    InputError
        Where it is none.
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
    """Return a table, with earlier times beside where there are any."""
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
    """Return the times over the sizes, the thesis's beside them, both axes logarithmic."""
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
