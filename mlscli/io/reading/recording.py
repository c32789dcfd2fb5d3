"""A recording: one or more sources, read in turn as one flight in the map frame."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from numbers import Integral, Real
from pathlib import Path
from types import NoneType
from typing import TYPE_CHECKING, Any, get_args

import numpy as np

from mlscli.errors import InputError, UsageError, expect, expect_items, expect_path
from mlscli.geometry.transforms import bare
from mlscli.geometry.up import UP_AXES
from mlscli.io.clouds.pointarray import PointArray
from mlscli.io.clouds.trajectory import Trajectory, read_trajectory
from mlscli.io.reading.formats import open_source
from mlscli.io.reading.frames import Mounting
from mlscli.io.reading.glance import Glance
from mlscli.io.reading.placing import Asked, Placing
from mlscli.io.reading.selection import Selection
from mlscli.io.reading.sieve import Sieve
from mlscli.io.reading.tally import UNPLACED, Tally
from mlscli.io.reading.upright import Upright
from mlscli.io.source import Clock, Cloud, Reading, Source
from mlscli.keyframes.keyframe import UNKNOWN_POSITION, Keyframe
from mlscli.runtime.arrays import Array

if TYPE_CHECKING:
    from mlscli.geometry.up import Up

AUTO = "auto"
"""The value of `up` with which the vertical is searched for."""

_TIMELESS = (
    "the time in the headers of all clouds is 0; `time_source` log takes the times of recording"
)


@dataclass(eq=False)
class Recording:
    """Sources opened to be read, as often as needed; made by `open_recording`.

    Attributes
    ----------
    frame_id : str
        The map frame; "map" where no source names one.
    notes : list of str
        What the user should know about how the sources are read.
    options : dict
        The options that differ from their defaults, by name, as JSON can hold them.
    tally : Tally
        Counts of the current or last pass.
    """

    _sources: Sequence[Source]
    _selection: Selection
    _placing: Placing
    _upright: Upright
    _cumulative: bool
    _trajectory: Trajectory | None = None
    _notes: Sequence[str] = ()
    options: dict[str, Any] = field(default_factory=dict)
    tally: Tally = field(default_factory=Tally)
    _glance: Glance | None = None

    @property
    def frame_id(self) -> str:
        """The map frame; "map" where no source names one."""
        return self._placing.frame_id

    @property
    def up(self) -> str:
        """Which direction of the recording points up: an axis, or the direction that was found."""
        return self._upright.up

    @property
    def sources(self) -> list[str]:
        """The files and folders, in the order they are read."""
        return [str(source.path) for source in self._sources]

    @property
    def labels(self) -> list[str]:
        """The names of the clouds in messages to the user: files, and topics if any."""
        return [source.label for source in self._sources]

    @property
    def notes(self) -> list[str]:
        """What the user should know about how the sources are read; complete only after a pass."""
        notes = [note for source in self._sources for note in source.notes]
        notes += [*self._placing.notes, *self._notes]
        if self.tally.unplaced:
            notes.append(
                f"{self.tally.unplaced:,} of {self.tally.keyframes:,} keyframes are left out: "
                "where they were is not known at their times"
            )
        if self._is_timeless:
            notes.append(_TIMELESS)
        return notes

    @property
    def losses(self) -> list[str]:
        """What the last pass could not read."""
        return [loss for source in self._sources for loss in source.losses]

    @property
    def expected_keyframes(self) -> int | None:
        """How many keyframes a pass will yield; None where not known before reading."""
        if self._selection.by_time:
            return None
        total = 0
        for source in self._sources:
            expected = source.expected_keyframes
            if expected is None:
                return None
            total += expected
        return -(-total // self._selection.every)

    @property
    def duration(self) -> float:
        """How many seconds of the sources are selected; NaN where their times are not known."""
        spans = np.array([source.time_span() for source in self._sources])
        return self._selection.duration(float(spans[:, 0].min()), float(spans[:, 1].max()))

    def __iter__(self) -> Iterator[Keyframe]:
        """Read the keyframes; see `keyframes`."""
        return self.keyframes()

    def keyframes(self) -> Iterator[Keyframe]:
        """Read the keyframes from the first to the last; each call begins a new pass.

        Yields
        ------
        Keyframe
            One without points, too, where all were dropped. Where no cloud has a position, the
            poses of the trajectory follow at the end, as keyframes without points.

        Raises
        ------
        InputError
            A source is broken, or the pass has ended without a point.
        UsageError
            `start` or `end` is given, and a keyframe has no time.
        """
        known = False
        for cloud in self._clouds():
            known |= cloud.has_position
            yield Keyframe(cloud.points, cloud.stamp, cloud.position)
        if self._trajectory is not None and not known:
            yield from self._loose_route(self._trajectory)

    def _loose_route(self, trajectory: Trajectory) -> Iterator[Keyframe]:
        """Yield the poses of a trajectory as keyframes without points."""
        for stamp, *position in trajectory.route.tolist():
            x, y, z = position
            yield Keyframe(np.empty((0, 3)), stamp, self._upright.position((x, y, z)))

    def _clouds(self) -> Iterator[Cloud]:
        """Read the clouds of the keyframes in the map frame, turned upright; not the attitudes."""
        self.tally = tally = Tally()
        sieve = Sieve(tally, self._selection.crop, cumulative=self._cumulative)
        choose = self._selection.chooser()

        def wanted(stamp: float) -> bool:
            if not tally.came:
                tally.began = stamp
            tally.came += 1
            tally.timed |= stamp != 0
            return choose(stamp)

        clouds = ((source, cloud) for source in self._sources for cloud in source.clouds(wanted))
        for number, (source, cloud) in enumerate(clouds):
            if number % self._selection.every:
                continue
            tally.keyframes += 1
            tally.points_read += len(cloud.points)
            if self._placing.moves_with_craft(cloud.frame_id):
                cloud = replace(cloud, points=sieve.returned(cloud.points))
            placed = self._placing.place(source, cloud)
            if placed is None:
                tally.unplaced += 1
                tally.drop(UNPLACED, len(cloud.points))
                continue
            points = sieve.measured(self._upright.points(placed.points))
            position = UNKNOWN_POSITION
            if placed.has_position:
                position = self._upright.position(placed.position)
            yield Cloud(points, placed.stamp, position, placed.frame_id, placed.attitude)
        is_part = self._glance is not None and self._glance.cut
        if tally.points_read == sum(tally.dropped.values()) and not is_part:
            raise InputError(self._emptiness())

    @property
    def _is_timeless(self) -> bool:
        """Whether there are several keyframes, and the time in the headers of all is 0."""
        by_header = "time_source" not in self.options
        has_headers = by_header and any(source.topics() for source in self._sources)
        return has_headers and self.tally.came > 1 and not self.tally.timed

    def _out_of_reach(self) -> str:
        """Return what helps where no cloud has a transform at its time."""
        clock = "header" if "time_source" in self.options else "log"
        return (
            f"the clouds begin at {self.tally.began:.3f} s, where transforms and poses do not "
            f"reach; `time_source` {clock} takes other times, `frame` says which frame stands still"
        )

    def _emptiness(self) -> str:
        """Return why a pass has yielded no points."""
        tally, sources = self.tally, ", ".join(self.sources)
        losses = "".join(f"; {loss}" for loss in self.losses)
        if self._is_timeless and (tally.unplaced or not tally.keyframes):
            losses = f"; {_TIMELESS}{losses}"
        elif tally.unplaced == tally.keyframes > 0:
            losses = f"; {self._out_of_reach()}{losses}"
        if not tally.keyframes:
            where = " between `start` and `end`" if self._selection.by_time else ""
            return f"{sources}: holds no keyframes{where}{losses}"
        reasons = ", ".join(f"{count:,} {reason}" for reason, count in tally.dropped.items())
        dropped = f" to map: all {tally.points_read:,} were dropped, {reasons}" if reasons else ""
        return f"{sources}: holds no points{dropped}{losses}"


def open_recording(
    *sources: str | os.PathLike[str] | Array,
    topic: str | None = None,
    columns: str | None = None,
    start: float | None = None,
    end: float | None = None,
    every: int = 1,
    crop: Sequence[float] | None = None,
    up: str = "z",
    cumulative: bool = False,
    frame: str | None = None,
    pose_topic: str | None = None,
    extrinsic: Sequence[float] | None = None,
    time_source: Clock = "header",
    route: str | os.PathLike[str] | None = None,
    glance: Glance | None = None,
) -> Recording:
    """Open one or more sources as one recording.

    Parameters
    ----------
    *sources : paths, or arrays (N, 3)
        Files and folders, whose formats are recognised by content, or points; read in turn.
    topic : str, optional
        The topic of the clouds in bags that have several.
    columns : str, optional
        Names of the columns of text clouds: ``x,y,z,-,keyframe,cx,cy,cz``.
    start, end : float, optional
        Seconds from the first keyframe if below 1e8, else time stamps in seconds; inclusive.
    every : int
        Take keyframes 0, N, 2 N, ... of those between `start` and `end`.
    crop : six floats, optional
        xmin, xmax, ymin, ymax, zmin, zmax in the map frame, inclusive.
    up : str
        Which axis of the recording points up: z, -z, y, -y, x or -x; auto finds it.
    cumulative : bool
        Take a point only the first time that its exact coordinates appear.
    frame : str, optional
        The map frame; clouds in it are taken as they are.
    pose_topic : str, optional
        The topic that holds poses of the craft, by which clouds are moved.
    extrinsic : seven floats, optional
        The pose of the sensor on the craft: x, y, z and a quaternion x, y, z, w.
    time_source : {"header", "log"}
        Which times are used: those in the headers of messages, or those of their recording.
    route : path, optional
        A file with the trajectory of the craft: lines of ``stamp x y z qx qy qz qw``.
    glance : Glance, optional
        The limits up to which to read, where the beginning of the recording is enough.

    Returns
    -------
    Recording

    Raises
    ------
    TypeError
        A source is neither a path nor an array.
    UsageError
        An option is out of range, or fits no source, or the topic is ambiguous.
    InputError
        A source is missing, broken, of no known format, or cannot come into the map frame.
    """
    for name, text in {
        "topic": topic,
        "columns": columns,
        "frame": frame,
        "pose_topic": pose_topic,
    }.items():
        expect(text, (str, NoneType), name, "a text")
    expect(up, str, "up", "a text")
    expect(time_source, str, "time_source", "a text")
    for name, time in {"start": start, "end": end}.items():
        expect(time, (Real, NoneType), name, "a number of seconds")
    expect(every, Integral, "every", "a whole number")
    for name, numbers in {"crop": crop, "extrinsic": extrinsic}.items():
        if numbers is not None:
            expect_items(numbers, name, "a sequence of numbers")
    if route is not None:
        expect_path(route, "route", "a trajectory")
    expect(glance, (Glance, NoneType), "glance", "a Glance")
    selection = Selection(start, end, every, crop)
    if up not in (*UP_AXES, AUTO):
        raise UsageError(f"`up` {up}: expected one of {', '.join(UP_AXES)}, {AUTO}")
    if frame is not None and not bare(frame):
        raise UsageError("`frame`: expected the name of the map frame, found nothing")
    if time_source not in get_args(Clock):
        expected = ", ".join(get_args(Clock))
        raise UsageError(f"`time_source` {time_source}: expected one of {expected}")
    if not sources:
        raise UsageError("no source given: expected at least one recording")
    reading = Reading(topic, columns, time_source)
    opened = [_opened(source, reading) for source in sources]
    if glance is not None:
        opened = [glance.of(source) for source in opened]
    has_topics = [bool(source.topics()) for source in opened]
    is_text = [source.kind == "text cloud" for source in opened]
    _check_applies("topic", topic, has_topics, "a bag")
    _check_applies("pose_topic", pose_topic, has_topics, "a bag")
    _check_applies("extrinsic", _listed(extrinsic), has_topics, "a bag")
    _check_applies("columns", columns, is_text, "a text cloud")
    trajectory = None if route is None else read_trajectory(Path(route))
    placing = Placing.of(opened, Asked(frame, pose_topic, _mounting(extrinsic), trajectory))
    given = {
        "topic": topic,
        "columns": columns,
        "start": start,
        "end": end,
        "every": every if every != 1 else None,
        "crop": None if crop is None else list(crop),
        "up": up if up != "z" else None,
        "cumulative": cumulative or None,
        "frame": frame,
        "pose_topic": pose_topic,
        "extrinsic": None if extrinsic is None else list(extrinsic),
        "time_source": time_source if time_source != "header" else None,
        "route": None if route is None else os.fspath(route),
    }
    options = {name: value for name, value in given.items() if value is not None}
    notes = list(trajectory.notes) if trajectory else []
    upright = Upright.along("z" if up == AUTO else up)
    recording = Recording(
        opened, selection, placing, upright, cumulative, trajectory, notes, options, _glance=glance
    )
    if up == AUTO:
        found = _find_up(recording, trajectory)
        recording._upright = Upright.found(found)
        notes.append(found.summary)
    return recording


def _opened(source: str | os.PathLike[str] | Array, reading: Reading) -> Source:
    expected = "the path of a recording, or points as an array (N, 3)"
    expect(source, (str, os.PathLike, np.ndarray), "sources", expected)
    if isinstance(source, np.ndarray):
        return PointArray(source)
    return open_source(Path(source), reading)


def _find_up(recording: Recording, trajectory: Trajectory | None) -> Up:
    """Find the vertical of a recording, in an extra pass."""
    from mlscli.geometry.surroundings import PointSample
    from mlscli.geometry.vertical import find_up

    sample, positions, turns = PointSample(), [], []
    for cloud in recording._clouds():
        sample.add(cloud.points)
        positions.append(cloud.position)
        turns.append(cloud.attitude)
    if trajectory is not None:
        return find_up(sample.points, trajectory.positions, trajectory.attitudes)
    return find_up(sample.points, np.array(positions), np.array(turns))


def _mounting(extrinsic: Sequence[float] | None) -> Mounting | None:
    if extrinsic is None:
        return None
    if len(extrinsic) != 7 or not np.isfinite(extrinsic).all() or not any(extrinsic[3:]):
        raise UsageError(
            f"`extrinsic` {_listed(extrinsic)}: expected x,y,z,qx,qy,qz,qw, finite numbers, the "
            "quaternion not all 0"
        )
    x, y, z, *rotation = extrinsic
    qx, qy, qz, qw = rotation
    return Mounting((x, y, z), (qx, qy, qz, qw))


def _listed(numbers: Sequence[float] | None) -> str | None:
    return None if numbers is None else ",".join(f"{number:g}" for number in numbers)


def _check_applies(argument: str, value: object, applies: Sequence[bool], what: str) -> None:
    if value is not None and not any(applies):
        raise UsageError(f"`{argument}` {value}: no source is {what}")
