"""From keyframes to a map: batches, the two modes, and an account of every point.

A consistent map is the same whether it is brought up to date after every batch or once at the end.
A sequential map (thesis, section 4.1, steps 1 to 7) depends on its batches.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from types import NoneType
from typing import Any

import numpy as np

from mlscli.building.batching import BatchGatherer
from mlscli.errors import UsageError, expect, expect_items
from mlscli.keyframes.batches import Points, gather
from mlscli.keyframes.keyframe import Keyframe, require_points
from mlscli.maps.cells import CellSet
from mlscli.maps.change import Change, points_in
from mlscli.maps.free_space import FreeSpace
from mlscli.maps.georeference import GEOREFERENCE, Georeference
from mlscli.maps.recorded import TURN
from mlscli.maps.surface_map import SurfaceMap
from mlscli.pipeline.growing import ConsistentMap, GrowingMap, SequentialMap
from mlscli.pipeline.line_counts import LONGEST, LineCounts
from mlscli.pipeline.parameters import Parameters, to_dict
from mlscli.pipeline.pipeline import Pipeline, Progress
from mlscli.pipeline.report import Report
from mlscli.pipeline.tilewise.checkpoint import Checkpoint
from mlscli.pipeline.tilewise.cluster import Cluster
from mlscli.pipeline.tilewise.tiles import Threads, Workers, map_in_tiles
from mlscli.runtime.arrays import Float64
from mlscli.runtime.notices import notice
from mlscli.version import __version__
from mlscli.words import are, some

Follower = Callable[[Change], None]


class MapBuilder:
    """A map that grows with the keyframes it is given.

    In the consistent mode it is brought up to date only when needed: after every batch if `follow`
    is given, in `process_cloud`, when `surface` is read, and at the end. The map does not depend
    on when.

    Parameters
    ----------
    parameters : Parameters
        With a number for `cell_size`. A map that grows cannot know what will come: a `gap_size` of
        ``auto`` becomes the vehicle's height; `mlscli.fit_sizes` finds one for a recording.
    frame_id : str
        Name of the map frame.
    sources : sequence of str
        The sources, for the map's meta.
    reading : mapping, optional
        The options with which they were read, for the map's meta.
    turn : float64 (4, 4), optional
        The turn by which points as recorded came into the map frame, for the map's meta.
    georeference : Georeference, optional
        Where the frame of the recording lies on Earth, for the map's meta.
    start : SurfaceMap, optional
        In the sequential mode, the map to go on from: its route and free space come first.
    progress : callable, optional
        As for `build`.
    follow : callable, optional
        Called after every batch with the `Change` that it made: patches removed, patches added,
        and the rows that the route gained; before the first, with `start`. What the final stages
        change is not reported.
    jobs : int, optional
        Number of threads in which `finish` evaluates the map tile by tile, if in one pass.
    cluster : Cluster, optional
        Evaluate the tiles on this cluster instead.
    checkpoint : Checkpoint, optional
        Keeps the tiles, where the map is evaluated tile by tile.

    Attributes
    ----------
    parameters : Parameters
    report : Report
        What became of the points so far, and where the time went.

    Raises
    ------
    UsageError
        Where `cell_size` is ``auto``, or `jobs` or `cluster` would have nothing to do.
    ConfigError
        Where a value is out of range, or two contradict each other.

    Examples
    --------
    >>> import mlscli
    >>> builder = mlscli.MapBuilder(mlscli.Parameters().with_cell_size(0.2))
    >>> change = builder.process_cloud([[0.1, 0.1, 1.0], [0.1, 0.1, 1.1]])
    >>> surface = builder.finish()
    """

    def __init__(
        self,
        parameters: Parameters,
        frame_id: str = "map",
        *,
        sources: Sequence[str] = (),
        reading: Mapping[str, Any] | None = None,
        turn: Float64 | None = None,
        georeference: Georeference | None = None,
        start: SurfaceMap | None = None,
        progress: Progress | None = None,
        follow: Follower | None = None,
        jobs: int | None = None,
        cluster: Cluster | None = None,
        checkpoint: Checkpoint | None = None,
    ) -> None:
        expect(parameters, Parameters, "parameters", "Parameters")
        expect(frame_id, str, "frame_id", "a text")
        expect_items(sources, "sources", "a list of texts")
        expect(reading, (Mapping, NoneType), "reading", "a mapping of options")
        expect(turn, (np.ndarray, NoneType), "turn", "an array (4, 4)")
        expect(start, (SurfaceMap, NoneType), "start", "a map (SurfaceMap)")
        if start is not None and parameters.mode != "sequential":
            raise UsageError("`start`: a map grows on in the sequential mode; set mode=sequential")
        expect(georeference, (Georeference, NoneType), "georeference", "a Georeference")
        expect(progress, (Callable, NoneType), "progress", "a function")
        expect(follow, (Callable, NoneType), "follow", "a function")
        followed = "" if follow is None else "`follow`"
        check_workers(parameters, {"jobs": jobs, "cluster": cluster}, followed)
        expect(cluster, (Cluster, NoneType), "cluster", "a Cluster")
        expect(checkpoint, (Checkpoint, NoneType), "checkpoint", "a Checkpoint")
        self.report = Report()
        self._sources = list(sources)
        self._reading = dict(reading or {})
        self._turn = np.eye(4) if turn is None else turn
        self._georeference = georeference
        self._progress = progress
        self._follow = follow
        self._workers: Workers | None = cluster or (None if jobs is None else Threads(jobs))
        self._checkpoint = checkpoint
        self._pipeline = Pipeline(parameters, frame_id, self.report)
        self.parameters = self._pipeline.parameters
        if start is not None:
            self._pipeline.grid.require_same(start.grid)
        self._start = start
        self._gatherer = BatchGatherer(
            parameters.batch.min_points,
            self._pipeline.cell_size,
            self.report,
            None if start is None else start.route,
        )
        # Those of a map made at once; a growing map has its own.
        self._counts = self._pipeline.line_counts()
        self._growing: GrowingMap | None = None
        self._finished: SurfaceMap | None = None
        if start is not None and follow is not None:
            follow(Change.of(start.take(np.arange(0)), start, start.route))

    def add(self, keyframe: Keyframe) -> None:
        """Take a keyframe; a batch is processed once it has `batch.min_points` points.

        Points that are not finite, or higher or lower than 1e8, are dropped; a position that is not
        finite is not known.

        Raises
        ------
        UsageError
            Where the map is finished.
        """
        self._require_unfinished()
        expect(keyframe, Keyframe, "keyframe", "a Keyframe; process_cloud takes points")
        require_points(keyframe.points, "keyframe.points")
        if self._gatherer.add(keyframe):
            self._process_waiting()

    def process_cloud(self, points: Float64) -> Change:
        """Process points as one keyframe, in a batch with the keyframes that wait.

        Parameters
        ----------
        points : float64 (N, 3)
            Coordinates in the map frame. Points that are not finite, or higher or lower than 1e8,
            are dropped.

        Returns
        -------
        Change
            What has changed since the map was last brought up to date.

        Raises
        ------
        UsageError
            Where the map is finished, or points have no three coordinates.
        """
        self._require_unfinished()
        expected = "points as an array (N, 3)"
        try:
            cloud = np.asarray(points, dtype=np.float64)
        except (TypeError, ValueError):
            expect(points, np.ndarray, "points", expected)
            raise UsageError(f"`points`: found what is not numbers; expected {expected}") from None
        if cloud.size and (cloud.ndim != 2 or cloud.shape[1] != 3):
            raise UsageError(f"`points`: found an array of shape {cloud.shape}; expected (N, 3)")
        # A copy: the caller may go on to use the array.
        self._gatherer.add(Keyframe(cloud.reshape(-1, 3).copy()))
        self._gatherer.close()
        return self._grow()

    @property
    def surface(self) -> SurfaceMap:
        """The map of the batches so far, before the final stages; in the end the finished map.

        Keyframes that wait for a batch are not in it. Free space, if it is kept, is counted anew.
        """
        if self._finished is not None:
            return self._finished
        return self._described(self._up_to_date())

    def finish(self) -> SurfaceMap:
        """Process the keyframes that wait, run the final stages, and return the map.

        No points can be added afterwards, as the builder may not have kept those before.
        """
        if self._finished is None:
            if self._gatherer.has_waiting:
                self._process_waiting()
            surface = self._at_once() if self._growing is None else self._up_to_date()
            self._finished = self._described(
                self._pipeline.run_final_stages(surface, self._progress)
            )
        return self._finished

    def _require_unfinished(self) -> None:
        if self._finished is not None:
            raise UsageError("the map is finished and takes no more points; make a new MapBuilder")

    def _process_waiting(self) -> None:
        self._gatherer.close()
        if self._follow is not None or self.parameters.mode == "sequential":
            self._grow()

    def _grow(self) -> Change:
        """Bring the map up to date with the batches that it has not seen."""
        growing = self._growing_map()
        self._pipeline.route = self._gatherer.route
        begin = time.perf_counter()
        change = growing.grow(self._gatherer.take_points())
        slowest = self.report.slowest_batch or 0.0
        self.report.slowest_batch = max(slowest, time.perf_counter() - begin)
        change = replace(change, route=self._gatherer.take_route())
        if self._follow is not None:
            self._follow(change)
        return change

    def _at_once(self) -> SurfaceMap:
        """Return the map of all points in one pass, by the workers if there are any."""
        pipeline, progress = self._pipeline, self._progress
        pipeline.route = self._gatherer.route
        if self._workers is not None:
            points = self._gatherer.take_points()
            return map_in_tiles(
                pipeline, points, self._workers, progress, self._counts, self._checkpoint
            )
        # No variable keeps the points: they are freed as soon as they are filtered.
        filtered = pipeline.filter_points(self._gatherer.take_points(), progress)
        sights = pipeline.sights(partial(_all, filtered))
        measured = pipeline.group_points(filtered)
        pipeline.count_lines(self._counts, filtered)
        # Only sight lines need them any longer.
        del filtered
        return pipeline.run_map_stages(measured, progress, sights)

    def _up_to_date(self) -> SurfaceMap:
        if self._gatherer.has_points:
            self._grow()
        return self._growing_map().whole()

    def _growing_map(self) -> GrowingMap:
        if self._growing is None:
            self._growing = growing_map(self._pipeline, self._start)
        return self._growing

    def _described(self, surface: SurfaceMap) -> SurfaceMap:
        """Return the map with its route and meta."""
        meta = map_meta(
            self.parameters, self.report, self._sources, self._reading, self._turn,
            self._gatherer.keyframes, points_in(surface), self._georeference,
        )  # fmt: skip
        counts = self._counts if self._growing is None else self._growing.line_counts()
        free = free_space(counts, self.report)
        if self._start is not None:
            free = free and self._start.free and self._start.free.union(free)
        return replace(surface, route=self._gatherer.route.copy(), meta=meta, free=free)


def free_space(counts: LineCounts | None, report: Report) -> FreeSpace | None:
    """Return what was counted, and tell what was left out; None where nobody counted."""
    if counts is None:
        return None
    if counts.left_out:
        notice(
            f"free space: {some(counts.left_out, 'sight line')} {are(counts.left_out)} left out, "
            f"longer than {LONGEST:,} voxels or from beyond all cells; look at the route, or set "
            "map.cell_size to more"
        )
    with report.timed("free space"):
        return counts.free_space()


def _all(points: Points, cells: CellSet) -> Points:  # noqa: ARG001
    """Return all points, whatever the cells."""
    return points


def growing_map(pipeline: Pipeline, start: SurfaceMap | None = None) -> GrowingMap:
    """Return a growing map, its kernels loaded: no batch is charged with that time.

    Parameters
    ----------
    pipeline : Pipeline
    start : SurfaceMap, optional
        In the sequential mode, the map to go on from; by default it is empty.
    """
    kind = SequentialMap if pipeline.parameters.mode == "sequential" else ConsistentMap
    trial = pipeline.reporting_to(Report())
    # Two points: arrays of one have another layout, for which kernels would be compiled anew.
    kind(trial).grow(gather([Keyframe(np.zeros((2, 3)))]).points)
    return kind(pipeline) if start is None else SequentialMap(pipeline, start)


def map_meta(
    parameters: Parameters,
    report: Report,
    sources: Sequence[str],
    reading: Mapping[str, Any],
    turn: Float64,
    keyframes: int,
    kept: int,
    georeference: Georeference | None = None,
) -> dict[str, Any]:
    """Return the meta of a map, how it was made, ready for JSON.

    Parameters
    ----------
    parameters : Parameters
    report : Report
        Of the finished build.
    sources : sequence of str
    reading : mapping
        The options with which the sources were read.
    turn : float64 (4, 4)
        The turn from the frame of the recording to that of the map.
    keyframes : int
        Rows of the route.
    kept : int
        Measured points in the map.
    georeference : Georeference, optional
        Where the frame of the recording lies on Earth.
    """
    place = {} if georeference is None else {GEOREFERENCE: georeference.to_dict()}
    return {
        "program": f"mls {__version__}",
        "sources": list(sources),
        "reading": dict(reading),
        TURN: turn.tolist(),
        **place,
        "parameters": to_dict(parameters),
        "sizes": dict(report.sizes),
        "points": {
            "read": report.points_read,
            "dropped": dict(sorted(report.dropped.items())),
            "kept": kept,
        },
        "keyframes": keyframes,
        "batches": report.batches,
    }


def check_workers(parameters: Parameters, workers: Mapping[str, object], followed: str) -> None:
    """Refuse workers that would have nothing to do: others do it, or the map grows batch by batch.

    Parameters
    ----------
    parameters : Parameters
    workers : mapping of str to object
        The workers asked for, by argument; None: not asked for. Only one can do the work.
    followed : str
        The argument for which the map must grow batch by batch, in the words of the error; empty:
        there is none.

    Raises
    ------
    UsageError
        Where workers are asked for that would have nothing to do.
    """
    jobs = workers.get("jobs")
    expect(jobs, (int, NoneType), "jobs", "a whole number of at least 1")
    if isinstance(jobs, int) and jobs < 1:
        raise UsageError(f"`jobs` {jobs}: expected a whole number of at least 1")
    names = [name for name, asked_for in workers.items() if asked_for is not None]
    for name in names:
        if parameters.mode == "sequential":
            raise UsageError(
                f"`{name}`: a sequential map is made batch by batch; set mode=consistent"
            )
        if followed:
            raise UsageError(f"`{name}`: does not go with {followed}; leave one of them out")
    if len(names) > 1:
        raise UsageError(
            f"`{names[0]}`: does not go with `{names[1]}`, whose workers have threads of their "
            "own; leave one of them out"
        )
