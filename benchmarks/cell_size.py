"""How many times the usual distance of points `cell_size: auto` should be.

Run it as ``python benchmarks/cell_size.py``; it takes a minute. `mls compare --truth` allows errors
of half a cell, which would favour large cells. Here the measure does not depend on the cells: maps
and truth are cut into squares of a third of the thesis's cell, and a height is right within half of
that cell, 0.075.
"""

from __future__ import annotations

from dataclasses import replace
from statistics import harmonic_mean, mean

import numpy as np

from mlscli.building.sizes import auto_cell_size
from mlscli.keyframes.batches import gather
from mlscli.maps.surface_map import SurfaceMap
from mlscli.pipeline.parameters import Parameters
from mlscli.runtime.arrays import Bool
from mlscli.scenes.flight import Flight
from mlscli.scenes.truth import truth
from mlscli.scoring.kernels import Patches, covered, nearby
from mlscli.trials.quality import flown
from mlscli.trials.staged import mapped

SQUARE, TOLERANCE, SIDEWAYS = 0.05, 0.075, 3
GAP = 0.45
FACTORS = (0.75, 1.0, 1.25, 1.5, 1.75, 2.0, 2.5, 3.0, 4.0)
DENSITIES = (0.06, 0.12, 0.24)
TUNED = (("bridge", "bridge-walls", "house", "planes", "planes-walls"), (11,))
SHOWN = (("table", "house-storeys", "street", "tunnel", "stair", "parking", "bridge-gap"), (21,))


def main() -> None:
    """Print the agreement for each factor, on the scenes used for tuning and on the others."""
    print("| factor | scenes tuned on | others |")  # noqa: T201
    print("|--:|--:|--:|")  # noqa: T201
    measured = [measure(*scenes_and_seeds) for scenes_and_seeds in (TUNED, SHOWN)]
    for factor, tuned, shown in zip(FACTORS, *measured, strict=True):
        print(f"| {factor:g} | {tuned} | {shown} |")  # noqa: T201


def measure(scenes: tuple[str, ...], seeds: tuple[int, ...]) -> list[str]:
    """Return for each of `FACTORS` the mean agreement, over all of `DENSITIES` and for each."""
    table = np.array(
        [
            [
                mean(
                    agreement(flown(scene, outliers, seed, grid), factor)
                    for scene in scenes
                    for outliers in (0.1, 0.2)
                    for seed in seeds
                )
                for grid in DENSITIES
            ]
            for factor in FACTORS
        ]
    )
    return [f"{row.mean():.1%} ({', '.join(f'{value:.1%}' for value in row)})" for row in table]


def agreement(flight: Flight, factor: float) -> float:
    """Return the harmonic mean of completeness and correctness, as shares of squares.

    Parameters
    ----------
    flight : Flight
    factor : float
        Size of the map's cells, in median distances of a point to its fourth neighbour.
    """
    # The rule takes two times the median distance of a point to its fourth neighbour.
    size = auto_cell_size(gather(flight.keyframes).points.xyz) / 2 * factor
    parameters = Parameters().with_cell_size(size)
    parameters = replace(parameters, map=replace(parameters.map, gap_size=GAP))
    mine = squares(mapped(flight, parameters))
    true = Patches.of(truth(flight.scene, SQUARE, GAP, SQUARE))
    flat = true.take(~true.vertical)
    complete = float(np.mean(near(flat, mine, 0)))
    correct = float(np.mean(near(mine, true, SIDEWAYS)))
    return harmonic_mean([complete, correct])


def near(patches: Patches, others: Patches, reach: int) -> Bool:
    """Return which patches the others within `reach` squares cover, within the tolerance."""
    around = nearby(patches.ix, patches.iy, others.ix, others.iy, reach)
    return covered(patches.low, patches.high, around, others.low, others.high, TOLERANCE)


def squares(surface: SurfaceMap) -> Patches:
    """Return a map's patches, each once for every square whose middle lies in its cell."""
    size = surface.cell_size
    first = np.ceil(np.c_[surface.ix, surface.iy] * size / SQUARE - 0.5).astype(np.int64)
    last = np.ceil(np.c_[surface.ix + 1, surface.iy + 1] * size / SQUARE - 0.5).astype(np.int64)
    wide = last - first
    times = wide[:, 0] * wide[:, 1]
    row = np.repeat(np.arange(surface.size), times)
    within = np.arange(len(row)) - np.repeat(np.cumsum(times) - times, times)
    ix = first[row, 0] + within // np.maximum(wide[row, 1], 1)
    iy = first[row, 1] + within % np.maximum(wide[row, 1], 1)
    order = np.lexsort((surface.height[row], iy, ix))
    row, cells = row[order], np.c_[ix, iy][order].astype(np.int32)
    whole = Patches.of(surface)
    return Patches(
        np.ascontiguousarray(cells[:, 0]),
        np.ascontiguousarray(cells[:, 1]),
        whole.low[row],
        whole.high[row],
        whole.vertical[row],
    )


if __name__ == "__main__":
    main()
