"""What a tile costs on a cluster: ``python benchmarks/cluster.py``.

Dask starts a cluster on this machine. A tile is evaluated in this process, and by a worker, with
the default stages and with none; what the worker takes longer with none is the transfer: of the
points through the scheduler, and of the patches back. Times are the least of some, as a worker has
to load its kernels first.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import click
import numpy as np

import mlscli
from mlscli.keyframes import Points
from mlscli.pipeline.blocks import PointBlocks
from mlscli.pipeline.connection import connected
from mlscli.pipeline.pipeline import Pipeline
from mlscli.pipeline.report import Report
from mlscli.pipeline.tilewise import Threads, Workers, tiles_of

CELL, POINTS_PER_CELL = 0.1, 10


def plain(points: int) -> Points:
    """Return a hilly plain."""
    rng = np.random.default_rng(1)
    side = (points / POINTS_PER_CELL) ** 0.5 * CELL
    x, y = rng.uniform(0, side, (2, points))
    z = 3 * np.sin(x / 20) * np.cos(y / 30) + rng.normal(0, CELL / 5, points)
    return Points(np.column_stack((x, y, z)), np.zeros(points, dtype=np.int32))


def least(call: Callable[[], object], repeats: int) -> float:
    """Return the least time (s) of some calls."""
    times = []
    for _ in range(repeats):
        begin = time.perf_counter()
        call()
        times.append(time.perf_counter() - begin)
    return min(times)


@click.command()
@click.option("--points", type=float, default=2e5, show_default=True)
@click.option("--repeats", type=int, default=7, show_default=True)
def main(points: float, repeats: int) -> None:
    """Time a tile here and there."""
    default = mlscli.load_parameters(None, [f"map.cell_size={CELL}", "median.nb_radius=1 cell"])
    stages = {"default": default, "no stage": replace(default, pipeline=())}
    with connected("local") as cluster:
        for name, parameters in stages.items():
            pipeline = Pipeline(parameters, "map", Report())
            blocks = PointBlocks(CELL)
            blocks.add(plain(int(points)))
            tiles = tiles_of(blocks, pipeline.reach, int(points))

            def evaluated(workers: Workers) -> int:
                made = list(workers.evaluated(pipeline, blocks, tiles))  # noqa: B023
                return sum(surface.size for surface, _ in made)

            patches = evaluated(Threads(1))
            here = least(lambda: evaluated(Threads(1)), repeats)
            there = least(lambda: evaluated(cluster), repeats)
            click.echo(
                f"{name}: {points:,.0f} points, {patches:,} patches: "
                f"here {here:.2f} s, by a worker {there:.2f} s"
            )


if __name__ == "__main__":
    main()
