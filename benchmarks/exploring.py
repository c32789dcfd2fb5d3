"""What a flight to the views of `mls explore` settles: ``python -m benchmarks.exploring``.

Each scene is flown once, survey and legs, and mapped with free space. Then it is flown again: along
the views that are told for this map; and, for comparison, along the first route from its beginning,
as far as the way along the views is long. Both have keyframes as far apart as the first flight,
those between views looking straight down, and find their points with new errors; each is mapped
together with the first. Holes and unseen space are counted in all three maps. Edges are left out:
beyond those of a scene there is nothing to see.

Of artificial patches those of the first map's regions are followed: a further flight finds walls
and floors that nobody knew of, with gaps of their own. To see are those where the scene has a
surface with texture; the others close the scene's edges, white floors, and true holes that have
nothing beneath. They are settled where the later map has no artificial patch, or lines passed
through it. It takes some minutes.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import click
import numpy as np

from benchmarks.clearances import CELL, NOISES, SPACING, map_of
from benchmarks.table import lines
from mlscli.keyframes.keyframe import Keyframe
from mlscli.maps.cells import pack
from mlscli.maps.surface_map import ARTIFICIAL, SurfaceMap
from mlscli.queries.exploration import Camera
from mlscli.queries.explore import explore
from mlscli.queries.sights import refuted
from mlscli.queries.uncertain import HOLE, KINDS, RED, UNSEEN, uncertain
from mlscli.runtime.arrays import Bool, Float64, Int64, UInt64, repeated
from mlscli.scenes.flight import Craft, fly
from mlscli.scenes.presets import SCENE_PRESETS, make
from mlscli.scenes.route import STEP, CameraPoses, fly_route
from mlscli.scenes.sampling import sample
from mlscli.scenes.surfaces import Scene

WIDTH, HEIGHT = 0.4, 0.3
COUNTED = (HOLE, UNSEEN)
WHEN = ("before", "again", "explored")
HEAD = (
    *("scene", "views", "way", "artificial", *(f"to see {when}" for when in WHEN)),
    *(f"{KINDS[kind]} {when}" for kind in COUNTED for when in WHEN),
    *(f"all artificial {when}" for when in WHEN),
)
FINE = 0.05


class Levels(NamedTuple):
    """Levels of cells.

    Attributes
    ----------
    key : uint64 (N,)
        Packed keys of the cells.
    low, high : float64 (N,)
    """

    key: UInt64
    low: Float64
    high: Float64

    def met_by(self, others: Levels) -> Bool:
        """Return which of these have another in their cell, within a cell of height, bool (N,)."""
        order = np.argsort(others.key, kind="stable")
        key, low, high = (column[order] for column in others)
        begin, end = (np.searchsorted(key, self.key, side) for side in ("left", "right"))
        own, step = repeated(end - begin)
        other = begin[own] + step
        near = (low[other] <= self.high[own] + CELL) & (high[other] >= self.low[own] - CELL)
        met: Bool = np.bincount(own, near, len(self.key)) > 0
        return met


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


def artificial(surface: SurfaceMap, camera: Camera) -> Levels:
    """Return the artificial patches of a map that are uncertain, those of regions."""
    found = uncertain(surface, camera.reach / 2)
    red = found.kind == RED
    return Levels(found.key[red], found.low[red], found.high[red])


def counted(surface: SurfaceMap, camera: Camera) -> Int64:
    """Return how many cells are uncertain, int64 (3,): of each of `COUNTED`, and artificial."""
    kind = uncertain(surface, camera.reach / 2).kind
    return np.bincount(kind, minlength=len(KINDS))[[*COUNTED, RED]]


def to_see(levels: Levels, scene: Scene) -> Bool:
    """Return where a surface with texture is, within a cell of height, bool (N,)."""
    samples = sample(scene, FINE)
    xyz = samples.xyz[samples.texture > 0]
    cells = np.floor(xyz[:, :2] / CELL).astype(np.int32)
    return levels.met_by(Levels(pack(*cells.T), xyz[:, 2], xyz[:, 2]))


def still(levels: Levels, surface: SurfaceMap) -> Bool:
    """Return where a map has an artificial patch that no lines refute, bool (N,)."""
    red = surface.take((surface.origin == ARTIFICIAL) & ~refuted(surface, 2))
    return levels.met_by(Levels(pack(red.ix, red.iy), red.low_end, red.height))


def row(name: str, seeds: range, views: int) -> Iterator[Any]:
    """Yield the cells of a row, sums over seeds."""
    scene = make(name)
    craft = Craft()
    route = fly_route(scene, craft.above(scene))
    chosen, length, red = 0, 0.0, 0
    left, cells = np.zeros(3, dtype=np.int64), np.zeros((3, 3), dtype=np.int64)
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
        old = artificial(before, found.camera)
        seen = to_see(old, scene)
        for n, each in enumerate((before, map_of(first + again), map_of(first + explored))):
            left[n] += np.count_nonzero(still(old, each) & seen)
            cells[:, n] += counted(each, found.camera)
        chosen, length, red = chosen + len(found.views), length + found.length, red + len(seen)
    yield from (name, f"{chosen / len(seeds):.1f}", f"{length / len(seeds):.0f}", f"{red:,}")
    yield from (f"{count:,}" for count in (*left.tolist(), *cells.ravel().tolist()))


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
