"""Walls that stand alone on a field: in how many pieces their columns are, and what is covered.

Run it as ``python -m benchmarks.lone_walls``; it takes some minutes. So little stands upright there
that `gap_size: auto` is small. Flights over a field of 60 x 60 have points `GRIDS` apart, of which
half are found, without noise and with the thesis's, or with ``--slam SIGMA`` with depths that err
with the square of the distance; each is mapped with and without `walls.pieces`, and with gaps as
high as the vehicle. Figures are means over walls of all `HEIGHTS`, grids and noises.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import cos, radians, sin
from statistics import mean

import click
import numpy as np

from benchmarks.table import lines
from mlscli.building.build import settled
from mlscli.config import load
from mlscli.maps.surface_map import SurfaceMap
from mlscli.pipeline.report import Report
from mlscli.runtime.arrays import Float64
from mlscli.scenes.flight import fly
from mlscli.scenes.noise import Noise
from mlscli.scenes.surfaces import Scatter, Scene, add_horizontal, add_vertical
from mlscli.scenes.truth import truth
from mlscli.scoring import score
from mlscli.trials.staged import mapped

SIDE, TEXTURE = 60.0, 0.5
HEIGHTS, GRIDS = (3.0, 6.0), (0.4, 0.8)
# Sigma in spacings of the points, and salt and pepper.
NOISES = ((0.0, 0.0), (0.4, 0.1))
# Where a wall stands: the middle, length and orientation of each part.
KINDS: dict[str, list[tuple[float, float, float, float]]] = {
    "wall": [(0.0, 0.37, 20.0, 0.0)],
    "wall at 30 degrees": [(0.0, 0.37, 20.0, 30.0)],
    "fence, a gap of 1 every 3": [(4.0 * n - 14.0, 0.37, 3.0, 0.0) for n in range(8)],
    "tower, 3 x 3": [
        *((x, 0.37, 3.0, 90.0) for x in (-1.13, 1.87)),
        *((0.37, y, 3.0, 0.0) for y in (-1.13, 1.87)),
    ],
}
SETTINGS = {
    "`walls.pieces=0`": ["walls.pieces=0"],
    "the default": [],
    "`map.gap_size=null`": ["map.gap_size=null"],
}
HEAD = ("what", "setting", "gap in cells", "columns in pieces", "height covered", "walls found")


def scene(kind: str, height: float) -> Scene:
    """Return a field with walls of one kind."""
    made = add_horizontal(Scene(kind), position=(0, 0, 0), size=(SIDE, SIDE), texture=TEXTURE)
    for x, y, length, turn in KINDS[kind]:
        made = add_vertical(
            made,
            position=(x, y, height / 2),
            size=(length, height),
            orientation=turn,
            texture=TEXTURE,
        )
    return made


def columns(kind: str, cell_size: float) -> list[tuple[int, int]]:
    """Return the cells through which walls run."""
    cells = set[tuple[int, int]]()
    for x, y, length, turn in KINDS[kind]:
        along = np.arange(-length / 2, length / 2, cell_size / 8)
        for t in along:
            place = x + t * cos(radians(turn)), y + t * sin(radians(turn))
            cells.add((int(place[0] // cell_size), int(place[1] // cell_size)))
    return sorted(cells)


def standing(surface: SurfaceMap, kind: str, height: float) -> Float64:
    """Return for each column of a wall whether it is in pieces, and how much is covered, (C, 2)."""
    low, found = surface.low_end, []
    for ix, iy in columns(kind, surface.cell_size):
        here = (surface.ix == ix) & (surface.iy == iy) & (surface.origin == 0)
        above = here & (surface.height > surface.cell_size / 2)
        covered = np.minimum(surface.height[here], height) - np.maximum(low[here], 0.0)
        found.append((np.count_nonzero(above) > 1, np.maximum(covered, 0.0).sum() / height))
    return np.array(found, dtype=np.float64).reshape(-1, 2)


def noises(grid: float, slam: float | None) -> list[Noise]:
    """Return the noises to try; `slam`: the sigma of depths at a distance of 2."""
    if slam is not None:
        return [Noise("slam", Scatter(slam, slam))]
    return [Noise(sigma=Scatter(s * grid, s * grid), salt_pepper=pepper) for s, pepper in NOISES]


def rows(kind: str, slam: float | None) -> Iterator[tuple[str, ...]]:
    """Yield the rows of one kind of wall."""
    flights = [
        (fly(scene(kind, height), grid, noise), height)
        for height in HEIGHTS
        for grid in GRIDS
        for noise in noises(grid, slam)
    ]
    for name, settings in SETTINGS.items():
        gaps, shares, whole = [], [], []
        for flight, height in flights:
            surface = mapped(flight, settled(load(None, settings), flight.keyframes, Report()))
            true = truth(flight.scene, surface.cell_size, surface.gap_size, surface.thickness)
            gaps.append(surface.gap_size / surface.cell_size)
            shares.append(standing(surface, kind, height).mean(axis=0))
            whole.append(score(surface, true).total.completeness_vertical.share or 0.0)
        split, covered = np.mean(shares, axis=0)
        figures = f"{mean(gaps):.2f}", f"{split:.0%}", f"{covered:.0%}", f"{mean(whole):.0%}"
        yield kind, name, *figures


@click.command(help=__doc__)
@click.option("--kind", "kinds", multiple=True, type=click.Choice(list(KINDS)), help="Only this.")
@click.option("--slam", type=click.FloatRange(min=0), help="Sigma of depths at a distance of 2.")
def main(kinds: tuple[str, ...], slam: float | None) -> None:
    """Print the table."""
    for line in lines(HEAD, (row for kind in kinds or KINDS for row in rows(kind, slam))):
        click.echo(line)


if __name__ == "__main__":
    main()
