"""From a recording to its map: keyframes are read and given to a builder."""

from __future__ import annotations

import math
import os
from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator
from types import NoneType
from typing import NamedTuple, Protocol

import numpy as np

from mlscli.building.builder import Follower, MapBuilder, check_workers
from mlscli.building.depth_noise import auto_noise, told
from mlscli.building.identity import identity
from mlscli.building.sizes import fit_sizes
from mlscli.errors import InputError, expect
from mlscli.io.reading.recording import Recording, open_recording
from mlscli.keyframes.kept import KeptPoints, PointKeeper
from mlscli.keyframes.keyframe import Keyframe
from mlscli.maps.surface_map import SurfaceMap
from mlscli.pipeline.parameters import Parameters
from mlscli.pipeline.pipeline import Progress
from mlscli.pipeline.report import Report
from mlscli.pipeline.tilewise.checkpoint import Checkpoint
from mlscli.pipeline.tilewise.cluster import Cluster
from mlscli.pipeline.tilewise.connection import connected
from mlscli.runtime.arrays import Array
from mlscli.runtime.notices import notice
from mlscli.words import some


class Build(NamedTuple):
    """A map and the report of how it was made.

    Attributes
    ----------
    surface : SurfaceMap
        The map, with its route and meta.
    report : Report
        What became of the points, and where the time went.
    points : KeptPoints or None
        Its points, if they are to be kept.
    """

    surface: SurfaceMap
    report: Report
    points: KeptPoints | None = None


def build(
    source: Recording | str | os.PathLike[str] | Array,
    parameters: Parameters | None = None,
    progress: Progress | None = None,
    follow: Follower | None = None,
    jobs: int | None = None,
    scheduler: str | Cluster | None = None,
    checkpoint: Checkpoint | None = None,
    *,
    keep_points: bool = False,
) -> Build:
    """Build the map of a recording.

    Parameters
    ----------
    source : Recording, path, or array (N, 3)
        From `mlscli.open_recording`, which has options; a path or points are opened without any.
    parameters : Parameters, optional
        By default ``Parameters()``.
    progress : callable, optional
        Called with what is being done, how much is done, and how much there is (None: not known).
    follow : callable, optional
        Called after every batch with the `Change` that it made, as for `MapBuilder`.
    jobs : int, optional
        Number of threads in which the map is evaluated tile by tile; the map is the same.
    scheduler : str or Cluster, optional
        Evaluate the map tile by tile on a Dask cluster: the address of its scheduler,
        ``tcp://host:port``, or ``local`` for a cluster on this machine. The map is the same.
    checkpoint : Checkpoint, optional
        Keep the tiles that were evaluated, or go on from those of an interrupted build.
    keep_points : bool
        Whether the points are returned, too, so that others can be added as if both recordings had
        been one; see `mlscli.building.onto`.

    Returns
    -------
    Build

    Raises
    ------
    TypeError
        Where `source` is none of these.
    MlsError
        Where the recording cannot be read, the parameters do not go together, or nothing is left.
    """
    parameters = Parameters() if parameters is None else parameters
    expect(parameters, Parameters, "parameters", "Parameters")
    expect(progress, (Callable, NoneType), "progress", "a function")
    expect(follow, (Callable, NoneType), "follow", "a function")
    expect(scheduler, (str, Cluster, NoneType), "scheduler", "an address, or a Cluster")
    followed = "" if follow is None else "`follow`"
    check_workers(parameters, {"jobs": jobs, "scheduler": scheduler}, followed)
    if isinstance(scheduler, str):
        # If nothing answers there, that shows before anything is read.
        with connected(scheduler) as cluster:
            return build(
                source,
                parameters,
                progress,
                follow,
                jobs,
                cluster,
                checkpoint,
                keep_points=keep_points,
            )
    recording = _opened(source)
    georeference = recording.georeference
    if checkpoint is not None:
        checkpoint.begin(identity(recording, parameters))
    reading = Report()
    held: Iterator[Keyframe] | None = None
    if parameters.lacks_sizes or parameters.lacks_noise:
        # These come from the whole recording, before the first batch.
        keyframes = deque(read(recording, reading, progress))
        parameters = settled(parameters, keyframes, reading, progress)
        for doubt in reading.doubts:
            notice(doubt)
        # Each keyframe is freed once it is taken.
        held = (keyframes.popleft() for _ in range(len(keyframes)))
    builder = MapBuilder(
        parameters,
        recording.frame_id,
        sources=recording.sources,
        reading=recording.options,
        turn=recording.map_from_recording,
        georeference=georeference,
        progress=progress,
        follow=follow,
        jobs=jobs,
        cluster=scheduler,
        checkpoint=checkpoint,
    )
    builder.report.add(reading)
    keeper = PointKeeper() if keep_points else None
    if keeper is not None:
        held = keeper.watch(read(recording, builder.report, progress) if held is None else held)
    sights = parameters.map.free_space
    feed(builder, recording, progress, held, follows_sights=sights, checkpoint=checkpoint)
    surface = builder.finish()
    if not surface.size:
        raise InputError(emptied(recording, builder.report))
    kept = None
    if keeper is not None:
        kept = keeper.kept(recording.tally.points_read, recording.tally.dropped)
    return Build(surface, builder.report, kept)


def _opened(source: Recording | str | os.PathLike[str] | Array) -> Recording:
    expected = "a recording, the path of one, or points as an array (N, 3)"
    expect(source, (Recording, str, os.PathLike, np.ndarray), "source", expected)
    return source if isinstance(source, Recording) else open_recording(source)


def settled(
    parameters: Parameters,
    keyframes: Collection[Keyframe],
    report: Report,
    progress: Progress | None = None,
) -> Parameters:
    """Return parameters with numbers for what is ``auto``, found from all keyframes.

    The report receives the time that this takes, why sizes were chosen, and what is doubtful.
    """
    if parameters.lacks_noise:
        with report.timed("noise"):
            noise = auto_noise(keyframes)
        parameters = parameters.with_noise(told(noise, report))
    if parameters.lacks_sizes:
        total = sum(len(keyframe.points) for keyframe in keyframes)
        with report.timed("sizes"):
            fitted = fit_sizes(
                keyframes,
                parameters,
                progress and (lambda done: progress("sizes", done, total)),
            )
        parameters = fitted.parameters
        report.sizes |= fitted.reasons
        report.doubts += fitted.doubts
    return parameters


class TakesKeyframes(Protocol):
    """A builder that makes a map of the keyframes it is given."""

    @property
    def report(self) -> Report:
        """What became of the points, and where the time went."""

    def add(self, keyframe: Keyframe) -> None:
        """Take a keyframe."""


def feed(
    builder: TakesKeyframes,
    recording: Recording,
    progress: Progress | None = None,
    held: Iterable[Keyframe] | None = None,
    *,
    follows_sights: bool = False,
    checkpoint: Checkpoint | None = None,
) -> None:
    """Give a builder the keyframes of a recording.

    Parameters
    ----------
    builder : TakesKeyframes
        Its report receives what the recording has read and dropped, too.
    recording : Recording
    progress : callable, optional
        As for `build`.
    held : iterable of Keyframe, optional
        The keyframes, where they have been read already.
    follows_sights : bool, optional
        Whether free space is to be kept, for which the craft's position must be known.
    checkpoint : Checkpoint, optional
        Sees the keyframes, too.

    Raises
    ------
    InputError
        Where it is not known of any keyframe.
    """
    keyframes = known = 0
    for keyframe in read(recording, builder.report, progress) if held is None else held:
        if checkpoint is not None:
            checkpoint.saw(keyframe)
        builder.add(keyframe)
        keyframes += 1
        known += math.isfinite(sum(keyframe.position))
    if follows_sights and not known:
        raise InputError(unseen(recording))
    if follows_sights and known < keyframes:
        notice(
            f"free space: where the craft was is not known of {keyframes - known:,} of "
            f"{some(keyframes, 'keyframe')}; what they saw through is not in it"
        )
    # The recording has dropped points that the builder never saw.
    builder.report.points_read = recording.tally.points_read
    builder.report.dropped.update(recording.tally.dropped)


def read(recording: Recording, report: Report, progress: Progress | None) -> Iterator[Keyframe]:
    """Yield the keyframes of a recording, and add the time to read them to the report."""
    keyframes = recording.keyframes()
    done = 0
    while True:
        with report.timed("reading"):
            keyframe = next(keyframes, None)
        if keyframe is None:
            return
        done += 1
        if progress is not None:
            progress("reading", done, recording.expected_keyframes)
        yield keyframe


def unseen(recording: Recording) -> str:
    """Return the message that says why a recording gives no free space."""
    return (
        f"{', '.join(recording.sources)}: `free_space`: where the craft was is not known of any "
        "keyframe, so that nothing is known to be seen through; leave it out, or give a recording "
        "with positions"
    )


def emptied(recording: Recording, report: Report) -> str:
    """Return the message that says why a recording gives a map without patches."""
    reasons = ", ".join(f"{count:,} ({reason})" for reason, count in report.dropped.items())
    return (
        f"{', '.join(recording.sources)}: no point is left to map: of {report.points_read:,} read, "
        f"dropped were {reasons}; look at map.cell_size and the stages' parameters"
    )


def build_map(
    source: Recording | str | os.PathLike[str] | Array,
    parameters: Parameters | None = None,
    progress: Progress | None = None,
    follow: Follower | None = None,
    jobs: int | None = None,
    scheduler: str | Cluster | None = None,
) -> SurfaceMap:
    """Build the map of a recording; as `build`, without the report.

    Parameters
    ----------
    source, parameters, progress, follow, jobs, scheduler
        As for `build`.

    Returns
    -------
    SurfaceMap

    Raises
    ------
    TypeError, MlsError
        As for `build`.

    Examples
    --------
    >>> import mlscli
    >>> import numpy as np
    >>> points = np.random.default_rng(1).uniform(0, 4, (2000, 3)) * (1, 1, 0.1)
    >>> surface = mlscli.build_map(points)
    """
    return build(source, parameters, progress, follow, jobs, scheduler).surface
