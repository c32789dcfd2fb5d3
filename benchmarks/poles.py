"""The tops of thin poles over a floor: what their points show, what the median leaves of them.

Run it as ``python -m benchmarks.poles``; it takes half a minute. A pole stands in a cell of 0.15,
1.5 high, its points in rings one above the other, as far apart in height as around. Figures are in
the unit of the scene, means over `SEEDS` where there is noise.
"""

from __future__ import annotations

from collections.abc import Iterator

import click
import numpy as np

from benchmarks.table import lines
from mlscli.building.builder import MapBuilder
from mlscli.keyframes.batches import Points
from mlscli.keyframes.keyframe import Keyframe
from mlscli.pipeline.parameters import Parameters
from mlscli.pipeline.stages.stage import PointStage
from mlscli.runtime.arrays import Float64

CELL, HEIGHT, FLOOR_GRID = 0.15, 1.5, 0.12
RADII, SPACINGS, SIGMAS = (0.0, 0.03, 0.06), (0.02, 0.04, 0.06, 0.08, 0.12), (0.0, 0.03)
SEEDS = range(12)
HEAD = ("radius", "spacing", "sigma", "points", "after the median", "map", "dropped")


def pole(radius: float, spacing: float) -> Float64:
    """Return the points of a pole, lowest first, float64 (N, 3)."""
    around, rings = max(round(2 * np.pi * radius / spacing), 1), round(HEIGHT / spacing)
    angle = np.tile(np.arange(around) * 2 * np.pi / around, rings)
    z = np.repeat((np.arange(rings) + 0.5) * HEIGHT / rings, around)
    x, y = radius * np.cos(angle), radius * np.sin(angle)
    return np.column_stack((CELL / 2 + x, CELL / 2 + y, z))


def floor(radius: float) -> Float64:
    """Return the points of a floor with a hole where the pole stands, float64 (N, 3)."""
    x, y = (axis.ravel() for axis in np.mgrid[-1.5:1.5:FLOOR_GRID, -1.5:1.5:FLOOR_GRID])
    outside = np.hypot(x - CELL / 2, y - CELL / 2) > radius
    ground: Float64 = np.column_stack((x, y, np.zeros_like(x)))[outside]
    return ground


def tops(points: Float64, size: int) -> tuple[float, float, float, float]:
    """Return how far below `HEIGHT` a pole ends, and the share of its points that are dropped.

    Parameters
    ----------
    points : float64 (N, 3)
        The first `size` of them are those of the pole.
    size : int

    Returns
    -------
    points, median, map, dropped : float
        The highest point, the highest after the points' stages, and the map's highest patch in the
        pole's cell.
    """
    parameters = Parameters().with_cell_size(CELL)
    left = Points.of(points, np.zeros(len(points), dtype=np.int32)).xyz
    for stage in parameters.pipeline:
        if isinstance(stage, PointStage) and stage.name == "median":
            cloud = Points.of(left, np.zeros(len(left), dtype=np.int32))
            left = stage.evaluate(cloud, CELL).xyz
    z = left[:size, 2]
    builder = MapBuilder(parameters)
    builder.add(Keyframe(points))
    surface = builder.finish()
    own = (surface.ix == 0) & (surface.iy == 0)
    highest = points[:size, 2].max(), np.nanmax(z, initial=0.0), surface.height[own].max(initial=0)
    return *(float(HEIGHT - top) for top in highest), float(np.isnan(z).mean())  # type: ignore[return-value]


def rows() -> Iterator[tuple[str, ...]]:
    """Yield a row for each pole and noise."""
    for radius in RADII:
        for spacing in SPACINGS:
            own = pole(radius, spacing)
            exact = np.concatenate((own, floor(radius)))
            for sigma in SIGMAS:
                found = []
                for seed in SEEDS if sigma else SEEDS[:1]:
                    rng = np.random.default_rng(seed)
                    noisy = exact + rng.normal(0.0, 1.0, exact.shape) * sigma
                    found.append(tops(noisy, len(own)))
                points, median, surface, dropped = np.mean(found, axis=0)
                figures = (f"{each:.3f}" for each in (points, median, surface))
                yield f"{radius}", f"{spacing}", f"{sigma}", *figures, f"{dropped:.0%}"


@click.command(help=__doc__)
def main() -> None:
    """Print the table."""
    for line in lines(HEAD, rows()):
        click.echo(line)


if __name__ == "__main__":
    main()
