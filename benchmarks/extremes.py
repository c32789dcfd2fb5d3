"""Clouds that ask most of each stage: ``python -m benchmarks.extremes`` (a minute).

Each is built with the default pipeline at 1, 2 and 4 times a number of points. The exponent is that
of the processor time from the second to the third: near 1 is linear, 2 would be a square.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from statistics import median

import click
import numpy as np

from benchmarks.table import lines
from mlscli.building.build import build
from mlscli.errors import InputError
from mlscli.pipeline.parameters import MapParameters, Parameters
from mlscli.pipeline.stages.median import Median
from mlscli.runtime.arrays import Float64

CELL = 0.1
HEAD = ("cloud", "points", "seconds", "patches", "exponent")


def equal(points: int, _: np.random.Generator) -> Float64:
    """Return points that are all the same."""
    return np.full((points, 3), 1.05)


def one_cell(points: int, rng: np.random.Generator) -> Float64:
    """Return points in one cell, at most a cell high."""
    return CELL * rng.random((points, 3))


def line(points: int, rng: np.random.Generator) -> Float64:
    """Return points on a line, ten to a cell."""
    return np.column_stack([CELL / 10 * points * rng.random(points), *np.zeros((2, points))])


def levels(points: int, rng: np.random.Generator) -> Float64:
    """Return levels of 20 points each, one above the other in 3 by 3 cells."""
    return np.column_stack(
        [3 * CELL * rng.random((points, 2)), 5 * CELL * (np.arange(points) // 20)]
    )


def thin_levels(points: int, rng: np.random.Generator) -> Float64:
    """Return levels of five points each: too few to bear each other out."""
    return np.column_stack(
        [3 * CELL * rng.random((points, 2)), 5 * CELL * (np.arange(points) // 5)]
    )


def outliers(points: int, rng: np.random.Generator) -> Float64:
    """Return a floor of three by three cells, a third of its points at any height."""
    cloud = np.column_stack([3 * CELL * rng.random((points, 2)), 0.02 * rng.normal(size=points)])
    cloud[::3, 2] = 100 * CELL * rng.random(len(cloud[::3]))
    return cloud


CLOUDS: dict[str, tuple[Callable[[int, np.random.Generator], Float64], int]] = {
    "equal points": (equal, 250_000),
    "points in one cell": (one_cell, 25_000),
    "points on a line": (line, 250_000),
    "levels of 20 points in 3 x 3 cells": (levels, 50_000),
    "levels of 5 points in 3 x 3 cells": (thin_levels, 50_000),
    "a dense floor, a third outliers": (outliers, 25_000),
}


def seconds(cloud: Float64, parameters: Parameters) -> tuple[float, int]:
    """Return the processor time of a build, and how many patches it made."""
    begin, patches = time.process_time(), 0
    with suppress(InputError):  # Nothing was left, which is an answer.
        patches = build(cloud, parameters).surface.size
    return time.process_time() - begin, patches


@click.command()
@click.option("--turns", default=3, help="Of which medians are taken.")
def main(turns: int) -> None:
    """Print the table."""
    usual = Parameters(map=MapParameters(cell_size=CELL))
    wide = replace(
        usual,
        pipeline=tuple(
            replace(stage, nb_radius=100.0) if isinstance(stage, Median) else stage
            for stage in usual.pipeline
        ),
    )
    rows = []
    for name, (cloud, points) in CLOUDS.items():
        rows.append(_row(name, cloud, points, usual, turns))
    rows.append(_row("radius of the median: all points", line, 25_000, wide, turns))
    for text in lines(HEAD, rows):
        click.echo(text)


def _row(
    name: str,
    cloud: Callable[[int, np.random.Generator], Float64],
    points: int,
    parameters: Parameters,
    turns: int,
) -> tuple[str, ...]:
    rng = np.random.default_rng(1)
    clouds = [cloud(times * points, rng) for times in (1, 2, 4)]
    seconds(clouds[0], parameters)
    measured = [[seconds(each, parameters) for each in clouds] for _ in range(turns)]
    taken = [median(turn[size][0] for turn in measured) for size in range(3)]
    return (
        name,
        ", ".join(f"{len(each):,}" for each in clouds),
        ", ".join(f"{each:.2f}" for each in taken),
        f"{measured[0][2][1]:,}",
        f"{math.log2(taken[2] / taken[1]):.2f}",
    )


if __name__ == "__main__":
    main()
