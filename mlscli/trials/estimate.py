"""What a build would do, estimated from the first keyframes of a recording.

Maps of larger and larger parts of these keyframes are built, as long as that takes seconds only,
and thrown away. If the last part is the whole recording, all numbers but the time are those of the
build; otherwise they are extrapolated:

- keyframes: as many as the recording declares, or at the rate of those read;
- points and batches: in proportion to the keyframes;
- patches, and voxels of free space: by a power of the points, fitted to the last two parts: a
  flight over new ground adds patches in proportion, one over the same ground adds few;
- cell and gap size: those of the points read. Where ground is seen again later, points lie closer,
  and the cells of the build are smaller;
- time: of reading, in proportion to the keyframes; of building, by a power of the points within
  the keyframes read, and in proportion to the keyframes beyond.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from mlscli.building.build import settled, unseen
from mlscli.building.builder import Follower, MapBuilder
from mlscli.errors import InputError
from mlscli.io.reading.glance import Glance
from mlscli.io.reading.options import AUTO
from mlscli.io.reading.recording import Recording, open_recording
from mlscli.keyframes.batches import batches
from mlscli.keyframes.keyframe import Keyframe
from mlscli.maps.grid import LENGTHS
from mlscli.pipeline.parameters import Parameters
from mlscli.pipeline.report import Report

# The trial takes this many points at most, and builds maps of these shares of them in turn, until
# the next could take longer than this many seconds.
_AT_MOST = 200_000
_TRIAL_SHARES = (1 / 16, 1 / 8, 1 / 4, 1 / 2, 1)
_PATIENCE_SECONDS = 1.5


@dataclass(frozen=True)
class Estimate:
    """What a build would do; numbers are None where too little was read to estimate them.

    Attributes
    ----------
    whole : bool
        Whether the whole recording was read and mapped: then all numbers but `seconds` are exact.
    clouds : list of str
        Where the clouds are: files, and topics where there are some.
    frame_id, up : str
        The map frame, and which direction of the recording becomes z.
    keyframes : int or None
        How many keyframes there are.
    counted : bool
        Whether the keyframes were counted or declared, not estimated from their rate.
    batches, points, patches, voxels : int or None
        How many batches and points there are, and how many patches the map has; and through how
        many voxels of its free space lines of sight passed, where that is kept.
    cell_size, gap_size, thickness : float or None
        Lengths of the map, in the unit of the recording.
    sizes : dict of str to str
        Why the first two were chosen, where they were ``auto``.
    seconds : float or None
        Wall time of the build.
    read : dict
        What the estimate is based on: ``all``, whether the whole recording was read;
        ``keyframes`` and ``points``, how many were read; ``dropped``, how many of these points are
        dropped, by reason.
    notes, lost : list of str
        What the user should know, and what cannot be read.
    """

    whole: bool
    clouds: list[str]
    frame_id: str
    up: str
    keyframes: int | None
    counted: bool
    batches: int | None
    points: int | None
    patches: int | None
    voxels: int | None
    cell_size: float | None
    gap_size: float | None
    thickness: float | None
    sizes: dict[str, str]
    seconds: float | None
    read: dict[str, Any]
    notes: list[str]
    lost: list[str]


def estimate_build(
    *sources: str | os.PathLike[str],
    parameters: Parameters | None = None,
    follow: Follower | None = None,
    glance: Glance | None = None,
    **reading: Any,
) -> Estimate:
    """Estimate what `mlscli.build_map` would do, from the first keyframes; write nothing.

    Parameters
    ----------
    *sources : str or path
        As `mlscli.open_recording` takes them.
    parameters : Parameters, optional
        The defaults where none are given.
    follow : callable, optional
        As for `mlscli.build_map`; called with the changes of the trial's maps.
    glance : Glance, optional
        How much to read; by default 200,000 points, in at most 2 s.
    **reading
        The other arguments of `mlscli.open_recording`.

    Returns
    -------
    Estimate

    Raises
    ------
    MlsError
        Where the build would fail, as far as the keyframes read show it.
    """
    parameters = parameters or Parameters()
    glance = glance or Glance()
    begin = time.perf_counter()
    recording = open_recording(*sources, glance=glance, **reading)
    opened = time.perf_counter() - begin
    keyframes = list(recording.keyframes())
    passes = 2 if reading.get("up") == AUTO else 1
    spent = (time.perf_counter() - begin - opened) * passes
    tally = recording.tally
    if parameters.map.free_space and not glance.cut and not _has_positions(keyframes):
        raise InputError(unseen(recording))
    trial = _Trial(parameters, keyframes, follow) if _size(keyframes) else None
    # The last message that was read stands for the last there is.
    is_known = not glance.cut or "latest" in recording.options
    declared = tally.keyframes or None if is_known else recording.expected_keyframes
    placed = keyframes[: tally.keyframes - tally.unplaced]
    total = _by_their_rate(placed, recording.duration) if declared is None else declared
    more = total / tally.keyframes if total and tally.keyframes else None
    dropped = dict(tally.dropped)
    known: dict[str, Any] = dict.fromkeys(("batches", "points", "patches", "voxels", "seconds"))
    known |= _lengths(parameters) if trial is None else trial.lengths
    if trial is not None:
        dropped |= trial.dropped
        if more is not None:
            known |= {
                "batches": round(trial.batches * more),
                "points": round(tally.points_read * more),
                "patches": trial.patches(more),
                "voxels": trial.voxels(more),
                "seconds": opened + spent * more + trial.seconds(more),
            }
    return Estimate(
        whole=not glance.cut and (trial is None or trial.is_whole),
        clouds=recording.labels,
        frame_id=recording.frame_id,
        up=recording.up,
        keyframes=total if glance.cut else len(keyframes),
        counted=declared is not None,
        **known,
        sizes=trial.settling.sizes if trial is not None else {},
        read={
            "all": not glance.cut,
            "keyframes": tally.keyframes,
            "points": tally.points_read,
            "dropped": dropped,
        },
        notes=[
            *recording.notes,
            *(trial.settling.doubts if trial is not None else []),
            *_reservations(recording, glance),
            *_unseen_so_far(parameters, keyframes),
        ],
        lost=recording.losses,
    )


def _by_their_rate(keyframes: Sequence[Keyframe], duration: float) -> int | None:
    """Return how many keyframes there are in `duration` (s), at the rate of those given.

    None where their times or the duration are not known.
    """
    stamps = np.array([keyframe.stamp for keyframe in keyframes])
    flown = float(np.ptp(stamps)) if len(stamps) else 0.0
    if not (flown > 0 and math.isfinite(duration)):
        return None
    return max(len(stamps), round((len(stamps) - 1) * duration / flown) + 1)


def _reservations(recording: Recording, glance: Glance) -> Iterator[str]:
    """Yield notes on what might change if more were read."""
    if glance.cut and "latest" in recording.options:
        yield "`latest`: the end of the recording is not reached, an earlier message stands for it"
    if glance.poses_cut:
        yield "transforms and poses are read in part: clouds without one may get theirs when built"


def _has_positions(keyframes: Sequence[Keyframe]) -> bool:
    """Return whether it is known of a keyframe where the craft was."""
    return any(math.isfinite(sum(keyframe.position)) for keyframe in keyframes)


def _unseen_so_far(parameters: Parameters, keyframes: Sequence[Keyframe]) -> Iterator[str]:
    """Yield a note where free space is asked for and no keyframe read so far has a position."""
    if parameters.map.free_space and not _has_positions(keyframes):
        yield (
            "`free_space`: where the craft was is not known of any keyframe read so far; if it is "
            "of none, the build will fail"
        )


def _lengths(parameters: Parameters) -> dict[str, float | None]:
    """Return the lengths of the map in the unit of the recording; None where auto leaves them."""
    if parameters.map.cell_size == AUTO:
        return dict.fromkeys(LENGTHS)
    grid = parameters.grid()
    return {
        name: None if getattr(parameters.map, name) == AUTO else getattr(grid, name)
        for name in LENGTHS
    }


class _Trial:
    """Maps of larger and larger parts of the keyframes read, and what follows for the rest.

    A part is some first keyframes, or a slab of a single one.

    Parameters
    ----------
    parameters : Parameters
    keyframes : sequence of Keyframe
        The keyframes read.
    follow : callable or None
        As for `estimate_build`.

    Attributes
    ----------
    is_whole : bool
        Whether the last part was all keyframes read.
    batches : int
        How many batches these make.
    dropped : dict
        How many points the stages drop, by reason; empty unless `is_whole`.
    growth, opening : float
        The powers of the points by which patches and voxels of free space grow, from 0 to 1.
    startup : float
        The time (s) that does not grow with the points.
    lengths : dict
        ``cell_size``, ``gap_size`` and ``thickness``, in the unit of the recording.
    settling : Report
        Why sizes that were ``auto`` were chosen, and what is doubtful.
    """

    def __init__(
        self, parameters: Parameters, keyframes: Sequence[Keyframe], follow: Follower | None
    ) -> None:
        self._points = _size(keyframes)
        self.batches = sum(1 for _ in batches(keyframes, parameters.batch.min_points))
        tried = _slab(keyframes, _AT_MOST)
        begin = time.perf_counter()
        self.settling = Report()
        parameters = settled(parameters, tried, self.settling)
        sizing = (time.perf_counter() - begin) / _size(tried)
        self.lengths = _lengths(parameters)
        self.growth = self.opening = self._slowing = 1.0
        first = _part(tried, _TRIAL_SHARES[0])
        # The first build loads the kernels.
        loading = _built(parameters, first, follow).seconds
        last = _built(parameters, first, follow)
        self.startup = max(0.0, loading - last.seconds)
        for share in _TRIAL_SHARES[1:]:
            part = _part(tried, share)
            more = _size(part) / last.points
            # Where points lie densely, time can grow with their square.
            if last.seconds * more**2 > _PATIENCE_SECONDS:
                break
            if more > 1:
                built = _built(parameters, part, follow)
                self._slowing = _power(built.seconds / last.seconds, more, 1.0, 2.0)
                if len(tried) > 1 and last.patches and built.patches:
                    self.growth = _power(built.patches / last.patches, more, 0.0, 1.0)
                if len(tried) > 1 and last.voxels and built.voxels:
                    self.opening = _power(built.voxels / last.voxels, more, 0.0, 1.0)
                last = built
        self._last, self._sizing = last, sizing
        self.is_whole = last.points == self._points
        self.dropped = last.dropped if self.is_whole else {}

    def patches(self, more: float) -> int:
        """Return how many patches a map of `more` times the points read has."""
        times = more * self._points / self._last.points
        return round(self._last.patches * math.pow(times, self.growth))

    def voxels(self, more: float) -> int | None:
        """Return how many voxels of free space it has; None where that is not kept."""
        if self._last.voxels is None:
            return None
        times = more * self._points / self._last.points
        return round(self._last.voxels * math.pow(times, self.opening))

    def seconds(self, more: float) -> float:
        """Return how long (s) such a map takes to build."""
        unseen = self._points / self._last.points
        building = self._last.seconds * math.pow(unseen, self._slowing)
        return self.startup + (building + self._sizing * self._points) * more


class _Built(NamedTuple):
    """The map of a part of the keyframes, in numbers.

    Attributes
    ----------
    points : int
        Points in the part.
    patches : int
        Patches of its map.
    voxels : int or None
        Voxels of its free space; None where that is not kept.
    seconds : float
        Wall time of building it.
    dropped : dict of str to int
        How many points were dropped, by reason.
    """

    points: int
    patches: int
    voxels: int | None
    seconds: float
    dropped: dict[str, int]


def _built(
    parameters: Parameters, keyframes: Sequence[Keyframe], follow: Follower | None
) -> _Built:
    begin = time.perf_counter()
    builder = MapBuilder(parameters, follow=follow)
    for keyframe in keyframes:
        builder.add(keyframe)
    surface = builder.finish()
    seconds = time.perf_counter() - begin
    voxels = None if surface.free is None else surface.free.size
    dropped = dict(builder.report.dropped)
    return _Built(_size(keyframes), surface.size, voxels, seconds, dropped)


def _power(ratio: float, of: float, low: float, high: float) -> float:
    """Return the exponent to which `of` is raised to give `ratio`, clipped to `low` and `high`."""
    return min(high, max(low, math.log(ratio) / math.log(of)))


def _part(keyframes: Sequence[Keyframe], share: float) -> Sequence[Keyframe]:
    """Return the first keyframes with a share of the points, or a slab of a single one."""
    wanted = share * _size(keyframes)
    if len(keyframes) == 1:
        return _slab(keyframes, math.ceil(wanted))
    sizes = np.cumsum([len(keyframe.points) for keyframe in keyframes])
    return keyframes[: int(np.searchsorted(sizes, wanted)) + 1]


def _slab(keyframes: Sequence[Keyframe], most: int) -> Sequence[Keyframe]:
    """Return the keyframes with only the `most` points around the median of x, at full density."""
    size = _size(keyframes)
    if size <= most:
        return keyframes
    x = np.concatenate([keyframe.points[:, 0] for keyframe in keyframes])
    begin = (size - most) // 2
    inside = np.zeros(size, dtype=np.bool_)
    inside[np.argsort(x, kind="stable")[begin : begin + most]] = True
    ends = np.cumsum([len(keyframe.points) for keyframe in keyframes])
    return [
        Keyframe(keyframe.points[rows], keyframe.stamp, keyframe.position)
        for keyframe, rows in zip(keyframes, np.split(inside, ends[:-1]), strict=True)
    ]


def _size(keyframes: Sequence[Keyframe]) -> int:
    """Return how many points keyframes hold."""
    return sum(len(keyframe.points) for keyframe in keyframes)
