"""Speed beside what a user would pick instead: ``python -m benchmarks.run`` (half a minute).

In every row the two ways take turns, and the figures are medians; a level is a ratio, or a rate
of this program. The machine's own limits come first. CPU time can be asked for where others use
the machine, too: ``--cpu``.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from functools import partial
from statistics import median
from typing import NamedTuple

import click
import numpy as np

from benchmarks.meshes import plain
from mlscli.config import load
from mlscli.keyframes import Points
from mlscli.pipeline.grouping import group
from mlscli.pipeline.median import Median
from mlscli.pipeline.stage import MapStage
from mlscli.typing import Float64

CELL, GAP, RADIUS, NEAREST, LEAST = 0.15, 0.45, 0.45, 16, 8
REPEATS = 3
MEDIAN = Median(RADIUS, NEAREST, LEAST)
Work = Callable[[], object]


class Row(NamedTuple):
    """What was measured: a rate (millions a second), another's, and the level to reach."""

    what: str
    rate: float
    other: float | None = None
    times: float | None = None
    least: float | None = None

    def cells(self) -> tuple[str, ...]:
        """Return the row's cells, the last of which says whether its levels are reached."""
        ratio = None if self.other is None else self.rate / self.other
        missed = (self.times is not None and (ratio or 0.0) < self.times) or (
            self.least is not None and self.rate < self.least
        )
        levels = [] if self.times is None else [f"{self.times:g} times"]
        levels += [] if self.least is None else [f"{self.least:g} M/s"]
        return (
            self.what,
            f"{self.rate:.2f}",
            "" if self.other is None else f"{self.other:.2f}",
            "" if ratio is None else f"{ratio:.2f}",
            ", ".join(levels),
            "" if not levels else "MISSED" if missed else "reached",
        )


def cloud(size: int, density: float) -> Points:
    """Return points of hills, a third of them on a level above, a tenth outliers."""
    rng = np.random.default_rng(1)
    xy = rng.uniform(0, np.sqrt(size / density) * CELL, (size, 2))
    z = 3 * np.sin(xy[:, 0] / 7) * np.cos(xy[:, 1] / 9) + rng.normal(0, CELL / 3, size)
    z += np.where(rng.random(size) < 0.3, 2.5, 0.0)
    z += np.where(rng.random(size) < 0.1, rng.normal(0, 5 * CELL / 3, size), 0.0)
    return Points(np.column_stack((xy, z)), np.zeros(size, dtype=np.int32))


def rates(size: int, clock: Callable[[], float], *works: Work) -> list[float]:
    """Return how many millions a second each work does, taking turns after a turn unmeasured."""
    taken: list[list[float]] = [[] for _ in works]
    for turn in range(REPEATS + 1):
        for work, times in zip(works, taken, strict=True):
            begin = clock()
            work()
            if turn:
                times.append(clock() - begin)
    return [size / median(times) / 1e6 for times in taken]


def tree_median(xyz: Float64) -> Float64:
    """Return median heights by cKDTree and numpy; the points come by cell."""
    from scipy.spatial import cKDTree

    distances, near = cKDTree(xyz).query(
        xyz, NEAREST + 1, distance_upper_bound=np.nextafter(RADIUS, np.inf), workers=2
    )
    heights = np.sort(np.append(xyz[:, 2], np.inf)[near], axis=1)
    found = np.isfinite(distances).sum(axis=1)
    return np.asarray(heights[np.arange(len(xyz)), found // 2][found > LEAST])


def packed_groups(xyz: Float64) -> tuple[Float64, Float64, Float64]:
    """Return top, mean and variance of patches by numpy's argsort of a packed key."""
    cells, z = np.floor(xyz[:, :2] / CELL).astype(np.int64), xyz[:, 2]
    cells -= cells.min(axis=0)
    rough = ((z - z.min()) * ((2**20 - 1) / np.ptp(z))).astype(np.int64)
    keys = cells[:, 0] << 42 | cells[:, 1] << 20 | rough
    order = np.argsort(keys)
    keys, z = keys[order] >> 20, z[order]
    start = np.flatnonzero(np.r_[True, (keys[1:] != keys[:-1]) | (np.diff(z) > GAP)])
    count = np.diff(np.append(start, len(z)))
    mean = z[start] + np.add.reduceat(z - z[start].repeat(count), start) / count
    variance = np.add.reduceat((z - mean.repeat(count)) ** 2, start) / count
    return z[start + count - 1], mean, variance


def rows(clock: Callable[[], float]) -> Iterator[Row]:
    """Yield all rows."""
    rng, size = np.random.default_rng(1), 4_000_000
    keys = rng.integers(0, 2**63, 1_000_000)
    (copied,) = rates(8 * size, clock, np.ones(size).copy)
    yield Row("machine: memory copy (bytes)", copied)
    (sorted_keys,) = rates(len(keys), clock, partial(np.sort, keys))
    yield Row("machine: numpy's sort of int64", sorted_keys)
    for size, density in ((10**5, 4.0), (10**6, 4.0), (10**5, 200.0)):
        points = cloud(size, density)
        cells = np.floor(points.xyz[:, :2] / CELL)
        by_cell = points.xyz[np.lexsort(cells.T)]
        ours, tree = rates(
            size, clock, partial(MEDIAN.apply, points, CELL), partial(tree_median, by_cell)
        )
        level = 2.2 if density < 100 else None
        yield Row(f"median, {size:,} points, {density:g} a cell: cKDTree", ours, tree, level)
    for density in (1.5, 4.0, 40.0):
        points = cloud(10**6, density)
        ours, other = rates(
            points.size,
            clock,
            partial(group, points, CELL, GAP, CELL),
            partial(packed_groups, points.xyz),
        )
        what = f"patches of {points.size:,} points, {density:g} a cell: numpy's packed key"
        yield Row(what, ours, other, 3.0, 25.0)
    surface = plain(500)
    for each in load(None, [f"map.cell_size={CELL}"]).pipeline:
        if isinstance(each, MapStage):
            (rate,) = rates(surface.size, clock, partial(each.transform, surface))
            yield Row(f"{each.name}, {surface.size:,} patches", rate, least=30.0)


@click.command()
@click.option("--cpu", is_flag=True, help="Measure CPU time, of all threads, not wall time.")
def main(cpu: bool) -> None:
    """Print the table."""
    click.echo("| what: what instead | M/s | instead | times | level | |")
    click.echo("|:--|--:|--:|--:|--:|:--|")
    for row in rows(time.process_time if cpu else time.perf_counter):
        click.echo(f"| {' | '.join(row.cells())} |")


if __name__ == "__main__":
    main()
