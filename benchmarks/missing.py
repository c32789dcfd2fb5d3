"""What maps of scenes miss, scene by scene, and how much of that was there to be found.

Run it as ``python -m benchmarks.missing``; it takes some minutes. Flights have the thesis's noise,
a tenth of outliers, and cells of the size of auto, as in the last table of `benchmarks/rules.py`.
The same flights without any noise say what was seen at all; mapped with no stage, what they miss is
where no point lies.
"""

from __future__ import annotations

from dataclasses import replace
from statistics import mean

import click

from benchmarks.table import lines
from mlscli.building.build import settled
from mlscli.config import load
from mlscli.maps.surface_map import SurfaceMap
from mlscli.pipeline.parameters import Parameters
from mlscli.pipeline.report import Report
from mlscli.scenes.flight import Flight, fly
from mlscli.scenes.noise import Noise
from mlscli.scenes.presets import make
from mlscli.scenes.surfaces import Scatter
from mlscli.scenes.truth import truth
from mlscli.scoring import Score, score
from mlscli.trials.quality import GRID, SCENES, flown
from mlscli.trials.staged import mapped

SEEDS = (1, 2, 3)
EXACT = Noise(sigma=Scatter(0.0, 0.0), salt_pepper=0.0)
HEAD = ("scene", "default", "floors", "walls", "no noise", "no noise, no stage", "walls of these")


def completeness(scene: str) -> tuple[str, ...]:
    """Return the row of a scene: its name, and shares of the true patches that are found."""
    noisy, exact, bare = list[Score](), list[Score](), list[Score]()
    for seed in SEEDS:
        flight = flown(scene, 0.1, seed)
        chosen = settled(Parameters(), flight.keyframes, Report())
        clean = fly(make(scene), GRID, EXACT, seed=seed)
        plain = replace(load("plain"), map=chosen.map)
        noisy.append(_scored(flight, mapped(flight, chosen)))
        exact.append(_scored(flight, mapped(clean, chosen)))
        bare.append(_scored(flight, mapped(clean, plain)))
    kinds = ("completeness", "completeness_horizontal", "completeness_vertical")
    every, floors, walls = kinds
    chosen_kinds = ((noisy, every), (noisy, floors), (noisy, walls), (exact, every))
    return (
        scene,
        *(_share(scores, kind) for scores, kind in (*chosen_kinds, (bare, every), (bare, walls))),
    )


def _scored(flight: Flight, surface: SurfaceMap) -> Score:
    true = truth(flight.scene, surface.cell_size, surface.gap_size, surface.thickness)
    return score(surface, true)


def _share(scores: list[Score], kind: str) -> str:
    shares = [getattr(each.total, kind).share for each in scores]
    known = [share for share in shares if share is not None]
    return f"{mean(known):.2%}" if known else ""


@click.command(help=__doc__)
@click.option("--scene", "scenes", multiple=True, type=click.Choice(SCENES), help="Only this.")
def main(scenes: tuple[str, ...]) -> None:
    """Print the table."""
    for line in lines(HEAD, (completeness(scene) for scene in scenes or SCENES)):
        click.echo(line)


if __name__ == "__main__":
    main()
