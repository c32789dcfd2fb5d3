"""From keyframes to a map: batches, the two modes, and an account of every point.

The consistent mode evaluates the stages over all points. The sequential mode, the thesis's
(section 4.1, steps 1 to 7), feeds their results back into the map batch by batch.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from itertools import takewhile
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

import mlscli
from mlscli.cell_size import auto_cell_size
from mlscli.cells import CellSet, on_grid
from mlscli.config import Parameters, to_dict
from mlscli.errors import InputError, UsageError
from mlscli.keyframes import Batch, Keyframe, Points, gather
from mlscli.merging import add_measured
from mlscli.parameters import in_units
from mlscli.pipeline.grouping import group
from mlscli.pipeline.stage import MapStage, PointStage
from mlscli.pipeline.tiles import TiledMap
from mlscli.surface_map import SurfaceMap
from mlscli.typing import Float64

if TYPE_CHECKING:
    from mlscli.io.recording import Recording

# What is being done, how much of it is done, and how much there is (None: not known).
Progress = Callable[[str, int, int | None], None]

BEYOND_GRID = "cell index beyond int32"


@dataclass
class Report:
    """What became of the points, and where the time went.

    Attributes
    ----------
    points_read : int
        Points of the keyframes taken, before anything was dropped.
    dropped : dict
        How many of them were dropped, by reason.
    batches : int
    seconds : dict
        Wall time by what was done.
    """

    points_read: int = 0
    dropped: Counter[str] = field(default_factory=Counter)
    batches: int = 0
    seconds: Counter[str] = field(default_factory=Counter)

    def drop(self, reason: str, points: int) -> None:
        """Count dropped points under a reason."""
        if points:
            self.dropped[reason] += points


@contextmanager
def timed(seconds: Counter[str], what: str) -> Iterator[None]:
    """Add the time that a block takes to what it is spent on."""
    begin = time.perf_counter()
    try:
        yield
    finally:
        seconds[what] += time.perf_counter() - begin  # type: ignore[assignment]


class Build(NamedTuple):
    """A map and the account of how it was made."""

    surface: SurfaceMap
    report: Report


class MapBuilder:
    """A map that grows with the keyframes it is given.

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

    Raises
    ------
    UsageError
        Where `cell_size` is ``auto``.

    Examples
    --------
    >>> import mlscli
    >>> builder = mlscli.MapBuilder(mlscli.Parameters().with_cell_size(0.2))
    >>> builder.process_cloud([[0.1, 0.1, 1.0], [0.1, 0.1, 1.1]])
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
    ) -> None:
        cell_size = parameters.map.cell_size
        if isinstance(cell_size, str):
            raise UsageError(
                "map.cell_size: a growing map needs a number, not auto; "
                "see Parameters.with_cell_size"
            )
        self.parameters = parameters
        self.report = Report()
        self._sources = list(sources)
        self._reading = dict(reading or {})
        self._progress = progress
        self._cell_size = cell_size
        self._empty = replace(
            SurfaceMap.empty(
                cell_size,
                in_units(parameters.map.gap_size, cell_size),
                in_units(parameters.map.thickness, cell_size),
            ),
            frame_id=frame_id,
        )
        stages = parameters.pipeline
        self._point_stages = [stage for stage in stages if isinstance(stage, PointStage)]
        map_stages = [stage for stage in stages if isinstance(stage, MapStage)]
        bounded = takewhile(lambda stage: stage.reach(cell_size) is not None, map_stages)
        self._growing_stages = list(bounded)
        self._final_stages = map_stages[len(self._growing_stages) :]
        self._waiting: list[Keyframe] = []
        self._waiting_points = 0
        self._keyframes = 0
        self._routes: list[Float64] = [self._empty.route]
        self._batches: list[Points] = []
        self._tiles = TiledMap(self._empty)

    def add(self, keyframe: Keyframe) -> None:
        """Take a keyframe; a batch is processed once it has `batch.min_points` points."""
        self._waiting.append(keyframe)
        self._waiting_points += len(keyframe.points)
        self.report.points_read += len(keyframe.points)
        if self._waiting_points >= self.parameters.batch.min_points:
            self._process_waiting()

    def process_cloud(self, points: Float64) -> None:
        """Take points (N, 3) as one keyframe and, with those that wait, as a batch."""
        cloud = np.asarray(points, dtype=np.float64).reshape(-1, 3) + 0.0
        finite = np.isfinite(cloud).all(axis=1)
        self.report.points_read += int(np.count_nonzero(~finite))
        self.report.drop("not finite", int(np.count_nonzero(~finite)))
        self.add(Keyframe(cloud[finite]))
        self._process_waiting()

    def finish(self) -> SurfaceMap:
        """Process what waits, run the stages that need the whole map, and return the map."""
        self._process_waiting()
        if self.parameters.mode == "sequential":
            surface = self._tiles.whole()
        else:
            surface = self._in_one_pass(self._all_points())
        for stage in self._final_stages:
            surface = self._apply(stage, surface)
        surface = replace(surface, route=np.concatenate(self._routes))
        return replace(surface, meta=self._meta(surface))

    def _process_waiting(self) -> None:
        if not self._waiting:
            return
        batch = gather(self._waiting, self._keyframes)
        self._keyframes += len(self._waiting)
        self._waiting, self._waiting_points = [], 0
        self._routes.append(batch.route)
        self.report.batches += 1
        points = self._on_grid(batch)
        if self.parameters.mode == "sequential":
            self._grow(points)
        else:
            self._batches.append(points)

    def _on_grid(self, batch: Batch) -> Points:
        inside = on_grid(batch.points.xyz, self._cell_size)
        if inside.all():
            return batch.points
        self.report.drop(BEYOND_GRID, int(np.count_nonzero(~inside)))
        return Points(batch.points.xyz[inside], batch.points.keyframe[inside])

    # --- consistent: the stages over all points ---

    def _all_points(self) -> Points:
        none = gather([]).points
        columns = zip(none, *self._batches, strict=True)
        self._batches = []
        return Points(*(np.concatenate(column) for column in columns))

    def _in_one_pass(self, points: Points) -> SurfaceMap:
        surface = self._measure(points)
        for stage in self._growing_stages:
            surface = self._apply(stage, surface)
        return surface

    # --- sequential: batch by batch (thesis, section 4.1) ---

    def _grow(self, points: Points) -> None:
        new = self._measure(points)
        changed = CellSet.of(new.ix, new.iy)
        with timed(self.report.seconds, "merge"):
            self._tiles.replace(changed, add_measured(self._tiles.extract(changed), new))
        for stage in self._growing_stages:
            reach = stage.reach(self._cell_size) or 0
            targets = changed.widened(reach)
            before = self._tiles.extract(targets.widened(reach))
            with timed(self.report.seconds, stage.name):
                after = stage.apply(before).in_cells(targets)
            self._drop_by(stage, before.in_cells(targets), after)
            self._tiles.replace(targets, after)

    # --- both ---

    def _measure(self, points: Points) -> SurfaceMap:
        for stage in self._point_stages:
            with timed(self.report.seconds, stage.name):
                kept = stage.apply(points, self._cell_size, self._teller(stage.name, points.size))
            self.report.drop(stage.name, points.size - kept.size)
            points = kept
        with timed(self.report.seconds, "grouping"):
            empty = self._empty
            measured = group(points, empty.cell_size, empty.gap_size, empty.thickness)
            return replace(measured, frame_id=empty.frame_id)

    def _apply(self, stage: MapStage, surface: SurfaceMap) -> SurfaceMap:
        tell = self._teller(stage.name, surface.size)
        with timed(self.report.seconds, stage.name):
            after = stage.apply(surface)
        if tell is not None:
            tell(surface.size)
        self._drop_by(stage, surface, after)
        return after

    def _drop_by(self, stage: MapStage, before: SurfaceMap, after: SurfaceMap) -> None:
        self.report.drop(stage.name, _points_in(before) - _points_in(after))

    def _teller(self, what: str, total: int) -> Callable[[int], None] | None:
        """Return what tells of the progress in one step; batch by batch, only reading tells."""
        progress = self._progress
        if progress is None or self.parameters.mode == "sequential":
            return None
        progress(what, 0, total)
        return lambda done: progress(what, done, total)

    def _meta(self, surface: SurfaceMap) -> dict[str, Any]:
        return {
            "program": f"mls {mlscli.__version__}",
            "sources": self._sources,
            "reading": self._reading,
            "parameters": to_dict(self.parameters),
            "points": {
                "read": self.report.points_read,
                "dropped": dict(sorted(self.report.dropped.items())),
                "kept": _points_in(surface),
            },
            "keyframes": self._keyframes,
            "batches": self.report.batches,
        }


def _points_in(surface: SurfaceMap) -> int:
    return int(surface.count.sum(dtype=np.int64))


def build(
    recording: Recording, parameters: Parameters | None = None, progress: Progress | None = None
) -> Build:
    """Build the map of a recording.

    Parameters
    ----------
    recording : Recording
        From `mlscli.open_recording`.
    parameters : Parameters, optional
        The defaults where none are given.
    progress : callable, optional
        Called with what is being done, how much is done, and how much there is, or None.

    Returns
    -------
    Build
        The map, and the account of how it was made.

    Raises
    ------
    MlsError
        Where the recording cannot be read, the parameters do not go together, or nothing is left.
    """
    parameters = Parameters() if parameters is None else parameters
    seconds: Counter[str] = Counter()
    keyframes = _read(recording, seconds, progress)
    if parameters.map.cell_size == "auto":
        # The size comes from the whole recording, before the first batch.
        held = list(keyframes)
        xyz = np.concatenate([keyframe.points for keyframe in held])
        with timed(seconds, "cell size"):
            cell_size = auto_cell_size(
                xyz, progress and (lambda done: progress("cell size", done, len(xyz)))
            )
        parameters = parameters.with_cell_size(cell_size)
        keyframes = iter(held)
    builder = MapBuilder(
        parameters,
        recording.frame_id,
        sources=recording.sources,
        reading=recording.options,
        progress=progress,
    )
    for keyframe in keyframes:
        builder.add(keyframe)
    # The recording has dropped points, too, which the builder never saw.
    builder.report.points_read = recording.tally.points_read
    builder.report.dropped.update(recording.tally.dropped)
    builder.report.seconds.update(seconds)
    surface = builder.finish()
    if not surface.size:
        raise InputError(f"{', '.join(recording.sources)}: {_emptied(builder.report)}")
    return Build(surface, builder.report)


def _emptied(report: Report) -> str:
    reasons = ", ".join(f"{count:,} ({reason})" for reason, count in report.dropped.items())
    return (
        f"no point is left to map: of {report.points_read:,} read, dropped were {reasons}; look at "
        "map.cell_size and the stages' parameters"
    )


def build_map(
    recording: Recording, parameters: Parameters | None = None, progress: Progress | None = None
) -> SurfaceMap:
    """Build the map of a recording; as `build`, without the account."""
    return build(recording, parameters, progress).surface


def _read(
    recording: Recording, seconds: Counter[str], progress: Progress | None
) -> Iterator[Keyframe]:
    keyframes = recording.keyframes()
    done = 0
    while True:
        with timed(seconds, "reading"):
            keyframe = next(keyframes, None)
        if keyframe is None:
            return
        done += 1
        if progress is not None:
            progress("reading", done, recording.expected_keyframes)
        yield keyframe
