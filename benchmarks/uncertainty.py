"""How often heights lie as close to the truth as their uncertainty says.

Run it as ``python -m benchmarks.uncertainty``; it takes some minutes. Each row is a scene or a scan
with one kind of noise, mapped by the default pipeline with cells of auto. Of the measured heights
within a cell of a true one in their cell, it prints how many are off by at most one, two and three
of the standard deviations that `SurfaceMap.height_variance` gives: of normal errors 68, 95 and
99.7 %. The truth of a scan is the map of all its points, where a patch has enough of them.

With ``--spread`` it prints what the noise explains of patches that are called vertical, in the
scenes whose noise grows with the distance, mapped by the stages on points alone: for flat true
patches and for true walls, how many of those found within half a cell are vertical, if so many
times the noise is taken from the variance of their heights.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import click
import numpy as np

from benchmarks.scans import DATA, FEATURES, SCANS, drawn, flown
from benchmarks.table import lines
from mlscli.building.build import settled
from mlscli.building.builder import MapBuilder
from mlscli.keyframes.batches import Points
from mlscli.keyframes.keyframe import Keyframe
from mlscli.maps.surface_map import MEASURED, SurfaceMap
from mlscli.pipeline.grouping import group
from mlscli.pipeline.parameters import Parameters
from mlscli.pipeline.report import Report
from mlscli.pipeline.stages.stage import PointStage
from mlscli.runtime.arrays import Bool, Float64
from mlscli.scenes.flight import fly
from mlscli.scenes.noise import Noise
from mlscli.scenes.presets import make
from mlscli.scenes.surfaces import Scatter
from mlscli.scenes.truth import truth
from mlscli.scoring.kernels import nearby, nearest
from mlscli.trials.quality import GRID, SCENES

SEEDS = (4,)
# A patch of a whole scan is true with so many points.
ENOUGH = 5
NOISES = {
    "thesis": Noise(),
    "slam 0.02": Noise("slam", Scatter(0.02, 0.02)),
    "slam 0.05": Noise("slam", Scatter(0.05, 0.05)),
}
HEAD = ("what", "level heights", "1", "2", "3", "tops", "1", "2", "3", "not known")
# How many times the noise is taken from the variance.
EXPLAINED = (0, 1, 2, 3)
SPREAD_HEAD = ("flat/walls, % vertical", *(f"{times} times" for times in EXPLAINED))


class Off(NamedTuple):
    """How far heights of one kind are off.

    Attributes
    ----------
    times : float64 (N,)
        In their standard deviations.
    unknown : int
        Of how many more the standard deviation is not known.
    """

    times: Float64
    unknown: int


def off(surface: SurfaceMap, true: SurfaceMap, upright: bool) -> Off:
    """Return how far the heights of horizontal or of vertical patches are off."""
    here, there = (
        which.take(_of_kind(which, upright) & (which.origin == MEASURED))
        for which in (surface, true)
    )
    near = nearby(there.ix, there.iy, here.ix, here.iy, 0)
    found = nearest(there.height, near, here.height, here.height, surface.cell_size)
    which, at = np.flatnonzero(found >= 0), found[found >= 0]
    variance = here.height_variance[at]
    known = ~np.isnan(variance)
    error = np.abs(here.height[at] - there.height[which])[known]
    with np.errstate(divide="ignore", invalid="ignore"):
        times = np.where(error > 0, error / np.sqrt(variance[known]), 0.0)
    return Off(times, int(np.count_nonzero(~known)))


def _of_kind(surface: SurfaceMap, upright: bool) -> Bool:
    return surface.depth > 0 if upright else surface.depth == 0


def mapped(keyframes: Sequence[Keyframe], by_points: bool = False) -> SurfaceMap:
    """Return the map of keyframes by the default pipeline, or by its stages on points alone."""
    parameters = settled(Parameters(), keyframes, Report())
    if by_points:
        stages = [stage for stage in parameters.pipeline if isinstance(stage, PointStage)]
        parameters = replace(parameters, pipeline=tuple(stages))
    builder = MapBuilder(parameters)
    for keyframe in keyframes:
        builder.add(keyframe)
    return builder.finish()


def spread_rows(seeds: Sequence[int]) -> Iterator[tuple[str, ...]]:
    """Yield for each scene and noise how many patches are vertical, by what is explained."""
    for name in list(NOISES)[1:]:
        for scene in SCENES:
            shares: dict[bool, list[Bool]] = {False: [], True: []}
            for seed in seeds:
                flight = fly(make(scene), GRID, NOISES[name], seed=seed)
                surface = mapped(flight.keyframes, by_points=True)
                lengths = surface.cell_size, surface.gap_size, surface.thickness
                true = truth(make(scene), *lengths)
                for upright, found in shares.items():
                    there = true.take(_of_kind(true, upright))
                    found.append(_are_vertical(there, surface))
            cells = [
                "/".join(
                    f"{100 * np.mean(each):.1f}" if each.size else "-"
                    for each in (np.concatenate(found, axis=1)[row] for found in shares.values())
                )
                for row in range(len(EXPLAINED))
            ]
            yield (f"{scene}, {name}", *cells)


def _are_vertical(there: SurfaceMap, surface: SurfaceMap) -> Bool:
    """Return which of the patches nearest to true ones are vertical, (len(EXPLAINED), N)."""
    near = nearby(there.ix, there.iy, surface.ix, surface.iy, 0)
    half = surface.cell_size / 2
    at = nearest(there.height, near, surface.low_end, surface.height, half)
    found = surface.take(at[at >= 0])
    left = found.variance - np.outer(EXPLAINED, np.nan_to_num(found.noise))
    spread = np.minimum(found.top - found.bottom, np.sqrt(12 * np.maximum(left, 0)))
    vertical: Bool = spread > surface.thickness
    return vertical


def of_scan(scan: Float64, surface: SurfaceMap) -> SurfaceMap:
    """Return the truth of a scan on the grid of a map."""
    true = group(Points.of(scan, np.zeros(len(scan), dtype=np.int32)), surface.grid)
    return true.take(true.count >= ENOUGH)


def pairs(data: Path, seeds: Sequence[int]) -> Iterator[tuple[str, SurfaceMap, SurfaceMap]]:
    """Yield what was mapped, the map, and the truth; those of the same name follow one another."""
    for name, noise in NOISES.items():
        for scene in SCENES:
            for seed in seeds:
                surface = mapped(fly(make(scene), GRID, noise, seed=seed).keyframes)
                lengths = surface.cell_size, surface.gap_size, surface.thickness
                yield f"scenes, {name}", surface, truth(make(scene), *lengths)
    for name in SCANS if data.is_dir() else ():
        scan = SCANS[name].points(data)
        for size in SCANS[name].sizes:
            for seed in seeds:
                surface = mapped(drawn(scan, size, seed).keyframes)
                yield f"{name}, {size:,} drawn", surface, of_scan(scan, surface)
        flights = [flown(scan, FEATURES[0], seed) for seed in seeds]
        for way, samples in zip(("flown", "slam"), zip(*flights, strict=True), strict=True):
            for sample in samples:
                surface = mapped(sample.keyframes)
                yield f"{name}, {way}", surface, of_scan(scan, surface)


def rows(
    found: Iterator[tuple[str, SurfaceMap, SurfaceMap]],
) -> Iterator[tuple[str, ...]]:
    """Yield the rows of the table, one for each name."""
    by_name: dict[str, list[tuple[Off, Off]]] = {}
    for what, surface, true in found:
        if what not in by_name:
            yield from (_row(name, each) for name, each in by_name.items())
            by_name.clear()
        by_name.setdefault(what, []).append((off(surface, true, False), off(surface, true, True)))
    yield from (_row(name, each) for name, each in by_name.items())


def _row(what: str, found: Sequence[tuple[Off, Off]]) -> tuple[str, ...]:
    cells = [what]
    for kind in zip(*found, strict=True):
        times = np.concatenate([each.times for each in kind])
        cells.append(f"{len(times):,}")
        cells += [f"{100 * np.mean(times <= n):.1f}" if len(times) else "-" for n in (1, 2, 3)]
    return (*cells, str(sum(each.unknown for both in found for each in both)))


@click.command()
@click.argument("data", type=click.Path(path_type=Path), default=DATA)
@click.option("--seed", "seeds", multiple=True, type=int, default=SEEDS, show_default=True)
@click.option("--spread", is_flag=True, help="What the noise explains of vertical patches.")
def main(data: Path, seeds: tuple[int, ...], spread: bool) -> None:
    """Print the table; without the folder of scans that of scenes alone."""
    table = (SPREAD_HEAD, spread_rows(seeds)) if spread else (HEAD, rows(pairs(data, seeds)))
    for line in lines(*table):
        click.echo(line)


if __name__ == "__main__":
    main()
