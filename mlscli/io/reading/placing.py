"""Move clouds into the map frame, at their own times, and find the position of the craft.

A cloud in the map frame is taken as it is, and so is one in no frame, unless there is a pose topic.
Any other is moved by the transforms of the recording (/tf, /tf_static), or by the poses of that
topic. The positions of the craft become the route.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from mlscli.errors import InputError
from mlscli.geometry.poses import Pose, Poses, apply
from mlscli.geometry.transforms import bare
from mlscli.io.clouds.trajectory import Trajectory
from mlscli.io.plausibility.clocks import same_clock, same_rate
from mlscli.io.reading.frames import (
    Mounting,
    Track,
    body_of,
    leading_frame,
    map_frame,
    mount,
    named,
    read_track,
)
from mlscli.io.reading.history import History, Moment
from mlscli.io.reading.names import axes_of, is_body, is_world
from mlscli.io.reading.tally import FRAMELESS, IN_GAP, UNCONNECTED, UNPLACED, Tally
from mlscli.io.source import Cloud, Source
from mlscli.keyframes.keyframe import Axes


@dataclass(frozen=True)
class Asked:
    """The user's options for frames and poses.

    Attributes
    ----------
    frame : str or None
        The map frame.
    pose_topic : str or None
        The topic that holds poses of the craft.
    mounting : Mounting or None
        The pose of the sensor on the craft, for recordings that do not hold it.
    trajectory : Trajectory or None
        Positions of the craft, from a file.
    gap : float or None
        Nothing is interpolated across so many seconds; None: as `PoseTrack` does it.
    """

    frame: str | None = None
    pose_topic: str | None = None
    mounting: Mounting | None = None
    trajectory: Trajectory | None = None
    gap: float | None = None


_NONE = np.empty((0, 3))

Way = Callable[[Moment], Pose | None]
"""Returns T_map_cloud at a moment; returns None or raises `InputError` where not known."""


@dataclass(eq=False)
class Placing:
    """Moves clouds from any frame into the map frame.

    Attributes
    ----------
    frame_id : str
        The map frame.
    notes : list of str
        What the user should know about how clouds come into it.
    """

    frame_id: str
    _asked: Asked
    _history: History
    _track: Track | None
    _leading: dict[int, str]
    _near: Sequence[str]
    _ways: dict[str, Way | str | None] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    @classmethod
    def of(cls, sources: Sequence[Source], asked: Asked) -> Placing:
        """Read the transforms and poses of the sources, and choose the map frame.

        Raises
        ------
        InputError
            The clouds of a source can never come into the map frame.
        UsageError
            An option fits no source.
        """
        history = History(sources, asked.gap, None if asked.frame is None else bare(asked.frame))
        tree, notes, track = history.whole, history.notes, None
        if asked.pose_topic is not None:
            track = read_track(sources, asked.pose_topic, asked.gap)
            notes += track.notes(asked.pose_topic)
        leading = {id(source): leading_frame(source, tree) for source in sources}
        if asked.mounting is not None and track is None:
            notes += mount(history, asked.mounting, leading.values())
        framed = [(source, leading[id(source)]) for source in sources]
        with _refusing(history.contradiction):
            frame_id = map_frame(framed, asked.frame, tree, track)
        near = [*leading.values(), *(source.topic for source in sources if source.topics())]
        placing = cls(frame_id, asked, history, track, leading, near, notes=notes)
        if track is not None:
            with named(f"`pose_topic` {asked.pose_topic}"):
                tree.check_way(frame_id, track.parent or frame_id)
        for source in sources:
            with _refusing(history.contradiction):
                placing._check(source)
        placing.notes += [
            f"{fault}; where it was is not known" for fault in history.faults.values()
        ]
        return placing

    def place(self, source: Source, cloud: Cloud) -> Cloud | str:
        """Return a cloud moved into the map frame, with the position of the craft.

        Returns
        -------
        Cloud or str
            The reason why it is left out, where its pose is not known.
        """
        frame, moment = bare(cloud.frame_id), Moment(cloud.stamp, cloud.logged, source)
        if not frame and self._leading.get(id(source)):
            return FRAMELESS
        if frame not in self._ways:
            try:
                self._ways[frame] = self._way(source, frame)
            except InputError:
                self._ways[frame] = UNCONNECTED
        way = self._ways[frame]
        # What changes, at once: each copy of a cloud takes as long as to read a small one.
        changed: dict[str, Any] = {"frame_id": self.frame_id}
        if isinstance(way, str):
            return way
        if way is not None:
            try:
                pose = way(moment)
            except InputError:
                # The frames are connected at other times only.
                pose = None
            if pose is None:
                return IN_GAP if self._is_in_gap(frame, moment) else UNPLACED
            changed |= {"points": apply(pose, cloud.points), "position": _place(pose)}
            if axes_of(frame) == "camera":
                changed |= {"attitude": _attitude(pose), "axes": "camera"}
        craft = self.craft(moment)
        if craft.has_position and not cloud.has_position:
            changed["position"] = craft.position
        if craft.has_attitude and not ("attitude" in changed or cloud.has_attitude):
            changed |= {"attitude": craft.attitude, "axes": craft.axes}
        return replace(cloud, **changed)

    def clock_note(self, tally: Tally) -> str:
        """Return why clouds may be moved by poses of other times; empty where nothing says so.

        Parameters
        ----------
        tally : Tally
            With the times of the first and the last clouds.
        """
        if not any(callable(way) for way in self._ways.values()):
            return ""
        poses = self._history.times if self._track is None else self._track.times
        first, last = (np.array(times).reshape(-1, 2) for times in (tally.times, tally.latest))
        note = same_clock(first, poses, unplaced=UNPLACED in tally.left_out).note
        if not note and not tally.jumps:
            note = same_rate(first, last, poses).note
        way_out = "where their clocks differ, `time_source` log takes the times of recording"
        return f"{note}; {way_out}" if note else ""

    def moves_with_craft(self, frame_id: str) -> bool:
        """Return whether a frame is that of a sensor, which is itself at (0, 0, 0)."""
        frame = bare(frame_id)
        return (bool(frame) and not is_world(frame)) or self._ways.get(frame) is not None

    def craft(self, moment: Moment) -> Cloud:
        """Return where the craft was and how it was held, in the map frame, as far as known.

        It is a cloud without points. Its position is that of the trajectory; without one, that of
        the pose of the craft. It has an attitude only where that may be the craft's own.
        """
        found: dict[str, Any] = {}
        pose = self._craft(moment)
        if self._asked.trajectory is not None:
            (position,) = self._asked.trajectory.at(np.array([moment.stamp]))
            found["position"] = tuple(position.tolist())
        elif pose is not None:
            found["position"] = _place(pose)
        if pose is not None and self._craft_axes is not None:
            found |= {"attitude": _attitude(pose), "axes": self._craft_axes}
        return Cloud(_NONE, moment.stamp, frame_id=self.frame_id, **found)

    def _craft(self, moment: Moment) -> Pose | None:
        """Return the pose of the craft in the map frame; None where not known.

        It is that of the pose topic; or else of the transforms.
        """
        body = self._body
        try:
            if self._track is not None:
                return _single(self._in_map(self._track, moment))
            if body is None or body == self.frame_id or self._faults(self.frame_id, body):
                return None
            return _single(self._lookup(self.frame_id, body, moment))
        except InputError:
            # The frames are connected at other times only.
            return None

    @cached_property
    def _body(self) -> str | None:
        return body_of(self._history.whole, self._near)

    @cached_property
    def _craft_axes(self) -> Axes | None:
        """Whose axes the poses of the craft are of; None where they may be those of a scanner.

        A frame below all others that has no usual name may be that of a scanner that turns.
        """
        if self._track is not None:
            return axes_of(self._track.child)
        return axes_of(self._body) if self._body and is_body(self._body) else None

    # --- ways into the map frame ---

    def _check(self, source: Source) -> None:
        """Find the way of a source's first cloud, and add a note about it."""
        if not source.topics():
            return
        frame = self._leading[id(source)]
        way = self._ways[frame] = self._way(source, frame)
        if way is None:
            stated = f"are in the frame {frame!r}" if frame else "state no frame"
            self.notes.append(f"{source.label}: the clouds {stated} and are taken as they are")
        else:
            by = "the transforms" if self._track is None else str(self._asked.pose_topic)
            stated = f"from {frame!r} " if frame else ""
            self.notes.append(
                f"{source.label}: the clouds are moved {stated}into {self.frame_id!r} by {by}"
            )

    def _way(self, source: Source, frame: str) -> Way | None:
        """Return the way for clouds in a frame; None where they are taken as they are."""
        if self._track is not None and frame != self.frame_id:
            return self._way_by_poses(self._track, frame)
        if frame in ("", self.frame_id):
            return None
        if frame not in self._history.whole.frames:
            raise InputError(
                f"{source.label}: the clouds are in the frame {frame!r}, expected the map frame "
                f"{self.frame_id!r}, or transforms that lead to it"
            )
        # Refused now if nothing connects the frames at any time.
        with named(source.label):
            _check_way(self._history, self.frame_id, frame)
            self._check_faults(self.frame_id, frame)
        return lambda moment: _single(self._lookup(self.frame_id, frame, moment))

    def _check_faults(self, target: str, source: str) -> None:
        """Raise an error if transforms between two frames contradict each other."""
        faults = self._faults(target, source)
        if faults:
            raise InputError(
                f"{faults[0]}; which are those of the clouds cannot be told, `pose_topic` moves "
                "clouds by the poses of a topic"
            )

    def _faults(self, target: str, source: str) -> list[str]:
        between = self._history.whole.between(target, source) if self._history.faults else []
        return [self._history.faults[each] for each in between if each in self._history.faults]

    def _way_by_poses(self, track: Track, frame: str) -> Way:
        mounting = self._asked.mounting
        mount = None if mounting is None else mounting.poses
        body = track.child or self._body
        if mount is None and frame and body and {frame, body} <= {*self._history.whole.frames}:
            self._check_faults(body, frame)
            # Looked up for each stamp, as a sensor may move on the craft.
            return lambda moment: _single(
                self._in_map(track, moment).chained(self._lookup(body, frame, moment))
            )
        if mount is None and frame != body:
            self.notes.append(
                f"`pose_topic` {self._asked.pose_topic}: the mounting of {frame or 'the sensor'!r} "
                "on the craft is not known and taken as none; `extrinsic` gives it"
            )

        def way(moment: Moment) -> Pose | None:
            poses = self._in_map(track, moment)
            return _single(poses if mount is None else poses.chained(mount))

        return way

    def _in_map(self, track: Track, moment: Moment) -> Poses:
        """Return T_map_body at a moment."""
        poses = track.at(moment).at(np.array([moment.stamp]))
        if track.parent in ("", self.frame_id):
            return poses
        return self._lookup(self.frame_id, track.parent, moment).chained(poses)

    def _lookup(self, target: str, source: str, moment: Moment) -> Poses:
        return self._history.at(moment).lookup(target, source, np.array([moment.stamp]))

    def _is_in_gap(self, frame: str, moment: Moment) -> bool:
        """Return whether a pose is not known for a gap in the transforms, or the poses."""
        target, track = self.frame_id, self._track
        if track is not None:
            if track.at(moment).in_gap(np.array([moment.stamp]))[0]:
                return True
            frame, target = track.child or frame, track.parent or target
        return self._history.at(moment).in_gap(target, frame, moment.stamp)


def _check_way(history: History, target: str, source: str) -> None:
    """Raise an error if two frames are connected at no time."""
    faults = []
    for tree in history.trees():
        try:
            tree.check_way(target, source)
        except InputError as fault:
            faults.append(fault)
        else:
            return
    raise faults[0]


@contextmanager
def _refusing(contradiction: str) -> Iterator[None]:
    """Add to the message of an `InputError` why transforms were not taken, if any."""
    try:
        yield
    except InputError as error:
        if not contradiction:
            raise
        raise InputError(f"{error}; {contradiction}") from error


def _single(poses: Poses) -> Pose | None:
    return poses.pose(0) if poses.known[0] else None


def _place(pose: Pose) -> tuple[float, float, float]:
    x, y, z = pose.translation.tolist()
    return x, y, z


def _attitude(pose: Pose) -> tuple[float, float, float, float]:
    x, y, z, w = pose.rotation.tolist()
    return x, y, z, w
