"""Maps of clouds that are larger than memory.

The keyframes are read once, and their points sorted into blocks of cells on disk, as many at a
time as memory holds. Then the map is evaluated tile by tile, and the tiles are stored on disk, too.
Finally they are joined in the file's order, band by band.
"""

from __future__ import annotations

import ctypes
import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from mlscli.building.batching import BatchGatherer
from mlscli.building.build import emptied, feed
from mlscli.building.builder import check_workers, free_space, growing_map, map_meta
from mlscli.building.depth_noise import DepthNoise, told
from mlscli.building.gap_size import AskedPoints, roughness_within, with_gap_size
from mlscli.building.identity import identity
from mlscli.errors import InputError, UsageError
from mlscli.keyframes.keyframe import Keyframe
from mlscli.maps.change import points_in
from mlscli.maps.free_space import FreeSpace
from mlscli.maps.grid import Grid
from mlscli.maps.patches import runs
from mlscli.maps.records import records_of, surface_of
from mlscli.maps.stored_map import StoredMap
from mlscli.maps.surface_map import SurfaceMap
from mlscli.pipeline.line_counts import NoRoomError
from mlscli.pipeline.parameters import AUTO, Parameters
from mlscli.pipeline.pipeline import Pipeline, Progress
from mlscli.pipeline.report import Report
from mlscli.pipeline.tilewise.blocks import PointBlocks
from mlscli.pipeline.tilewise.checkpoint import Checkpoint
from mlscli.pipeline.tilewise.connection import connected, refuse_local
from mlscli.pipeline.tilewise.tiles import (
    COMFORTABLE_POINTS,
    Threads,
    Tile,
    Workers,
    evaluate_tiles,
    join,
    tiles_of,
)
from mlscli.runtime.arrays import Array, Int32, Int64
from mlscli.runtime.scratch import Scratch, Stored
from mlscli.runtime.threads import processors

if TYPE_CHECKING:
    from mlscli.io.reading.recording import Recording

# Bytes of memory, at most, for sorting a point, for knowing where the points of a block lie, for
# putting a patch in order, and for running the final stages on a patch.
SORTED, INDEXED, ORDERED, FINISHED = 200, 100, 400, 1000

# What threads, kernels and numpy take besides what is counted.
UNCOUNTED = 40 * 2**20

# So many points are sorted at a time, even where memory is left for fewer.
LEAST_SORTED = 20_000

# Free space may take one of so many parts of what the points leave.
FREE_SHARE = 3

# The least bytes of memory to work with, besides those of the program itself.
LEAST_BYTES = 32 * 2**20


class LargeBuild(NamedTuple):
    """A map on disk and the report of how it was made.

    Attributes
    ----------
    surface : StoredMap
    report : Report
        What became of the points, and where the time went.
    """

    surface: StoredMap
    report: Report


@contextmanager
def build_large(
    recording: Recording,
    parameters: Parameters,
    memory: int,
    *,
    scratch: str | os.PathLike[str] | None = None,
    jobs: int | None = None,
    scheduler: str | None = None,
    progress: Progress | None = None,
    checkpoint: Checkpoint | None = None,
) -> Iterator[LargeBuild]:
    """Build the map of a recording within limited memory; the map lasts as long as the context.

    Parameters
    ----------
    recording : Recording
    parameters : Parameters
        With a number for `cell_size`, in the consistent mode.
    memory : int
        Bytes that the program may take in all: those it has taken before, and those of the
        messages being read, count.
    scratch : path, optional
        The folder for what does not fit; by default the system's for temporary files.
    jobs : int, optional
        Number of threads; by default one for each processor.
    scheduler : str, optional
        Evaluate the tiles on the Dask cluster whose scheduler has this address; the memory of its
        workers is not counted.
    progress, checkpoint : optional
        As for `build`.

    Yields
    ------
    LargeBuild

    Raises
    ------
    UsageError
        Where an argument does not go with limited memory, or the memory is too little.
    OutputError
        Where there is no room for temporary files.
    MlsError
        As for `build`.
    """
    refuse_local(scheduler)
    if parameters.map.cell_size == AUTO:
        raise UsageError(
            "`memory`: needs a number for map.cell_size; auto looks at the whole recording at once"
        )
    if parameters.mode == "sequential":
        raise UsageError(
            "`memory`: a sequential map is made batch by batch, in memory; set mode=consistent"
        )
    # That sources lie in different places shows before the work.
    _ = recording.georeference
    check_workers(parameters, {"jobs": jobs, "scheduler": scheduler}, "")
    with ExitStack() as stack:
        workers: Workers = Threads(jobs or processors())
        if scheduler is not None:
            workers = stack.enter_context(connected(scheduler))
        disk = stack.enter_context(Scratch(scratch))
        if checkpoint is not None:
            checkpoint.begin(identity(recording, parameters))
        builder = _LargeMapBuilder(
            recording, parameters, memory, disk, workers, progress, checkpoint
        )
        sights = parameters.map.free_space
        feed(builder, recording, progress, follows_sights=sights, checkpoint=checkpoint)
        surface = builder.finish()
        if not surface.size:
            raise InputError(emptied(recording, builder.report))
        yield LargeBuild(surface, builder.report)


class _LargeMapBuilder:
    """Gathers keyframes into batches, and keeps their points and the map on disk.

    Parameters
    ----------
    recording : Recording
    parameters : Parameters
    memory : int
        Bytes that the program may take in all.
    disk : Scratch
        Receives the points and the map.
    workers : Workers
        Evaluate the tiles.
    progress, checkpoint : optional
        As for `build`.
    """

    def __init__(
        self,
        recording: Recording,
        parameters: Parameters,
        memory: int,
        disk: Scratch,
        workers: Workers,
        progress: Progress | None = None,
        checkpoint: Checkpoint | None = None,
    ) -> None:
        self.report = Report()
        self._recording = recording
        self._parameters = parameters
        self._memory = memory
        self._disk = disk
        self._workers = workers
        self._progress = progress
        self._checkpoint = checkpoint
        # Points are stored before the gap size and the noise are known.
        self._pipeline = Pipeline(parameters, recording.frame_id, self.report)
        self._asked = AskedPoints(self._pipeline.cell_size) if parameters.lacks_sizes else None
        self._gatherer = BatchGatherer(
            parameters.batch.min_points, self._pipeline.cell_size, self.report
        )
        self._blocks = PointBlocks(self._pipeline.cell_size, disk.put)
        self._noise = DepthNoise()
        self._held = 0
        # The room for points is what the program itself, with its kernels loaded, leaves.
        growing_map(self._pipeline)
        give_back()
        self._room = memory - resident()
        if self._room < LEAST_BYTES:
            raise too_little(memory, memory - self._room + LEAST_BYTES)

    def add(self, keyframe: Keyframe) -> None:
        """Take a keyframe; batches are stored on disk once they fill half of the memory left."""
        if self._parameters.lacks_noise:
            self._noise.add(keyframe)
        if self._gatherer.add(keyframe):
            self._process_waiting()

    def finish(self) -> StoredMap:
        """Process the keyframes that wait, and return the map of all points."""
        if self._gatherer.has_waiting:
            self._process_waiting()
        self._put_away()
        self._settle()
        pipeline = self._pipeline
        pipeline.route = self._gatherer.route
        parts, free = self._evaluated(pipeline)
        bands = _bands(parts, pipeline.grid, self._room // 2 // ORDERED)
        if pipeline.final_stages:
            bands = iter([self._finished(parts, bands)])
        surface = StoredMap(pipeline.grid, [])
        kept = 0
        with self.report.timed("writing"):
            for band in bands:
                surface.put(band, self._disk)
                kept += points_in(band)
        meta = map_meta(
            self._parameters, self.report, self._recording.sources, self._recording.options,
            self._recording.map_from_recording, self._gatherer.keyframes, kept,
            self._recording.georeference,
        )  # fmt: skip
        return replace(surface, route=self._gatherer.route.copy(), meta=meta, free=free)

    def _settle(self) -> None:
        """Find what is ``auto`` from all points, now that they are stored."""
        parameters, cell_size = self._parameters, self._pipeline.cell_size
        if parameters.lacks_noise:
            parameters = parameters.with_noise(told(self._noise.value, self.report))
        if self._asked is not None:
            with self.report.timed("sizes"):
                rough = roughness_within(self._asked, cell_size, self._blocks.around)
            parameters, why = with_gap_size(parameters, cell_size, rough)
            self.report.sizes["gap_size"] = why
        self._pipeline = Pipeline(parameters, self._pipeline.grid.frame_id, self.report)
        self._parameters = self._pipeline.parameters

    def _evaluated(self, pipeline: Pipeline) -> tuple[list[_PatchesByX], FreeSpace | None]:
        """Evaluate all tiles; return their patches on disk, and free space if it is asked for."""
        most = self._left // FREE_SHARE if self._parameters.map.free_space else 0
        # What free space may take is no room for anything else.
        self._room -= most
        counts = pipeline.line_counts(most)
        workers = self._workers
        if self._checkpoint is not None:
            workers = self._checkpoint.kept(workers)
        tiles = evaluate_tiles(
            pipeline, self._blocks, self._tiles(), workers, self._progress, counts
        )
        try:
            parts = [_PatchesByX.of(surface, self._disk) for surface in tiles]
            return parts, free_space(counts, self.report)
        except NoRoomError as error:
            least = self._memory + FREE_SHARE * (error.least - most)
            raise too_little(self._memory, least, "so much space was seen through") from error

    def _process_waiting(self) -> None:
        self._held += self._gatherer.close()
        if self._held * SORTED > self._left // 2:
            self._put_away()

    def _put_away(self) -> None:
        """Store the points of all batches on disk."""
        self._held = 0
        points = self._gatherer.take_points()
        # A keyframe can be far larger than what memory is left for sorting.
        most = max(self._left // 2 // SORTED, LEAST_SORTED)
        for begin in range(0, points.size, most):
            some = points.take(slice(begin, begin + most))
            if self._asked is not None:
                with self.report.timed("sizes"):
                    self._asked.add(some.xyz)
            with self.report.timed("sorting"):
                self._blocks.add(some)
        del points
        if self._left < LEAST_BYTES:
            least = self._memory - self._left + LEAST_BYTES
            what = f"the points lie in {self._blocks.entries:,} blocks, which have to be listed"
            raise too_little(self._memory, least, what)

    @property
    def _left(self) -> int:
        """Bytes of room left besides the lists of where points lie."""
        return self._room - self._blocks.entries * INDEXED

    def _tiles(self) -> list[Tile]:
        """Divide the plane into tiles that fit into memory."""
        most = self._left // self._workers.memory_per_point

        def divided() -> list[Tile]:
            return tiles_of(self._blocks, self._pipeline.reach, min(most, COMFORTABLE_POINTS))

        tiles = divided() if self._checkpoint is None else self._checkpoint.tiles(divided)
        crowd = max(tile.points for tile in tiles)
        if crowd > most:
            least = self._memory - self._left + crowd * self._workers.memory_per_point
            what = (
                f"{2**self._blocks.shift} cells square and their surroundings hold {crowd:,} points"
            )
            raise too_little(self._memory, least, what)
        return tiles

    def _finished(self, parts: list[_PatchesByX], bands: Iterator[SurfaceMap]) -> SurfaceMap:
        """Run the final stages, which need the whole map, if it fits into memory."""
        pipeline = self._pipeline
        patches = sum(int(part.start[-1]) for part in parts)
        if patches * FINISHED > self._room:
            least = self._memory - self._room + patches * FINISHED
            what = f"{pipeline.final_stages[0].name} needs the whole map, {patches:,} patches"
            raise too_little(self._memory, least, what)
        return pipeline.run_final_stages(join(pipeline.grid, list(bands)), self._progress)


class _PatchesByX(NamedTuple):
    """The patches of a tile on disk.

    Attributes
    ----------
    ix : int32 (C,)
        The indices ix of the patches, ascending, each once.
    start : int64 (C + 1,)
        The patches at ``ix[c]`` are ``patches[start[c]:start[c + 1]]``.
    patches : Stored
        Records (see `mlscli.maps.records`), in the file's order.
    """

    ix: Int32
    start: Int64
    patches: Stored

    @classmethod
    def of(cls, surface: SurfaceMap, disk: Scratch) -> _PatchesByX:
        start = runs(surface.ix)
        return cls(surface.ix[start[:-1]], start, disk.put(records_of(surface)))

    def between(self, first: int, last: int) -> Array:
        """Return the patches with first <= ix < last."""
        begin, end = (int(self.start[at]) for at in np.searchsorted(self.ix, (first, last)))
        return self.patches[begin:end]


def _bands(parts: list[_PatchesByX], grid: Grid, most: int) -> Iterator[SurfaceMap]:
    """Yield the map in the file's order, in bands of whole columns with about `most` patches."""
    ix, places = np.unique(np.concatenate([part.ix for part in parts]), return_inverse=True)
    sizes = np.zeros(len(ix), dtype=np.int64)
    np.add.at(sizes, places, np.concatenate([np.diff(part.start) for part in parts]))
    band = np.cumsum(sizes) // max(most, 1)
    for first, last in pairwise([*ix[runs(band)[:-1]].tolist(), 2**31]):
        records = [part.between(first, last) for part in parts]
        yield join(grid, [surface_of(part, grid) for part in records if len(part)])


def too_little(memory: int, least: int, why: str = "") -> UsageError:
    """Return the error that `memory` bytes are too few, as it takes `least`; and why."""
    needed = -(-least // 2**20)
    because = f": {why}" if why else ""
    return UsageError(
        f"`memory`: {memory // 2**20}M is too little{because}; give at least {needed}M"
    )


def give_back() -> None:
    """Give memory that is free within the program back to the system, where glibc can do so."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)


def resident() -> int:
    """Return how many bytes the program takes, with what nobody counts; a guess without /proc."""
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
    except OSError:
        return 300 * 2**20
    return pages * os.sysconf("SC_PAGE_SIZE") + UNCOUNTED
