"""What a tile costs on a cluster: ``python -m benchmarks.cluster``.

Dask starts a cluster on this machine. A tile is evaluated in this process and by a worker, with the
default stages and with none. The difference with none is the time of the transfer: of the points
through the scheduler, and of the patches back.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import click

import mlscli
from benchmarks.clouds import CELL, cloud
from benchmarks.table import Timer
from mlscli.pipeline.pipeline import Pipeline
from mlscli.pipeline.report import Report
from mlscli.pipeline.tilewise.blocks import PointBlocks
from mlscli.pipeline.tilewise.connection import connected
from mlscli.pipeline.tilewise.tiles import Threads, Tile, Workers, tiles_of

DENSITY = 10.0


def evaluate_all(
    workers: Workers, pipeline: Pipeline, blocks: PointBlocks, tiles: Sequence[Tile]
) -> int:
    """Return how many patches the workers make of the tiles."""
    return sum(tile.surface.size for tile in workers.evaluate_all(pipeline, blocks, tiles))


@click.command()
@click.option("--points", type=float, default=2e5, show_default=True)
@click.option("--repeats", type=int, default=7, show_default=True)
def main(points: float, repeats: int) -> None:
    """Time a tile in this process and on a worker."""
    default = mlscli.load_parameters(None, [f"map.cell_size={CELL}", "median.nb_radius=1 cell"])
    stages = {"default": default, "no stage": replace(default, pipeline=())}
    with connected("local") as cluster:
        for name, parameters in stages.items():
            pipeline = Pipeline(parameters, "map", Report())
            blocks = PointBlocks(CELL)
            blocks.add(cloud(int(points), DENSITY))
            tiles = tiles_of(blocks, pipeline.reach, int(points))
            works = [
                partial(evaluate_all, workers, pipeline, blocks, tiles)
                for workers in (Threads(1), cluster)
            ]
            patches = works[0]()
            here, there = Timer(repeats).seconds(*works)
            click.echo(
                f"{name}: {points:,.0f} points, {patches:,} patches: "
                f"here {here:.2f} s, by a worker {there:.2f} s"
            )


if __name__ == "__main__":
    main()
