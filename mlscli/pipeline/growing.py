"""Maps that grow batch by batch, in the two modes.

What a batch costs depends on the points in and around it, not on the size of the map.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Protocol

import numpy as np

from mlscli.keyframes.batches import Points
from mlscli.maps.cells import CellSet
from mlscli.maps.change import Change
from mlscli.maps.kept_map import KeptMap
from mlscli.maps.kept_rows import KeptRows
from mlscli.maps.merging import with_measured
from mlscli.maps.records import points_of, records_in, records_of, rows_in, surface_of
from mlscli.maps.rows import part, with_part
from mlscli.maps.surface_map import SurfaceMap
from mlscli.pipeline.filtering import FilteredPoints, kept
from mlscli.pipeline.line_counts import LineCounts
from mlscli.pipeline.pipeline import Pipeline
from mlscli.pipeline.stages.sights import Sights
from mlscli.runtime.arrays import UInt64


class GrowingMap(Protocol):
    """A map that takes points batch by batch."""

    def grow(self, points: Points) -> Change:
        """Take the points of a batch and return what that changes."""
        ...

    def whole(self) -> SurfaceMap:
        """Return the map so far."""
        ...

    def line_counts(self) -> LineCounts | None:
        """Return through what space sight lines passed so far; None where nobody asked for it."""
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
        self._maps = [KeptMap(pipeline.grid) for _ in (None, *pipeline.map_stages)]
        # For each map stage, the cells in which it asked what was seen through.
        self._asked = [AskedCells() for _ in pipeline.map_stages]
        self._reaches = reaches(pipeline)
        self._sight_reaches = [each.sight_reach(pipeline.cell_size) for each in pipeline.map_stages]

    def grow(self, points: Points) -> Change:
        """Take the points of a batch and return what that changes."""
        pipeline = self._pipeline
        change, filtered = self._measure(points)
        near = partial(self._points[-1].kept_near, cell_size=pipeline.cell_size)
        for stage, reach, sight, source, target, asked in zip(
            pipeline.map_stages, self._reaches, self._sight_reaches,
            self._maps, self._maps[1:], self._asked, strict=False,
        ):  # fmt: skip
            cells = change.cells
            sights = Sights(pipeline.route, near) if sight else None
            if sights is not None and sights.known:
                cells = asked.joined_with(cells, filtered.widened(sight))
            cells = cells.widened(reach)
            if sights is not None:
                sights.cells = cells
            after = pipeline.run_stage(stage, source.extract(cells.widened(reach)), sights=sights)
            if sights is not None:
                # Also while no position is known: one may be later.
                asked.replace(cells, sights.asked)
            came = change.points
            change = target.replace(cells, after)
            pipeline.report.drop(stage.name, came - change.points)
        return change

    def whole(self) -> SurfaceMap:
        """Return the map so far."""
        return self._maps[-1].whole()

    def line_counts(self) -> LineCounts | None:
        """Return through what space sight lines passed so far, counted anew."""
        counts = self._pipeline.line_counts()
        if counts is not None:
            self._pipeline.count_lines(counts, self._points[-1].kept())
        return counts

    def _measure(self, new: Points) -> tuple[Change, CellSet]:
        """Filter the points around new ones again, and group them.

        Returns
        -------
        change : Change
            Of the measured patches.
        cells : CellSet
            All cells in which filtered points can differ from before.
        """
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
        return change, outcome.cells


def reaches(pipeline: Pipeline) -> list[int]:
    """Return the reach of each map stage, all of them bounded, in cells."""
    return [stage.reach(pipeline.cell_size) or 0 for stage in pipeline.map_stages]


class AskedCells:
    """The cells in which a stage asked what was seen through, when it last ran there.

    What is seen elsewhere changes nothing.
    """

    def __init__(self) -> None:
        self._cells = KeptRows(1)

    def joined_with(self, cells: CellSet, seen: CellSet) -> CellSet:
        """Return the cells of a listed set, and those of `seen` in which the stage asked."""
        asked = self._cells.extract(seen)[:, 0]
        return CellSet.of_keys(np.concatenate((cells.keys, asked)))

    def replace(self, cells: CellSet, asked: Sequence[UInt64]) -> None:
        """Note where the stage asked when it ran in `cells`, as it did on their rim, too."""
        self._cells.put(cells, np.empty((0, 1), dtype=np.uint64))
        if asked:
            listed = CellSet.of_keys(np.concatenate(asked))
            self._cells.put(listed, listed.keys[:, None].copy())


class SequentialMap:
    """The map that the thesis makes (section 4.1): each batch is filtered alone, and added.

    Each stage reads the map as the stage before left it, and replaces the cells within its reach of
    the new patches. Of sight lines, those of the batch count.

    Parameters
    ----------
    pipeline : Pipeline
    start : SurfaceMap, optional
        The map to go on from, on the grid of the pipeline.
    """

    def __init__(self, pipeline: Pipeline, start: SurfaceMap | None = None) -> None:
        self._pipeline = pipeline
        self._map = KeptMap(pipeline.grid)
        if start is not None and start.size:
            self._map.replace(CellSet.of(start.ix, start.iy), start)
        self._counts = pipeline.line_counts()
        self._reaches = reaches(pipeline)

    def grow(self, points: Points) -> Change:
        """Take the points of a batch and return what that changes."""
        pipeline, kept = self._pipeline, self._map
        filtered = pipeline.filter_points(points)
        pipeline.count_lines(self._counts, filtered)
        sights = pipeline.sights(lambda _: filtered)
        new = records_of(pipeline.group_points(filtered))
        changed = CellSet.of_keys(new["cell"])
        farthest = max(self._reaches, default=0)
        # All that any stage reads; it goes back into the map when the last one is done.
        rows = rows_in(kept.records(changed.widened(2 * farthest)))
        with pipeline.report.timed("merge"):
            there = records_in(part(rows, changed))
            rows = with_part(rows, changed, rows_in(with_measured(there, new, pipeline.grid)))
        for stage, reach in zip(pipeline.map_stages, self._reaches, strict=True):
            cells = changed.widened(reach)
            source = surface_of(records_in(part(rows, cells.widened(reach))), pipeline.grid)
            after = pipeline.run_stage(stage, source, sights=sights)
            if after is not source:
                before, rows = rows, with_part(rows, cells, rows_in(records_of(after)))
                pipeline.report.drop(stage.name, points_of(before) - points_of(rows))
        return kept.replace(changed.widened(farthest), records_in(rows))

    def whole(self) -> SurfaceMap:
        """Return the map so far."""
        return self._map.whole()

    def line_counts(self) -> LineCounts | None:
        """Return through what space the sight lines of all batches passed."""
        return self._counts
