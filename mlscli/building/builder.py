"""From keyframes to a map: batches, the two modes, and an account of every point.

Whether the map is brought up to date after every batch or once in the end makes no difference to
a consistent map; a sequential one, the thesis's (section 4.1, steps 1 to 7), is made of its
batches.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from mlscli.building.batching import BatchGatherer
from mlscli.errors import UsageError, expect
from mlscli.keyframes.batches import gather
from mlscli.keyframes.keyframe import Keyframe
from mlscli.maps.change import Change, points_in
from mlscli.maps.surface_map import SurfaceMap
from mlscli.pipeline.growing import ConsistentMap, GrowingMap, SequentialMap
from mlscli.pipeline.parameters import Parameters, to_dict
from mlscli.pipeline.pipeline import Pipeline, Progress
from mlscli.pipeline.report import Report
from mlscli.pipeline.tilewise.cluster import Cluster
from mlscli.pipeline.tilewise.tiles import Threads, Workers, map_in_tiles
from mlscli.runtime.arrays import Float64
from mlscli.version import __version__

Follower = Callable[[Change], None]


class MapBuilder:
    """A map that grows with the keyframes it is given.

    In the consistent mode it is brought up to date when someone looks: after every batch where
    there is a follower, after `process_cloud`, when `surface` is read, and in the end. What it
    says does not depend on when.

    Parameters
    ----------
    parameters : Parameters
        With a number for `cell_size`: it must be settled before the first batch.
    frame_id : str
        Name of the map frame.
    sources : sequence of str
        What the map's meta names as its sources.
    reading : mapping, optional
        What it says of how they were read.
    progress : callable, optional
        As for `build`.
    follow : callable, optional
        Called after every batch with the `Change` that it made: patches removed, patches added,
        and the keyframes that the route gained.
        `finish` makes no more changes that it tells, only what the stages do that need the whole
        map.
    jobs : int, optional
        Evaluate the map in tiles, in so many threads, where it is made in one pass in the end.
    cluster : Cluster, optional
        Hand the tiles to this cluster instead.

    Raises
    ------
    UsageError
        Where `cell_size` is ``auto``; where `jobs` or `cluster` would have nothing to do; where
        points are given once the map is finished.

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
        progress: Progress | None = None,
        follow: Follower | None = None,
        jobs: int | None = None,
        cluster: Cluster | None = None,
    ) -> None:
        expect(parameters, Parameters, "parameters", "Parameters")
        followed = "" if follow is None else "`follow`"
        check_workers(parameters, {"jobs": jobs, "cluster": cluster}, followed)
        self.parameters = parameters
        self.report = Report()
        self._sources = list(sources)
        self._reading = dict(reading or {})
        self._progress = progress
        self._follow = follow
        self._workers: Workers | None = cluster or (None if jobs is None else Threads(jobs))
        self._pipeline = Pipeline(parameters, frame_id, self.report)
        self._gatherer = BatchGatherer(
            parameters.batch.min_points, self._pipeline.cell_size, self.report
        )
        self._growing: GrowingMap | None = None
        self._finished: SurfaceMap | None = None

    def add(self, keyframe: Keyframe) -> None:
        """Take a keyframe; a batch is processed once it has `batch.min_points` points."""
        self._require_unfinished()
        if self._gatherer.add(keyframe):
            self._process_waiting()

    def process_cloud(self, points: Float64) -> Change:
        """Take points (N, 3) as one keyframe and, with those that wait, as a batch.

        Returns
        -------
        Change
            What came and went since the map was last brought up to date.
        """
        cloud = np.asarray(points, dtype=np.float64).reshape(-1, 3) + 0.0
        finite = np.isfinite(cloud)
        if not finite.all():
            rows = finite.all(axis=1)
            self.report.points_read += int(np.count_nonzero(~rows))
            self.report.drop("not finite", int(np.count_nonzero(~rows)))
            cloud = cloud[rows]
        self._require_unfinished()
        self._gatherer.add(Keyframe(cloud))
        self._gatherer.close()
        return self._grow()

    @property
    def surface(self) -> SurfaceMap:
        """The map of the batches so far, without what is done only in the end.

        Keyframes that wait for more points are not in it. Once the map is finished, it is that.
        """
        if self._finished is not None:
            return self._finished
        return self._described(self._up_to_date())

    def finish(self) -> SurfaceMap:
        """Process what waits, run the stages that need the whole map, and return the map.

        It takes no more points then, for it may have let go of those that it had.
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
        begin = time.perf_counter()
        change = growing.grow(self._gatherer.take_points())
        slowest = self.report.slowest_batch or 0.0
        self.report.slowest_batch = max(slowest, time.perf_counter() - begin)
        change = replace(change, route=self._gatherer.take_route())
        if self._follow is not None:
            self._follow(change)
        return change

    def _at_once(self) -> SurfaceMap:
        """Return the map that one pass makes of all points, by those who are to make it."""
        pipeline, progress = self._pipeline, self._progress
        if self._workers is not None:
            return map_in_tiles(pipeline, self._gatherer.take_points(), self._workers, progress)
        # Nothing here keeps the points: they are let go as soon as they are filtered.
        measured = pipeline.filter_and_group(self._gatherer.take_points(), progress)
        return pipeline.run_map_stages(measured, progress)

    def _up_to_date(self) -> SurfaceMap:
        if self._gatherer.has_points:
            self._grow()
        return self._growing_map().whole()

    def _growing_map(self) -> GrowingMap:
        if self._growing is None:
            self._growing = growing_map(self._pipeline)
        return self._growing

    def _described(self, surface: SurfaceMap) -> SurfaceMap:
        """Return the map with the route, and with what its meta says of it."""
        meta = map_meta(
            self.parameters, self.report, self._sources, self._reading, self._gatherer.keyframes,
            points_in(surface),
        )  # fmt: skip
        return replace(surface, route=self._gatherer.route, meta=meta)


def growing_map(pipeline: Pipeline) -> GrowingMap:
    """Return a map that is to grow, the kernels loaded: no batch's time should be theirs."""
    kind = SequentialMap if pipeline.parameters.mode == "sequential" else ConsistentMap
    trial = pipeline.reporting_to(Report())
    # Two points: a column of one is laid out otherwise, for which kernels would be made anew.
    kind(trial).grow(gather([Keyframe(np.zeros((2, 3)))]).points)
    return kind(pipeline)


def map_meta(
    parameters: Parameters,
    report: Report,
    sources: Sequence[str],
    reading: Mapping[str, Any],
    keyframes: int,
    kept: int,
) -> dict[str, Any]:
    """Return what a map's meta says of how it was made, ready for JSON.

    Parameters
    ----------
    parameters : Parameters
    report : Report
        Of the finished build.
    sources : sequence of str
    reading : mapping
        How the sources were read.
    keyframes : int
    kept : int
        Measured points in the map.
    """
    return {
        "program": f"mls {__version__}",
        "sources": list(sources),
        "reading": dict(reading),
        "parameters": to_dict(parameters),
        "points": {
            "read": report.points_read,
            "dropped": dict(sorted(report.dropped.items())),
            "kept": kept,
        },
        "keyframes": keyframes,
        "batches": report.batches,
    }


def check_workers(parameters: Parameters, workers: Mapping[str, object], followed: str) -> None:
    """Refuse workers who would have nothing to do: others do it, or the map grows batch by batch.

    Parameters
    ----------
    parameters : Parameters
    workers : mapping
        By their arguments' names, of which only one can do the work; None: not asked for.
    followed : str
        What the user calls that for which the map grows; empty: nothing.

    Raises
    ------
    UsageError
    """
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
