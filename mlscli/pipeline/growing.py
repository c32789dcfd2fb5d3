"""Maps that grow by batches, in the two modes; a batch costs what its surroundings cost."""

from __future__ import annotations

from typing import Protocol

from mlscli.cells import CellSet
from mlscli.keyframes import Points
from mlscli.merging import add_measured
from mlscli.pipeline.change import Change, difference, points_in
from mlscli.pipeline.pipeline import Pipeline
from mlscli.pipeline.tiles import TiledMap, TiledPoints, cells_of
from mlscli.surface_map import SurfaceMap


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

    It keeps the points, and the map after each stage. Where points come, each stage runs again in
    the cells within its reach of what changed in its input, fed with all within its reach of
    those. What comes out as it was before changes nothing in the stages after.
    """

    def __init__(self, pipeline: Pipeline) -> None:
        self._pipeline = pipeline
        # What each point stage reads; without any, what is grouped.
        self._points = [TiledPoints(pipeline.cell_size) for _ in pipeline.point_stages or (None,)]
        # What was measured, and what each map stage makes of it.
        self._maps = [TiledMap(pipeline.empty) for _ in (None, *pipeline.map_stages)]

    def grow(self, points: Points) -> Change:
        """Take the points of a batch and return what that changes."""
        change = self._measure(points)
        pipeline = self._pipeline
        for stage, source, target in zip(
            pipeline.map_stages, self._maps, self._maps[1:], strict=False
        ):
            reach = stage.reach(pipeline.cell_size) or 0
            cells = change.cells.widened(reach)
            after = pipeline.transformed(stage, source.extract(cells.widened(reach)))
            came = change.points
            change = _replaced(target, cells, after.in_cells(cells))
            pipeline.report.drop(stage.name, came - change.points)
        return change

    def whole(self) -> SurfaceMap:
        """Return the map so far."""
        return self._maps[-1].whole()

    def _measure(self, new: Points) -> Change:
        """Filter the points around new ones again, and group them."""
        pipeline, cell_size = self._pipeline, self._pipeline.cell_size
        cells = CellSet.of(*cells_of(new, cell_size))
        self._points[0].add(new)
        points = self._points[0].extract(cells)
        came = [new.size]
        later = [*self._points[1:], None]
        for stage, source, target in zip(pipeline.point_stages, self._points, later, strict=False):
            reach = stage.reach(cell_size)
            cells = cells.widened(reach)
            points = pipeline.filtered(stage, source.extract(cells.widened(reach)))
            points = _in_cells(points, cells, cell_size)
            if target is not None:
                came.append(points.size - target.extract(cells).size)
                target.replace(cells, points)
        change = _replaced(self._maps[0], cells, pipeline.grouped(points))
        came.append(change.points)
        for stage, before, after in zip(pipeline.point_stages, came, came[1:], strict=False):
            pipeline.report.drop(stage.name, before - after)
        return change


class SequentialMap:
    """The map that the thesis makes (section 4.1): each batch filtered alone, and added.

    The stages read the map as the batch before left it, and replace what lies within their reach
    of the new patches.
    """

    def __init__(self, pipeline: Pipeline) -> None:
        self._pipeline = pipeline
        self._tiles = TiledMap(pipeline.empty)

    def grow(self, points: Points) -> Change:
        """Take the points of a batch and return what that changes."""
        pipeline = self._pipeline
        new = pipeline.measured(points)
        changed = CellSet.of(new.ix, new.iy)
        reaches = [stage.reach(pipeline.cell_size) or 0 for stage in pipeline.map_stages]
        widest = changed.widened(max(reaches, default=0))
        before = self._tiles.extract(widest.widened(widest.reach))
        with pipeline.report.timed("merge"):
            surface = before.replace(changed, add_measured(before.in_cells(changed), new))
        for stage, reach in zip(pipeline.map_stages, reaches, strict=True):
            cells = changed.widened(reach)
            given = surface.in_cells(cells.widened(reach))
            after = pipeline.transformed(stage, given).in_cells(cells)
            pipeline.report.drop(stage.name, points_in(given.in_cells(cells)) - points_in(after))
            surface = surface.replace(cells, after)
        return _replaced(self._tiles, widest, surface.in_cells(widest))

    def whole(self) -> SurfaceMap:
        """Return the map so far."""
        return self._tiles.whole()


def _in_cells(points: Points, cells: CellSet, cell_size: float) -> Points:
    inside = cells.contains(*cells_of(points, cell_size))
    return Points(points.xyz[inside], points.keyframe[inside])


def _replaced(tiles: TiledMap, cells: CellSet, new: SurfaceMap) -> Change:
    """Replace the patches in `cells` by new ones, and return what that changes."""
    change = difference(tiles.extract(cells), new)
    tiles.replace(change.cells, new.in_cells(change.cells))
    return change
