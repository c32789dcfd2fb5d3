"""A recording: one or more sources, read in turn as one flight in the map frame."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from numbers import Integral
from pathlib import Path
from types import NoneType
from typing import TYPE_CHECKING, Any

import numpy as np

from mlscli.errors import InputError, UsageError, expect, expect_path
from mlscli.io.clouds.trajectory import Trajectory, read_trajectory
from mlscli.io.reading.emptiness import TIMELESS, Pass, why_empty
from mlscli.io.reading.formats import open_one
from mlscli.io.reading.frames import Mounting, listed
from mlscli.io.reading.georeference import asked_georeference, common_georeference
from mlscli.io.reading.glance import Glance
from mlscli.io.reading.history import Moment
from mlscli.io.reading.options import AUTO, check_applies, check_latest, check_types, check_values
from mlscli.io.reading.placing import Asked, Placing
from mlscli.io.reading.republished import Republished
from mlscli.io.reading.selected import last_message, selected
from mlscli.io.reading.selection import Selection
from mlscli.io.reading.sieve import Sieve
from mlscli.io.reading.tally import REPEATED, Tally
from mlscli.io.reading.transform import read_transform
from mlscli.io.reading.upright import Upright
from mlscli.io.reading.witness import Witness
from mlscli.io.source import Clock, Cloud, Reading, Source
from mlscli.keyframes.keyframe import UNKNOWN_POSITION, Keyframe
from mlscli.maps.georeference import Georeference
from mlscli.runtime.arrays import Array, Float64

if TYPE_CHECKING:
    from mlscli.geometry.up import Up

_NONE = np.empty((0, 3))


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
    _latest: bool = False
    _trajectory: Trajectory | None = None
    _notes: Sequence[str] = ()
    options: dict[str, Any] = field(default_factory=dict)
    tally: Tally = field(default_factory=Tally)
    _glance: Glance | None = None
    _georeference: Georeference | None = None
    # What the last pass has found.
    _messages: int = 0
    _is_republished: bool = False
    _is_loose: bool = False
    _witness: Witness | None = None
    _objection: str | None = None

    @property
    def frame_id(self) -> str:
        """The map frame; "map" where no source names one."""
        then = self._upright.then
        return self._placing.frame_id if then is None else then.frame_id

    @property
    def up(self) -> str:
        """Which direction of the recording points up: an axis, or the direction that was found."""
        return self._upright.up

    @property
    def map_from_recording(self) -> Float64:
        """The turn after which z points up, float64 (4, 4), for homogeneous coordinates.

        With a `transform`, the turn of the recording onto whose map that leads.
        """
        then = self._upright.then
        return self._upright.matrix if then is None else then.turn

    @property
    def georeference(self) -> Georeference | None:
        """Where on Earth the frame of the recording lies; None where nothing tells.

        With a `transform`, where that of the recording lies onto whose map it leads.

        Raises
        ------
        InputError
            Sources say different things.
        """
        then = self._upright.then
        if then is not None and self._georeference is None:
            return then.georeference
        return self._georeference or common_georeference(self._sources)

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
        notes += [*self._placing.notes, *self._notes, *self._repeats()]
        notes += self.tally.notes()
        if self._is_timeless:
            notes.append(TIMELESS)
        elif doubt := self._placing.clock_note(self.tally):
            notes.append(doubt)
        if self._objection is None and self._witness is not None:
            self._objection = self._witness.objection(self._upright, self._trajectory)
        return [*notes, self._objection] if self._objection else notes

    def _repeats(self) -> Iterator[str]:
        """Yield what the last pass has found out about the recording as a whole."""
        if self._is_republished:
            yield (
                f"{', '.join(self.labels)}: the same area is published again and again, at other "
                "heights or places, and mapped each time; `latest` takes the last message alone, "
                "`cumulative` drops only points that come again unchanged"
            )
        if self._messages:
            yield f"`latest`: the last message alone is taken, of {self._messages:,}"
        if self._is_loose and self._trajectory and self.tally.has_times:
            begin, clouds = self._trajectory.stamps[0], self.tally.began
            yield (
                f"{self._trajectory.path}: none of its times, from {begin:.3f} s on, is one of the "
                f"clouds, from {clouds:.3f} s on; it is a route of its own"
            )
        if self._cumulative and self.tally.points_read and not self.tally.dropped.get(REPEATED):
            yield "`cumulative`: nothing was dropped, as no point came again unchanged"

    @property
    def losses(self) -> list[str]:
        """What the last pass could not read."""
        losses = [loss for source in self._sources for loss in source.losses]
        return [*losses, *self._trajectory.losses] if self._trajectory else losses

    @property
    def expected_keyframes(self) -> int | None:
        """How many keyframes a pass will yield; None where not known before reading."""
        if self._selection.by_time or self._latest:
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
        first, last = zip(*(source.time_span() for source in self._sources), strict=True)
        # Those that know their times count.
        return self._selection.duration(float(np.fmin.reduce(first)), float(np.fmax.reduce(last)))

    def __iter__(self) -> Iterator[Keyframe]:
        """Read the keyframes; see `keyframes`."""
        return self.keyframes()

    def keyframes(self) -> Iterator[Keyframe]:
        """Read the keyframes from the first to the last; each call begins a new pass.

        Yields
        ------
        Keyframe
            One without points, too, where all were dropped. Where no cloud has a position, the
            poses of the trajectory follow at the end, as keyframes without points. With `latest`,
            such keyframes tell where the craft was at the times of all messages, as far as known.

        Raises
        ------
        InputError
            A source is broken, or the pass has ended without a point.
        UsageError
            `start` or `end` is given, and a keyframe has no time.
        """
        known = self._is_republished = False
        watched = None if self._latest else Republished()
        witness = Witness(finds=False) if self._objection is None else None
        for cloud in self._clouds(witness, watched):
            known |= cloud.has_position
            yield Keyframe(cloud.points, cloud.stamp, cloud.position, cloud.is_ranged)
        self._is_republished = watched is not None and watched.is_noticed()
        self._is_loose = self._trajectory is not None and self._trajectory.is_timed and not known
        if self._trajectory is not None and not known:
            yield from self._loose_route(self._trajectory)
        self._witness = witness

    def _loose_route(self, trajectory: Trajectory) -> Iterator[Keyframe]:
        """Yield the poses of a trajectory as keyframes without points."""
        for stamp, x, y, z in trajectory.route.tolist():
            yield Keyframe(_NONE, stamp, self._upright.position((x, y, z)))

    def _clouds(
        self, witness: Witness | None, watched: Republished | None = None
    ) -> Iterator[Cloud]:
        """Read the clouds of the keyframes in the map frame, turned upright; not the attitudes.

        Messages that are taken as they are recorded are shown to `watched`, and what tells the
        vertical to `witness`.
        """
        self.tally = tally = Tally()
        sieve = Sieve(tally, self._selection.crop, cumulative=self._cumulative)
        if self._latest:
            last, times = last_message(self._sources, self._selection, tally)
            clouds, self._messages = iter(last), len(times)
            yield from self._route(times, witness)
        else:
            clouds = selected(self._sources, self._selection, tally)
        for source, cloud in clouds:
            tally.keyframes += 1
            tally.points_read += len(cloud.points)
            moves = self._placing.moves_with_craft(cloud.frame_id)
            if moves:
                cloud = replace(cloud, points=sieve.returned(cloud.points))
            else:
                cloud = sieve.plausible(cloud)
            placed = self._placing.place(source, cloud)
            if isinstance(placed, str):
                tally.leave_out(placed, len(cloud.points))
                continue
            if watched is not None and cloud.message >= 0 and placed.points is cloud.points:
                watched.add(cloud.points, (source.label, cloud.message))
            points = sieve.measured(self._upright.points(placed.points), cloud)
            if witness is not None:
                witness.add(placed, points)
            position = UNKNOWN_POSITION
            # A map that is published as a whole was seen from all along the route.
            if placed.has_position and (moves or not self._latest):
                position = self._upright.position(placed.position)
            yield Cloud(points, placed.stamp, position, placed.frame_id, is_ranged=placed.is_ranged)
        if tally.points_read == sum(tally.dropped.values()) and not self._is_part:
            by_header = "time_source" not in self.options
            ended = Pass(self._messages, self._is_timeless, self._selection.by_time, by_header)
            # What clouds contradict themselves in may be why nothing of them is left.
            doubts = [note for source in self._sources for note in source.notes]
            why = why_empty(self.sources, tally, self.losses, ended)
            raise InputError("; ".join([why, *doubts]))

    @property
    def _is_part(self) -> bool:
        """Whether the last pass has left clouds unread, as the glance was over."""
        return self._glance is not None and self._glance.cut

    def _route(self, times: Sequence[Moment], witness: Witness | None) -> Iterator[Cloud]:
        """Yield where the craft was at these times, as far as known, as clouds without points."""
        for craft in map(self._placing.craft, times):
            if witness is not None:
                witness.add(craft, _NONE)
            if craft.has_position:
                yield replace(craft, position=self._upright.position(craft.position))

    @property
    def _is_timeless(self) -> bool:
        """Whether there are several keyframes, and the time in the headers of all is 0."""
        by_header = "time_source" not in self.options
        has_headers = by_header and any(source.topics() for source in self._sources)
        return has_headers and self.tally.came > 1 and self.tally.stampless == self.tally.came


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
    latest: bool = False,
    frame: str | None = None,
    pose_topic: str | None = None,
    extrinsic: Sequence[float] | None = None,
    time_source: Clock = "header",
    pose_gap: float | None = None,
    route: str | os.PathLike[str] | None = None,
    transform: str | os.PathLike[str] | Mapping[str, Any] | None = None,
    crs: str | None = None,
    crs_offset: Sequence[float] | None = None,
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
        Take a point only the first time that its exact coordinates, as recorded, appear.
    latest : bool
        Of the messages selected take the last one alone.
    frame : str, optional
        The map frame; clouds in it are taken as they are.
    pose_topic : str, optional
        The topic that holds poses of the craft, by which clouds are moved.
    extrinsic : seven floats, optional
        The pose of the sensor on the craft: x, y, z and a quaternion x, y, z, w.
    time_source : {"header", "log"}
        Which times are used: those in the headers of messages, or those of their recording.
    pose_gap : float, optional
        The longest time (s) between two poses or transforms across which is interpolated; by
        default 10 s, or three times their median spacing where that is more.
    route : path, optional
        A file with the trajectory of the craft: lines of ``stamp x y z qx qy qz qw``.
    transform : path or mapping, optional
        How to come onto a map of another frame, once z points up: the JSON file that ``mls align``
        writes, or what it holds. The frame of that map is then the map frame.
    crs : str, optional
        The reference system on Earth that coordinates as recorded are in: an EPSG code, as
        ``EPSG:32632``, or WKT. By default what the sources say of themselves.
    crs_offset : three floats, optional
        What must be added to x, y, z as recorded to come into it.
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
    check_types(
        texts={"topic": topic, "columns": columns, "frame": frame, "pose_topic": pose_topic}
        | {"crs": crs},
        named={"up": up, "time_source": time_source},
        times={"start": start, "end": end, "pose_gap": pose_gap},
        numbers={"crop": crop, "extrinsic": extrinsic, "crs_offset": crs_offset},
    )
    expect(every, Integral, "every", "a whole number")
    if route is not None:
        expect_path(route, "route", "a trajectory")
    expect(glance, (Glance, NoneType), "glance", "a Glance")
    selection = Selection(start, end, every, crop)
    check_values(up, frame, time_source, pose_gap)
    if not sources:
        raise UsageError("no source given: expected at least one recording")
    reading = Reading(topic, columns, time_source)
    opened = [open_one(source, reading) for source in sources]
    if glance is not None:
        opened = [glance.of(source) for source in opened]
    has_topics = [bool(source.topics()) for source in opened]
    is_text = [source.kind == "text cloud" for source in opened]
    check_applies("topic", topic, has_topics, "a bag")
    check_applies("pose_topic", pose_topic, has_topics, "a bag")
    check_applies("pose_gap", pose_gap, has_topics, "a bag")
    check_applies("extrinsic", listed(extrinsic), has_topics, "a bag")
    check_applies("columns", columns, is_text, "a text cloud")
    if latest:
        check_latest(opened, cumulative=cumulative)
    moved = None if transform is None else read_transform(transform)
    trajectory = None if route is None else read_trajectory(Path(route))
    given_georeference = asked_georeference(crs, crs_offset)
    mounting = Mounting.of(extrinsic)
    placing = Placing.of(opened, Asked(frame, pose_topic, mounting, trajectory, pose_gap))
    given = {
        "topic": topic,
        "columns": columns,
        "start": start,
        "end": end,
        "every": every if every != 1 else None,
        "crop": None if crop is None else list(crop),
        "up": up if up != "z" else None,
        "cumulative": cumulative or None,
        "latest": latest or None,
        "frame": frame,
        "pose_topic": pose_topic,
        "extrinsic": None if extrinsic is None else list(extrinsic),
        "time_source": time_source if time_source != "header" else None,
        "pose_gap": pose_gap,
        "route": None if route is None else os.fspath(route),
        "transform": None if moved is None else moved.to_dict(),
        "crs": None if given_georeference is None else given_georeference.crs,
        "crs_offset": None if crs_offset is None else list(crs_offset),
    }
    options = {name: value for name, value in given.items() if value is not None}
    notes = list(trajectory.notes) if trajectory else []
    upright = Upright.along("z" if up == AUTO else up)
    recording = Recording(
        opened, selection, placing, upright, cumulative, latest, trajectory, notes, options,
        _glance=glance, _georeference=given_georeference,
    )  # fmt: skip
    if up == AUTO:
        found, order_note = _find_up(recording)
        recording._upright, recording._objection = Upright.found(found), ""
        notes += [order_note, found.summary] if order_note else [found.summary]
    if moved is not None:
        recording._upright = recording._upright.before(moved)
    return recording


def _find_up(recording: Recording) -> tuple[Up, str]:
    """Find the vertical of a recording, in an extra pass, and what was doubtful about attitudes.

    What to crop is not known yet.
    """
    selection = replace(recording._selection, crop=None)
    whole = replace(recording, _selection=selection, _cumulative=False)
    witness = Witness(finds=True)
    for _ in whole._clouds(witness):
        pass
    return witness.find_up(recording._trajectory), witness.order_note
