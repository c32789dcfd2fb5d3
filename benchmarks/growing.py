"""What a batch costs as the map grows: ``python benchmarks/growing.py`` (two minutes).

Batches of 52 points, each within a square of 20 x 20 cells, are added to floors of 10^3 to 10^6
patches with the default pipeline, in both modes. Sizes take turns; the figures are medians.
"""

from __future__ import annotations

import time
from collections import defaultdict
from statistics import median

import click
import numpy as np

from mlscli.config import Parameters, load
from mlscli.keyframes import Keyframe
from mlscli.pipeline.builder import MapBuilder
from mlscli.typing import Float64

CELL, POINTS_PER_CELL, SQUARE, BATCH, ROUNDS = 0.15, 3, 20, 52, 15
SIZES = (10**3, 10**4, 10**5, 10**6)


def floor(rng: np.random.Generator, side: float, size: int) -> Float64:
    """Return points of a noisy floor, x and y from 0 to `side`."""
    xy = rng.uniform(0, side, (size, 2))
    return np.column_stack((xy, rng.normal(0, CELL / 3, size)))


def grown(parameters: Parameters, patches: int) -> MapBuilder:
    """Return a builder that has a map of about so many patches."""
    side = patches**0.5 * CELL
    builder = MapBuilder(parameters)
    rng = np.random.default_rng(1)
    builder.add(Keyframe(floor(rng, side, patches * POINTS_PER_CELL)))
    _ = builder.surface
    return builder


def main() -> None:
    """Print a row for each mode and size."""
    click.echo("| mode | patches | ms per batch | times the least |\n|:--|--:|--:|--:|")
    for mode in ("consistent", "sequential"):
        parameters = load(None, [f"mode={mode}", f"map.cell_size={CELL}"])
        builders = {patches: grown(parameters, patches) for patches in SIZES}
        rng = np.random.default_rng(2)
        taken = defaultdict(list)
        for _ in range(ROUNDS):
            for patches, builder in builders.items():
                room = patches**0.5 * CELL - SQUARE * CELL
                batch = floor(rng, SQUARE * CELL, BATCH)
                batch[:, :2] += rng.uniform(0, room, 2)
                begin = time.perf_counter()
                builder.process_cloud(batch)
                taken[patches].append(time.perf_counter() - begin)
        milliseconds = {patches: 1e3 * median(times) for patches, times in taken.items()}
        for patches, spent in milliseconds.items():
            least = spent / min(milliseconds.values())
            click.echo(f"| {mode} | {patches:,} | {spent:.1f} | {least:.2f} |")


if __name__ == "__main__":
    main()
