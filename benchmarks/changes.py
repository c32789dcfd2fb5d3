"""What two flights tell of changes: ``python -m benchmarks.changes`` (some minutes).

First each scene as it is, flown twice with other noise: nothing has changed, and what is told is
wrong. Then a yard, with a box in it that is gone at the second flight, or came: of boxes of several
sizes, how many are told, as how many things, and what else is.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import click
import numpy as np

from benchmarks.table import lines
from mlscli.building.build import settled
from mlscli.maps.surface_map import SurfaceMap
from mlscli.pipeline.parameters import Parameters
from mlscli.pipeline.report import Report
from mlscli.scenes.flight import fly
from mlscli.scenes.noise import Noise
from mlscli.scenes.parts import block, floor
from mlscli.scenes.presets import make
from mlscli.scenes.surfaces import Scatter, Scene
from mlscli.scoring.changes import Changes, changes
from mlscli.trials.quality import GRID, SCENES
from mlscli.trials.staged import mapped

NOISES = {"thesis": Noise(), "slam 0.02": Noise("slam", Scatter(0.02, 0.02))}
# Length, width and height of a box: a car, a person, a crate, a kerb; in the unit of the scenes.
BOXES = {
    "2 x 1.2 x 1": (2.0, 1.2, 1.0),
    "0.6 x 0.6 x 1.8": (0.6, 0.6, 1.8),
    "1 x 1 x 0.5": (1.0, 1.0, 0.5),
    "1 x 1 x 0.3": (1.0, 1.0, 0.3),
}
HEAD = ("what", "noise", "flights", "told wrongly", "largest, cells cubed", "too small to tell")
BOX_HEAD = ("box", "noise", "told when gone", "when it came", "things told beside it")


def two(scenes: tuple[Scene, Scene], noise: Noise, seed: int) -> tuple[SurfaceMap, SurfaceMap]:
    """Return maps of two flights on the cells that suit the first."""
    flights = [fly(scene, GRID, noise, seed=seed + 100 * n) for n, scene in enumerate(scenes)]
    parameters = settled(Parameters(), flights[0].keyframes, Report())
    chosen = replace(parameters, map=replace(parameters.map, free_space=True))
    one, other = (mapped(flight, chosen) for flight in flights)
    return one, other


def unchanged(seeds: Sequence[int]) -> Iterator[tuple[str, ...]]:
    """Yield a row for each scene and noise: what is told though nothing has changed."""
    for scene in SCENES:
        for name, noise in NOISES.items():
            told: list[Changes] = []
            largest = 0.0
            for seed in seeds:
                one, other = two((make(scene), make(scene)), noise, seed)
                told.append(changes(one, other))
                every = changes(one, other, smallest=0)
                volumes = [thing.volume for thing in (*every.appeared, *every.gone)]
                largest = max([largest, *(np.array(volumes) / one.cell_size**3)])
            wrong = sum(len(each.appeared) + len(each.gone) for each in told)
            small = sum(sum(each.smaller) for each in told)
            yield scene, name, str(len(seeds)), str(wrong), f"{largest:.1f}", str(small)


def boxes(seeds: Sequence[int]) -> Iterator[tuple[str, ...]]:
    """Yield a row for each box and noise: how often it is told."""
    for what, (length, width, height) in BOXES.items():
        yard = floor(Scene("yard"), (-5, 5), (-4, 4), 0.0)
        yard = block(yard, (-4, -1.5), (-3, -0.5), (0.0, 1.6))
        full = block(yard, (2 - length / 2, 2 + length / 2), (1, 1 + width), (0.0, height))
        for name, noise in NOISES.items():
            found, beside = [0, 0], 0
            for seed in seeds:
                before, after = two((full, yard), noise, seed)
                for n, result in enumerate((changes(before, after), changes(after, before))):
                    things = [*result.gone, *result.appeared]
                    hits = [
                        thing.low[0] < 2 < thing.high[0]
                        and thing.low[1] < 1 + width / 2 < thing.high[1]
                        for thing in (result.gone, result.appeared)[n]
                    ]
                    found[n] += any(hits)
                    beside += len(things) - any(hits)
            yield what, name, *(f"{count} of {len(seeds)}" for count in found), str(beside)


@click.command()
@click.option("--seeds", default="5,6,7", help="Of the flights, with commas between.")
def main(seeds: str) -> None:
    """Print both tables."""
    chosen = [int(seed) for seed in seeds.split(",")]
    for head, rows in ((HEAD, unchanged(chosen)), (BOX_HEAD, boxes(chosen))):
        click.echo("\n".join(lines(head, rows)))
        click.echo()


if __name__ == "__main__":
    main()
