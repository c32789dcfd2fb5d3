"""The stages of a configuration in their order: the map as a function of the points.

Callers choose where the function is evaluated: everywhere at once (`filter_and_group`, then
`run_map_stages`), tile by tile (`tilewise`), or where a batch can change something (`growing`).
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from itertools import takewhile

import numpy as np

from mlscli.keyframes.batches import Points
from mlscli.maps.cells import CellSet
from mlscli.maps.change import points_in
from mlscli.maps.surface_map import SurfaceMap
from mlscli.pipeline.grouping import group
from mlscli.pipeline.line_counts import LineCounts
from mlscli.pipeline.parameters import Parameters
from mlscli.pipeline.report import Report
from mlscli.pipeline.stages.sights import Sights
from mlscli.pipeline.stages.stage import Evaluated, MapStage, PointStage
from mlscli.runtime.arrays import Bool

# Called with what is being done, how much of it is done, and how much there is (None: not known).
Progress = Callable[[str, int, int | None], None]


class Pipeline:
    """The stages that turn points into a map; what they drop and how long they take is reported.

    Parameters
    ----------
    parameters : Parameters
        With a number for `cell_size`; a `gap_size` of ``auto`` becomes the vehicle's height.
    frame_id : str
        Name of the map frame.
    report : Report
        Receives the points dropped, and the time spent.

    Attributes
    ----------
    parameters : Parameters
    cell_size : float
        Side of a cell, in the unit of the recording.
    report : Report
    point_stages : list of PointStage
        Those that do anything.
    map_stages : list of MapStage
        Those before the first without a bound to its reach.
    final_stages : list of MapStage
        That stage, and all after it: they need the whole map.
    grid : Grid
    route : float64 (K, 4)
        Time, x, y, z of the craft for the keyframes of all points, for stages that follow sight
        lines; whoever has the keyframes sets it. At first it is empty.

    Raises
    ------
    TypeError
        Where `parameters` are of another type.
    UsageError
        Where `cell_size` is ``auto``.
    ConfigError
        Where a value is out of range, or two contradict each other.
    """

    def __init__(self, parameters: Parameters, frame_id: str, report: Report) -> None:
        parameters = parameters.with_gap_size()
        self.grid = parameters.grid(frame_id)
        self.parameters = parameters
        self.cell_size = cell_size = self.grid.cell_size
        self.report = report
        self.route = np.empty((0, 4))
        stages = parameters.pipeline
        self.point_stages = [s for s in stages if isinstance(s, PointStage) and s.acts]
        sizes = self.grid.gap_size, cell_size
        map_stages = [stage.for_gaps(*sizes) for stage in stages if isinstance(stage, MapStage)]
        bounded = takewhile(lambda stage: stage.reach(cell_size) is not None, map_stages)
        self.map_stages = list(bounded)
        self.final_stages = map_stages[len(self.map_stages) :]

    def run_map_stages(
        self,
        surface: SurfaceMap,
        progress: Progress | None = None,
        sights: Sights | None = None,
    ) -> SurfaceMap:
        """Return what all map stages but the final ones make of measured patches."""
        for stage in self.map_stages:
            surface = self.run_and_count(stage, surface, progress, sights)
        return surface

    def run_final_stages(self, surface: SurfaceMap, progress: Progress | None = None) -> SurfaceMap:
        """Return the map after the final stages."""
        for stage in self.final_stages:
            surface = self.run_and_count(stage, surface, progress)
        return surface

    def filter_and_group(self, points: Points, progress: Progress | None = None) -> SurfaceMap:
        """Return the measured patches of points, filtered by all point stages."""
        return self.group_points(self.filter_points(points, progress))

    def filter_points(self, points: Points, progress: Progress | None = None) -> Points:
        """Return what all point stages make of points."""
        for stage in self.point_stages:
            kept = self.run_point_stage(stage, points, progress)
            self.report.drop(stage.name, points.size - kept.size)
            points = kept
        return points

    def sights(self, near: Callable[[CellSet], Points]) -> Sights | None:
        """Return the sight lines of filtered points; None where no stage follows any there are.

        Parameters
        ----------
        near : callable
            As for `Sights`.
        """
        sights = Sights(self.route, near)
        return sights if self.sight_reach and sights.known else None

    def line_counts(self, most: int | None = None) -> LineCounts | None:
        """Return what counts the lines through free space; None where nobody asked for it.

        Parameters
        ----------
        most : int, optional
            As for `LineCounts`.
        """
        return LineCounts(self.cell_size, most) if self.parameters.map.free_space else None

    def count_lines(self, counts: LineCounts | None, points: Points) -> None:
        """Count the sight lines of filtered points, if anybody counts."""
        if counts is not None:
            with self.report.timed("free space"):
                counts.add(points, self.route)

    def run_and_count(
        self,
        stage: MapStage,
        surface: SurfaceMap,
        progress: Progress | None = None,
        sights: Sights | None = None,
    ) -> SurfaceMap:
        """Return what a stage makes of a map, and count the points that it drops."""
        after = self.run_stage(stage, surface, progress, sights)
        self.report.drop(stage.name, points_in(surface) - points_in(after))
        return after

    def reporting_to(self, report: Report) -> Pipeline:
        """Return a copy of the pipeline with another report."""
        other = copy(self)
        other.report = report
        return other

    @property
    def reach(self) -> int:
        """How many cells away a point can change the map, the final stages left out."""
        reaches = [stage.reach(self.cell_size) for stage in self.point_stages]
        reaches += [stage.reach(self.cell_size) or 0 for stage in self.map_stages]
        return sum(reaches) + self.sight_reach

    @property
    def sight_reach(self) -> int:
        """How many cells away a filtered point's sight line can change what a map stage does."""
        return max((stage.sight_reach(self.cell_size) for stage in self.map_stages), default=0)

    # --- the steps, timed; callers count what is dropped, as they know in which cells ---

    def run_point_stage(
        self, stage: PointStage, points: Points, progress: Progress | None = None
    ) -> Points:
        """Return what a stage makes of points."""
        tell = _teller(stage.name, points.size, progress)
        with self.report.timed(stage.name):
            return stage.apply(points, self.cell_size, tell)

    def evaluate_points(self, stage: PointStage, points: Points, asked: Bool) -> Evaluated:
        """Return what a stage makes of the points that `asked`, bool (N,), selects."""
        with self.report.timed(stage.name):
            return stage.evaluate(points, self.cell_size, asked)

    def group_points(self, points: Points) -> SurfaceMap:
        """Return the measured patches of filtered points."""
        with self.report.timed("grouping"):
            return group(points, self.grid)

    def run_stage(
        self,
        stage: MapStage,
        surface: SurfaceMap,
        progress: Progress | None = None,
        sights: Sights | None = None,
    ) -> SurfaceMap:
        """Return what a stage makes of a map."""
        tell = _teller(stage.name, surface.size, progress)
        with self.report.timed(stage.name):
            after = stage.apply(surface, sights)
        if tell is not None:
            tell(surface.size)
        return after


def _teller(what: str, total: int, progress: Progress | None) -> Callable[[int], None] | None:
    """Return what reports how much of one step is done; None where nobody listens."""
    if progress is None:
        return None
    progress(what, 0, total)
    return lambda done: progress(what, done, total)
