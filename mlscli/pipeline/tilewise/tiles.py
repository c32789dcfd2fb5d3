"""The map evaluated tile by tile: by several workers, or where memory cannot hold all points.

A tile is evaluated from its points and those in a margin around it, as wide as the reach of all
stages together. Each stage uses up its own reach of the margin, and the patches of the tile are
those of one pass over all points. So neither the size of the tiles nor who evaluates them changes a
bit of the map.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import NamedTuple, Protocol

import numpy as np

from mlscli.keyframes.batches import Points
from mlscli.maps.cells import Limits, pack
from mlscli.maps.change import points_in
from mlscli.maps.columns import new_columns
from mlscli.maps.grid import Grid
from mlscli.maps.surface_map import SurfaceMap
from mlscli.pipeline.line_counts import LineCounts
from mlscli.pipeline.pipeline import Pipeline, Progress
from mlscli.pipeline.report import Report
from mlscli.pipeline.stages.ordering import cells_of
from mlscli.pipeline.tilewise.blocks import Occupied, PointBlocks
from mlscli.runtime.arrays import Bool, Int32
from mlscli.runtime.threads import in_turn


class EvaluatedTile(NamedTuple):
    """A tile of the map, and the report of how it was made.

    Attributes
    ----------
    surface : SurfaceMap
        The patches of the tile, before the final stages.
    report : Report
        What was dropped in it, and where the time went.
    filtered : Points or None
        Its points as the stages on points left them, where free space was asked for.
    """

    surface: SurfaceMap
    report: Report
    filtered: Points | None = None


class Tile(NamedTuple):
    """A rectangle of cells, without a limit at the rim of the map.

    Attributes
    ----------
    limits : Limits
        The cells of the tile.
    points : int
        Number of points in all blocks of the tile and its margin.
    """

    limits: Limits
    points: int


class Workers(Protocol):
    """What evaluates tiles: threads, or a cluster."""

    @property
    def number(self) -> int:
        """How many tiles are evaluated at a time."""

    @property
    def memory_per_point(self) -> int:
        """Bytes of memory that this machine needs for each point of the largest tile, at most."""

    def evaluate_all(
        self, pipeline: Pipeline, blocks: PointBlocks, tiles: Sequence[Tile]
    ) -> Iterator[EvaluatedTile]:
        """Evaluate tiles, and yield the results in their order."""


class Keeps(Protocol):
    """What keeps the tiles of a build: a checkpoint."""

    def tiles(self, divide: Callable[[], list[Tile]]) -> list[Tile]:
        """Return the tiles of the build, as they were before, or else as `divide` has them."""

    def kept(self, workers: Workers) -> Workers:
        """Return workers that evaluate what is not kept yet, and keep it."""


# Tiles of fewer points are mostly margin; larger tiles than comfortable save hardly any margin.
WORTHWHILE_POINTS, COMFORTABLE_POINTS = 50_000, 10**6

# Bytes of memory that evaluating a point takes, at most.
EVALUATED = 400


class Threads(NamedTuple):
    """Threads of this process."""

    number: int

    @property
    def memory_per_point(self) -> int:
        """Bytes of memory that this machine needs for each point of the largest tile, at most."""
        return EVALUATED * self.number

    def evaluate_all(
        self, pipeline: Pipeline, blocks: PointBlocks, tiles: Sequence[Tile]
    ) -> Iterator[EvaluatedTile]:
        """Evaluate tiles, and yield the results in their order."""

        def call(limits: Limits) -> EvaluatedTile:
            return evaluate(pipeline, points_around(pipeline, blocks, limits), limits)

        return in_turn((partial(call, tile.limits) for tile in tiles), self.number)


def map_in_tiles(
    pipeline: Pipeline,
    points: Points,
    workers: Workers,
    progress: Progress | None = None,
    counts: LineCounts | None = None,
    checkpoint: Keeps | None = None,
) -> SurfaceMap:
    """Return the map of all points before the final stages, evaluated by several workers.

    Parameters
    ----------
    pipeline : Pipeline
    points : Points
    workers : Workers
    progress, counts
        As for `evaluate_tiles`.
    checkpoint : Keeps, optional
        Keeps the tiles.
    """
    blocks = PointBlocks(pipeline.cell_size)
    blocks.add(points)
    share = points.size // (2 * workers.number)
    most = max(WORTHWHILE_POINTS, min(share, COMFORTABLE_POINTS))
    divided = partial(tiles_of, blocks, pipeline.reach, most)
    tiles = divided() if checkpoint is None else checkpoint.tiles(divided)
    workers = workers if checkpoint is None else checkpoint.kept(workers)
    parts = evaluate_tiles(pipeline, blocks, tiles, workers, progress, counts)
    return join(pipeline.grid, list(parts))


def evaluate_tiles(
    pipeline: Pipeline,
    blocks: PointBlocks,
    tiles: Sequence[Tile],
    workers: Workers,
    progress: Progress | None = None,
    counts: LineCounts | None = None,
) -> Iterator[SurfaceMap]:
    """Yield the map of all points before the final stages, tile by tile.

    Parameters
    ----------
    pipeline : Pipeline
        Its report receives what became of the points of each tile.
    blocks : PointBlocks
    tiles : sequence of Tile
        From `tiles_of`.
    workers : Workers
    progress : callable, optional
        Called with ``tiles``, how many of them are done, and how many there are.
    counts : LineCounts, optional
        Counts the sight lines of the points, from `Pipeline.line_counts`.
    """
    evaluated = workers.evaluate_all(pipeline, blocks, tiles)
    for number, (surface, report, filtered) in enumerate(evaluated, 1):
        if filtered is not None:
            pipeline.count_lines(counts, filtered)
        if progress is not None:
            progress("tiles", number, len(tiles))
        pipeline.report.add(report)
        yield surface


def join(grid: Grid, parts: Sequence[SurfaceMap]) -> SurfaceMap:
    """Return the map of parts that share no cell."""
    columns = {
        name: np.concatenate([column, *(part.columns[name] for part in parts)])
        for name, column in new_columns(0).items()
    }
    # The patches of each cell are in order already: only the cells have to be sorted.
    order = np.argsort(pack(columns["ix"], columns["iy"]), kind="stable")
    return SurfaceMap.of(grid, columns).take(order)


def points_around(pipeline: Pipeline, blocks: PointBlocks, limits: Limits) -> Points:
    """Return the points that can change the map within limits."""
    return blocks.extract(limits.widened(pipeline.reach))


def evaluate(pipeline: Pipeline, points: Points, limits: Limits) -> EvaluatedTile:
    """Return the map within limits, before the final stages, and what became of the points there.

    Parameters
    ----------
    pipeline : Pipeline
    points : Points
        From `points_around`.
    limits : Limits
        The cells of the tile.
    """
    report = Report()
    pipeline, cell_size = pipeline.reporting_to(report), pipeline.cell_size
    margin = pipeline.reach
    inside = _count(limits, *cells_of(points.xyz, cell_size))
    for filtering in pipeline.point_stages:
        margin -= filtering.reach(cell_size)
        points = pipeline.run_point_stage(filtering, points)
        cells = cells_of(points.xyz, cell_size)
        points = points.take(limits.widened(margin).contain(*cells))
        before, inside = inside, _count(limits, *cells)
        report.drop(filtering.name, before - inside)
    surface, sights = pipeline.group_points(points), pipeline.sights(lambda _: points)
    margin -= pipeline.sight_reach
    for stage in pipeline.map_stages:
        margin -= stage.reach(cell_size) or 0
        after = pipeline.run_stage(stage, surface, sights=sights)
        surface = after.crop(*limits.widened(margin))
        before, inside = inside, points_in(surface.crop(*limits))
        report.drop(stage.name, before - inside)
    own = None
    if pipeline.parameters.map.free_space:
        own = points.take(limits.contain(*cells_of(points.xyz, cell_size)))
    return EvaluatedTile(surface.crop(*limits), report, own)


def tiles_of(blocks: PointBlocks, reach: int, most: int) -> list[Tile]:
    """Divide the plane into tiles, each with at least one block that holds points.

    Parameters
    ----------
    blocks : PointBlocks
    reach : int
        Width of the margins, in cells.
    most : int
        A tile of more points, those of its margin counted, is divided if points lie in more than
        one of its blocks.
    """
    margin = -(-reach >> blocks.shift)
    undivided = [(Limits(), blocks.occupied())]
    tiles = []
    while undivided:
        limits, near = undivided.pop()
        near = _take(near, limits.widened(margin).contain(near.ix, near.iy))
        own = _take(near, limits.contain(near.ix, near.iy))
        points = int(near.points.sum())
        if points <= most or len(own.ix) <= 1:
            tiles.append(Tile(_in_cells(limits, blocks.shift), points))
        else:
            undivided += [(half, near) for half in reversed(_halves(limits, own))]
    return tiles


def _halves(limits: Limits, own: Occupied) -> list[Limits]:
    """Divide a tile across its longer side, so that both parts have about half of the points."""
    spans = np.ptp(own.ix.astype(np.int64)), np.ptp(own.iy.astype(np.int64))
    axis = "x" if spans[0] >= spans[1] else "y"
    at = own.ix if axis == "x" else own.iy
    order = np.argsort(at, kind="stable")
    below = np.cumsum(own.points[order])
    middle = int(at[order][np.searchsorted(below, below[-1] / 2)])
    first = max(middle, int(at.min()) + 1)
    return [
        limits._replace(**{f"max_{axis}": first - 1}),
        limits._replace(**{f"min_{axis}": first}),
    ]


def _take(blocks: Occupied, which: Bool) -> Occupied:
    return Occupied(blocks.ix[which], blocks.iy[which], blocks.points[which])


def _in_cells(blocks: Limits, shift: int) -> Limits:
    """Return the limits of blocks as limits of cells."""
    low = [None if end is None else end << shift for end in (blocks.min_x, blocks.min_y)]
    high = [
        None if end is None else ((end + 1) << shift) - 1 for end in (blocks.max_x, blocks.max_y)
    ]
    return Limits(low[0], high[0], low[1], high[1])


def _count(limits: Limits, ix: Int32, iy: Int32) -> int:
    return int(np.count_nonzero(limits.contain(ix, iy)))
