"""Maps that grow batch by batch, in the two modes.

What a batch costs depends on the points in and around it, not on the size of the map.
"""

from __future__ import annotations

from typing import Protocol

from mlscli.keyframes.batches import Points
from mlscli.maps.cells import CellSet
from mlscli.maps.change import Change
from mlscli.maps.merging import with_measured
from mlscli.maps.records import records_of
from mlscli.maps.surface_map import SurfaceMap
from mlscli.maps.tiled_map import TiledMap
from mlscli.pipeline.filtering import FilteredPoints, kept
from mlscli.pipeline.pipeline import Pipeline


class GrowingMap(Protocol):
    """A map that takes points batch by batch."""

    def grow(self, points: Points) -> Change:
        """Take the points of a batch and return what that changes."""
        ...

    def whole(self) -> SurfaceMap:
        """Return the map so far."""
        ...


class ConsistentMap:
    """The map that one pass over all points so far gives, whatever batches they came in.

    It keeps the points, and the map after each stage. For each batch, a stage is evaluated again in
    the cells within its reach of a change of its input, given all input within its reach of those
    cells. Later stages are evaluated again only where its result differs from before.
    """

    def __init__(self, pipeline: Pipeline) -> None:
        self._pipeline = pipeline
        self._points = [FilteredPoints(stage) for stage in pipeline.point_stages or (None,)]
        # What was measured, and what each map stage makes of it.
        self._maps = [TiledMap(pipeline.grid) for _ in (None, *pipeline.map_stages)]

    def grow(self, points: Points) -> Change:
        """Take the points of a batch and return what that changes."""
        pipeline = self._pipeline
        change = self._measure(points)
        for stage, source, target in zip(
            pipeline.map_stages, self._maps, self._maps[1:], strict=False
        ):
            reach = stage.reach(pipeline.cell_size) or 0
            cells = change.cells.widened(reach)
            after = pipeline.run_stage(stage, source.extract(cells.widened(reach)))
            came = change.points
            change = target.replace(cells, after)
            pipeline.report.drop(stage.name, came - change.points)
        return change

    def whole(self) -> SurfaceMap:
        """Return the map so far."""
        return self._maps[-1].whole()

    def _measure(self, new: Points) -> Change:
        """Filter the points around new ones again, and group them."""
        pipeline = self._pipeline
        outcome = self._points[0].add(pipeline, new)
        came = [new.size]
        for points in self._points[1:]:
            outcome, more = points.replace(pipeline, outcome)
            came.append(more)
        change = self._maps[0].replace(outcome.cells, pipeline.group_points(kept(outcome.rows)))
        came.append(change.points)
        for stage, before, after in zip(pipeline.point_stages, came, came[1:], strict=False):
            pipeline.report.drop(stage.name, before - after)
        return change


class SequentialMap:
    """The map that the thesis makes (section 4.1): each batch is filtered alone, and added.

    Each stage reads the map as the stage before left it, and replaces the cells within its reach of
    the new patches.
    """

    def __init__(self, pipeline: Pipeline) -> None:
        self._pipeline = pipeline
        self._tiles = TiledMap(pipeline.grid)

    def grow(self, points: Points) -> Change:
        """Take the points of a batch and return what that changes."""
        pipeline, tiles = self._pipeline, self._tiles
        new = records_of(pipeline.filter_and_group(points))
        changed = CellSet.of_keys(new["cell"])
        reaches = [stage.reach(pipeline.cell_size) or 0 for stage in pipeline.map_stages]
        widest = changed.widened(max(reaches, default=0))
        before = tiles.records(widest)
        with pipeline.report.timed("merge"):
            there = tiles.records(changed) if pipeline.map_stages else before
            change = tiles.replace(changed, with_measured(there, new, pipeline.grid))
        for stage, reach in zip(pipeline.map_stages, reaches, strict=True):
            cells = changed.widened(reach)
            after = pipeline.run_stage(stage, tiles.extract(cells.widened(reach)))
            pipeline.report.drop(stage.name, -tiles.replace(cells, after).points)
        if pipeline.map_stages:
            # What one stage changes, the next may change back.
            change = Change.between(before, tiles.records(widest), pipeline.grid)
        return change

    def whole(self) -> SurfaceMap:
        """Return the map so far."""
        return self._tiles.whole()
