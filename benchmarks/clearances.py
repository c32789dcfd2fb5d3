"""How often a clearance is right: ``python -m benchmarks.clearances`` (a quarter of an hour).

Crafts of several sizes fly under the bridge of height 2, through the window that is 0.7 wide and
high, and at boxes and sheets that nobody can look into or see. Whether they truly fit is found from
the scene's own surfaces, sampled finely, and the craft's cylinder, place by place. Each row tells
how often each verdict was given; wrong is a `fits` of what does not fit or cannot be looked into,
and a `does not fit` of what fits with a point spacing to spare on every side.

The flights begin with the scene's own legs, and each leg finds its points anew (`mls synth
--anew`). ``--seeds`` says how many are flown, from 0 on; the rules were tuned on seeds from 100 on.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import click
import numpy as np

from benchmarks.table import lines
from mlscli.building.build import settled
from mlscli.building.builder import MapBuilder
from mlscli.keyframes.keyframe import Keyframe
from mlscli.maps.surface_map import SurfaceMap
from mlscli.pipeline.parameters import Parameters
from mlscli.pipeline.report import Report
from mlscli.queries.clearance import BLOCKED, FITS, VERDICTS, clearance
from mlscli.runtime.arrays import Float64
from mlscli.scenes.flight import fly
from mlscli.scenes.noise import Noise
from mlscli.scenes.parts import floor, walls
from mlscli.scenes.sampling import sample
from mlscli.scenes.surfaces import Leg, Scatter, Scene, add_vertical
from mlscli.scenes.thesis_scenes import bridge, house

CELL, SPACING = 0.15, 0.1
NOISES = {
    "sigma 0.02": Noise(sigma=Scatter(0.02, 0.02), salt_pepper=0.0),
    "sigma 0.05, salt and pepper": Noise(),
}
# The scene's surfaces are sampled so finely, and places lie so far apart, to find what truly fits.
FINE = 0.02
HEAD = ("scene", "noise", "craft", "truly", *VERDICTS, "wrong")


class Trial(NamedTuple):
    """A scene, a way through it, and crafts that try it.

    Attributes
    ----------
    name : str
    scene : Scene
    way : tuple of places
        x, y, z of its corners.
    crafts : tuple of (float, float)
        Width and height of each.
    closed : bool
        Whether nobody can look into where the way leads.
    """

    name: str
    scene: Scene
    way: tuple[tuple[float, float, float], ...]
    crafts: tuple[tuple[float, float], ...]
    closed: bool = False

    @property
    def corners(self) -> Float64:
        """The way, float64 (K, 3)."""
        return np.array(self.way)


def bridge_looked_at(height: float = 2.0) -> Scene:
    """Return the bridge, and a flight that looks around below it at three heights."""
    scene = bridge(height)
    for share in (0.25, 0.5, 0.75):
        below, z = (0.0, 0.0, share * height), share * height
        for y in (-2.4, 2.4):
            there = (0.0, y, z)
            scene = scene.with_legs(Leg(below, there, tilt=85), Leg(there, below, tilt=85))
    return scene


def _around(scene: Scene) -> Scene:
    """Return a scene with legs on all sides, at two heights, the camera inwards."""
    legs = []
    for z in (0.5, 1.2):
        corners = [(-2.4, -2.0, z), (2.4, -2.0, z), (2.0, 2.4, z), (-2.0, 2.4, z)]
        for a, b in zip(corners, corners[1:] + corners[:1], strict=True):
            legs += [Leg(a, b, tilt=75, yaw=90), Leg(b, a, tilt=75, yaw=-90)]
    return scene.with_legs(*legs)


def _ground(name: str) -> Scene:
    return floor(Scene(name), (-3.0, 3.0), (-3.0, 3.0), 0.0)


def box(half: float, height: float, texture: float) -> Scene:
    """Return a closed box on the ground; of texture 0, no point of it is found."""
    side = (-half, half)
    scene = walls(_ground("box"), side, side, (0.0, height), texture=texture)
    return _around(floor(scene, side, side, height, texture=texture))


def trials() -> Iterator[Trial]:
    """Yield the bridge, the window, and what nobody can look into."""
    under = ((0.0, -1.5, 1.0), (0.0, 1.5, 1.0))
    crafts = tuple((0.6, height) for height in (1.3, 1.5, 1.7, 1.9, 2.1, 2.3, 2.5))
    yield Trial("bridge of 2.0", bridge_looked_at(), under, crafts)
    window = ((0.0, 0.2, 0.75), (0.0, 2.0, 0.75))
    crafts = tuple((size, size) for size in (0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0))
    yield Trial("window of 0.7", house(0.7), window, crafts)
    small = ((0.1, 0.1), (0.2, 0.2), (0.3, 0.3))
    for half, height in ((0.3, 0.6), (0.5, 0.9)):
        inside = ((-0.05, 0.0, height / 2), (0.05, 0.0, height / 2))
        for texture in (1.0, 0.0):
            what = f"inside a{' white' * (not texture)} box of {2 * half:g}"
            yield Trial(what, box(half, height, texture), inside, small, closed=True)
    through = ((-1.0, 0.1, 0.6), (1.0, 0.1, 0.6))
    yield Trial("through a white box of 1", box(0.5, 0.9, 0.0), through, small, closed=True)
    sheet = _around(add_vertical(_ground("sheet"), (0, 0, 0.6), (1.6, 1.2), 90, texture=0.0))
    yield Trial("through a white sheet", sheet, through, small, closed=True)
    plate = _around(floor(_ground("plate"), (-0.6, 0.6), (-0.6, 0.6), 1.0, texture=0.0))
    up = ((0.1, 0.1, 0.6), (0.1, 0.1, 1.4))
    yield Trial("up through a white plate", plate, up, small, closed=True)


def mapped(scene: Scene, noise: Noise, seed: int) -> SurfaceMap:
    """Return the map of a flight, with free space."""
    return map_of(fly(scene, SPACING, noise, seed=seed, anew=True).keyframes)


def map_of(keyframes: list[Keyframe]) -> SurfaceMap:
    """Return the map of keyframes, with free space."""
    parameters = Parameters().with_cell_size(CELL).with_free_space()
    builder = MapBuilder(settled(parameters, keyframes, Report()))
    for keyframe in keyframes:
        builder.add(keyframe)
    return builder.finish()


def truly_fits(scene: Scene, corners: Float64, width: float, height: float) -> bool:
    """Return whether no point of the surfaces lies in the cylinder at any place of the way."""
    points = sample(scene, FINE).xyz
    room = np.array([width, width, height])
    near = (points >= corners.min(axis=0) - room) & (points <= corners.max(axis=0) + room)
    points = points[near.all(axis=1)]
    for a, b in pairwise(corners):
        steps = max(2, int(np.linalg.norm(b - a) / FINE))
        for share in np.linspace(0, 1, steps):
            off = points - (a + share * (b - a))
            inside = np.abs(off[:, 2]) < height / 2
            inside &= (off[:, :2] ** 2).sum(axis=1) < width * width / 4
            if inside.any():
                return False
    return True


def is_wrong(trial: Trial, craft: tuple[float, float], verdict: int) -> bool:
    """Return whether a verdict says what is not so."""
    if verdict == FITS:
        return trial.closed or not truly_fits(trial.scene, trial.corners, *craft)
    roomy = tuple(size + 2 * SPACING for size in craft)
    return verdict == BLOCKED and truly_fits(trial.scene, trial.corners, *roomy)


def rows(trial: Trial, noise: str, seeds: range) -> Iterator[tuple[str, ...]]:
    """Yield a row for each craft of a trial."""
    surfaces = [mapped(trial.scene, NOISES[noise], seed) for seed in seeds]
    for craft in trial.crafts:
        found = Counter(clearance(each, trial.corners, *craft).overall for each in surfaces)
        wrong = sum(found[each] for each in found if is_wrong(trial, craft, each))
        truly = "closed" if trial.closed else "no"
        if not trial.closed and truly_fits(trial.scene, trial.corners, *craft):
            truly = "fits"
        counts = (str(found[verdict]) for verdict in range(len(VERDICTS)))
        yield trial.name, noise, f"{craft[0]:g} x {craft[1]:g}", truly, *counts, str(wrong)


@click.command()
@click.option("--seeds", type=click.IntRange(min=1), default=20, show_default=True)
@click.option("--first", type=click.IntRange(min=0), default=0, show_default=True)
@click.option("--only", default="", metavar="WORDS", help="Trials whose names hold these words.")
@click.option("--noise", "noises", multiple=True, type=click.Choice(list(NOISES)))
def main(seeds: int, first: int, only: str, noises: tuple[str, ...]) -> None:
    """Print the table."""
    chosen = range(first, first + seeds)
    told = (
        row
        for trial in trials()
        if only in trial.name
        for noise in noises or NOISES
        for row in rows(trial, noise, chosen)
    )
    for line in lines(HEAD, told):
        click.echo(line)


if __name__ == "__main__":
    main()
