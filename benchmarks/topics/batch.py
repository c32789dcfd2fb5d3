"""A batch into a growing map, by the size of the map; always in time of the processor.

Batches of 52 points, each within a square of 20 x 20 cells, are added to floors of 10^3 to 10^6
patches with 2 points a cell: with the median alone, of which the levels speak, and with the
default pipeline, in both modes. Sizes take turns; the figures are medians of the processor's time,
which is all that a batch takes: it starts no threads.

Every batch has the same surroundings: a map of 10^3 patches, 34 cells wide, is smaller than what
the stages look at around a batch, so that each size is put together from floors of that width, too
far apart to touch, and a batch falls onto the middle of one, as good as none onto one that had
another. The median keeps all points (`min_nb: 0`): alone, a batch has 0.13 points a cell, too few
for its outliers to be told, and would be dropped in the sequential mode.
"""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from statistics import median
from typing import NamedTuple

import numpy as np

from benchmarks.table import Row, Timer
from mlscli.building.builder import MapBuilder
from mlscli.config import load
from mlscli.keyframes.keyframe import Keyframe
from mlscli.pipeline.parameters import Parameters
from mlscli.runtime.arrays import Float64

CELL, DENSITY, SQUARE, BATCH, ROUNDS = 0.15, 2, 20, 52, 40
SIZES = (10**3, 10**4, 10**5, 10**6)
# A floor's width in cells, of which one in seven has no point, and from one floor to the next.
WIDTH, APART = 34, 64
GROWTH = 1.5


class Level(NamedTuple):
    """What a batch may cost at most."""

    pipeline: str
    mode: str
    milliseconds: float | None


LEVELS = (
    Level("median", "sequential", 0.1),
    Level("median", "consistent", 1.0),
    Level("default", "sequential", None),
    Level("default", "consistent", None),
)


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


def floors(patches: int) -> Float64:
    """Return where floors lie that together have about so many patches, in a square."""
    number = max(1, round(patches / 1000))
    side = int(np.ceil(number**0.5))
    column, row = np.divmod(np.arange(number), side)
    corners: Float64 = np.c_[column, row] * (APART * CELL)
    return corners


def scattered(rng: np.random.Generator, width: float, size: int) -> Float64:
    """Return points of a noisy floor, x and y from 0 to `width` cells."""
    xy = rng.uniform(0, width * CELL, (size, 2))
    return np.column_stack((xy, rng.normal(0, CELL / 3, size)))


def grown(parameters: Parameters, patches: int) -> MapBuilder:
    """Return a builder that has a map of about so many patches."""
    rng = np.random.default_rng(1)
    builder = MapBuilder(parameters)
    for corner in floors(patches):
        cloud = scattered(rng, WIDTH, DENSITY * WIDTH**2)
        cloud[:, :2] += corner
        builder.add(Keyframe(cloud))
    builder.process_cloud(np.empty((0, 3)))
    return builder


def parameters_of(level: Level) -> Parameters:
    """Return the parameters of a pipeline in a mode."""
    given = load(None, [f"mode={level.mode}", f"map.cell_size={CELL}", "median.min_nb=0"])
    if level.pipeline == "median":
        return replace(given, pipeline=given.pipeline[:1])
    return given


def milliseconds(parameters: Parameters) -> dict[int, float]:
    """Return the time of a batch by the size of the map."""
    rng = np.random.default_rng(2)
    places = {}
    for patches in SIZES:
        corners = floors(patches)
        builders = [grown(parameters, patches) for _ in range(-(-ROUNDS // len(corners)))]
        places[patches] = [*product(builders, corners)]
        rng.shuffle(places[patches])
    taken = defaultdict(list)
    for turn in range(ROUNDS):
        for patches in SIZES:
            builder, corner = places[patches][turn]
            batch = scattered(rng, SQUARE, BATCH)
            batch[:, :2] += corner + (WIDTH - SQUARE) / 2 * CELL
            begin = time.process_time()
            builder.process_cloud(batch)
            taken[patches].append(time.process_time() - begin)
    return {patches: 1e3 * median(times) for patches, times in taken.items()}
