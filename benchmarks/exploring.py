"""What a flight to the views of `mls explore` settles: ``python -m benchmarks.exploring``.

Each scene is flown once, survey and legs, and mapped with free space. Then it is flown again: along
the views that are told for this map; and, for comparison, along the first route from its beginning,
as far as the way along the views is long. Both have keyframes as far apart as the first flight,
those between views looking straight down, and find their points with new errors; each is mapped
together with the first. Uncertain cells are counted in all three maps. Edges are left out: beyond
those of a scene there is nothing to see. It takes some minutes.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import click
import numpy as np

from benchmarks.clearances import NOISES, SPACING, map_of
from benchmarks.table import lines
from mlscli.keyframes.keyframe import Keyframe
from mlscli.maps.surface_map import SurfaceMap
from mlscli.queries.exploration import Camera
from mlscli.queries.explore import explore
from mlscli.queries.uncertain import EDGE, KINDS, uncertain
from mlscli.runtime.arrays import Int64
from mlscli.scenes.flight import Craft, fly
from mlscli.scenes.presets import SCENE_PRESETS, make
from mlscli.scenes.route import STEP, CameraPoses, fly_route

WIDTH, HEIGHT = 0.4, 0.3
INNER = KINDS[:EDGE]
HEAD = (
    *("scene", "views", "way"),
    *(f"{kind} {when}" for kind in INNER for when in ("before", "again", "explored")),
)


def with_steps(way: CameraPoses, begin: tuple[float, float, float], step: float) -> CameraPoses:
    """Return a way with poses between, at most a step apart, that look straight down."""
    position, yaw, tilt = [], [], []
    before = np.array(begin)
    for place, turn, up in zip(way.position, way.yaw, way.tilt, strict=True):
        leg = place - before
        count = math.ceil(float(np.linalg.norm(leg)) / step)
        for share in (np.arange(1, count) / max(count, 1)).tolist():
            position.append(before + share * leg)
            yaw.append(math.atan2(leg[1], leg[0]))
            tilt.append(0.0)
        position.append(place)
        yaw.append(turn)
        tilt.append(up)
        before = place
    return CameraPoses(np.array(position), np.array(yaw), np.array(tilt))


def as_far_as(route: CameraPoses, length: float) -> CameraPoses:
    """Return the poses of a route up to a length, and from its beginning again if it is shorter."""
    step = np.linalg.norm(np.diff(route.position, axis=0), axis=1)
    along = np.concatenate(([0.0], np.cumsum(step)))
    rows = np.flatnonzero(along <= length % along[-1])
    rows = np.concatenate((np.tile(np.arange(len(along)), int(length // along[-1])), rows))
    return CameraPoses(route.position[rows], route.yaw[rows], route.tilt[rows])


def counted(surface: SurfaceMap, camera: Camera) -> Int64:
    """Return how many cells are uncertain, of each kind but edges."""
    kind = uncertain(surface, camera.reach / 2).kind
    return np.bincount(kind, minlength=len(KINDS))[:EDGE]


def row(name: str, seeds: range, views: int) -> Iterator[Any]:
    """Yield the cells of a row, sums over seeds."""
    scene = make(name)
    craft = Craft()
    route = fly_route(scene, craft.above(scene))
    chosen, length = 0, 0.0
    cells = np.zeros((len(INNER), 3), dtype=np.int64)
    for seed in seeds:

        def flown(way: CameraPoses, seed: int) -> list[Keyframe]:
            noise = NOISES["sigma 0.05, salt and pepper"]
            return fly(scene, SPACING, noise, craft, seed=seed, route=way).keyframes

        first = flown(route, seed)
        before = map_of(first)
        found = explore(before, WIDTH, HEIGHT, most=views)
        position, yaw, tilt = found.way()
        to_views = CameraPoses(position, np.radians(yaw), np.radians(tilt))
        to_views = with_steps(to_views, found.begin, STEP * craft.above(scene))
        again = flown(as_far_as(route, found.length), 1000 + seed)
        explored = flown(to_views, 1000 + seed)
        for n, each in enumerate((before, map_of(first + again), map_of(first + explored))):
            cells[:, n] += counted(each, found.camera)
        chosen, length = chosen + len(found.views), length + found.length
    yield from (name, f"{chosen / len(seeds):.1f}", f"{length / len(seeds):.0f}")
    yield from (f"{count:,}" for count in cells.ravel().tolist())


@click.command()
@click.option("--seeds", type=click.IntRange(min=1), default=3, show_default=True)
@click.option("--views", type=click.IntRange(min=1), default=8, show_default=True)
@click.option("--only", default="", metavar="WORDS", help="Scenes whose names hold these words.")
def main(seeds: int, views: int, only: str) -> None:
    """Print the table."""
    names = [preset.name for preset in SCENE_PRESETS if only in preset.name]
    told = (tuple(row(name, range(seeds), views)) for name in names)
    for line in lines(HEAD, told):
        click.echo(line)


if __name__ == "__main__":
    main()
