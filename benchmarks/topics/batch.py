"""A batch into a growing map, by the size of the map; always in CPU time.

Batches of 52 points, each within a square of 20 x 20 cells, are added to floors of 10^3 to 10^6
patches with 2 points a cell: with the median alone and with the default pipeline, in both modes.
Sizes take turns; the figures are medians of the CPU time, which is the whole time of a batch, as it
starts no threads.

Every batch has the same surroundings. A map of 10^3 patches, 34 cells wide, is smaller than the
reach of the stages around a batch. So a map of any size consists of floors of this width, too far
apart to affect each other. A batch falls onto the middle of a floor, rarely onto one that already
had a batch. The median keeps all points (`min_nb: 0`): in the sequential mode it sees a batch by
itself, 0.13 points a cell, and would drop all of it for lack of neighbours.
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
# A floor's width in cells, of which one in seven has no point, and the distance of two floors.
WIDTH, APART = 34, 64
GROWTH = 1.5


class Level(NamedTuple):
    """The most that a batch may cost.

    Attributes
    ----------
    pipeline : {"median", "default"}
        The stages: the median alone, or the default ones.
    mode : {"sequential", "consistent"}
        As in `Parameters`.
    milliseconds : float
        The most CPU time of a batch.
    """

    pipeline: str
    mode: str
    milliseconds: float


LEVELS = (
    Level("median", "sequential", 0.1),
    Level("median", "consistent", 1.0),
    Level("default", "sequential", 0.4),
    Level("default", "consistent", 1.0),
)


def rows(timer: Timer) -> Iterator[Row]:  # noqa: ARG001  # it has its own repeats
    """Yield the time of a batch by pipeline, mode and size of the map, and how it grows."""
    for level in LEVELS:
        spent = milliseconds(parameters_of(level))
        pipeline = f"{level.pipeline} alone" if level.pipeline == "median" else level.pipeline
        what = f"batch of {BATCH}, {level.mode}, {pipeline}"
        for patches, cost in spent.items():
            largest = patches == SIZES[-1]
            size = f"{what}, {patches:,} patches"
            yield Row(size, cost, "ms", most=level.milliseconds, short=largest)
        growth = max(spent.values()) / spent[SIZES[0]]
        grown = f"{what}: growth from {SIZES[0]:,} patches"
        yield Row(grown, growth, "times", most=GROWTH, short=True)


def floors(patches: int) -> Float64:
    """Return the least x and y, (F, 2), of floors that together have about `patches` patches."""
    number = max(1, round(patches / 1000))
    side = int(np.ceil(number**0.5))
    column, row = np.divmod(np.arange(number), side)
    corners: Float64 = np.c_[column, row] * (APART * CELL)
    return corners


def scattered(rng: np.random.Generator, width: float, size: int) -> Float64:
    """Return `size` points (N, 3) of a noisy floor, x and y from 0 to `width` cells."""
    xy = rng.uniform(0, width * CELL, (size, 2))
    return np.column_stack((xy, rng.normal(0, CELL / 3, size)))


def grown(parameters: Parameters, patches: int) -> MapBuilder:
    """Return a builder whose map has about `patches` patches."""
    rng = np.random.default_rng(1)
    builder = MapBuilder(parameters)
    for corner in floors(patches):
        cloud = scattered(rng, WIDTH, DENSITY * WIDTH**2)
        cloud[:, :2] += corner
        builder.add(Keyframe(cloud))
    builder.process_cloud(np.empty((0, 3)))
    return builder


def parameters_of(level: Level) -> Parameters:
    """Return the parameters with the pipeline and the mode of a level."""
    given = load(None, [f"mode={level.mode}", f"map.cell_size={CELL}", "median.min_nb=0"])
    if level.pipeline == "median":
        return replace(given, pipeline=tuple(s for s in given.pipeline if s.name == "median"))
    return given


def milliseconds(parameters: Parameters) -> dict[int, float]:
    """Return the median CPU time (ms) of a batch by the size of the map, one of `SIZES`."""
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
