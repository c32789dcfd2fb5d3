"""Move clouds into the map frame, at their own times, and find the position of the craft.

A cloud in the map frame is taken as it is, and so is one in no frame, unless there is a pose topic.
Any other is moved by the transforms of the recording (/tf, /tf_static), or by the poses of that
topic. The positions of the craft become the route.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from mlscli.errors import InputError
from mlscli.geometry.poses import Pose, Poses, apply
from mlscli.geometry.transforms import TransformTree, bare
from mlscli.io.clouds.trajectory import Trajectory
from mlscli.io.reading.frames import (
    Mounting,
    Track,
    axes_of,
    body_of,
    is_body,
    is_world,
    map_frame,
    mount,
    named,
    read_track,
    read_tree,
)
from mlscli.io.source import Cloud, Source
from mlscli.keyframes.keyframe import Axes
from mlscli.runtime.arrays import Float64


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
    """

    frame: str | None = None
    pose_topic: str | None = None
    mounting: Mounting | None = None
    trajectory: Trajectory | None = None


_NONE = np.empty((0, 3))

Way = Callable[[float], Pose | None]
"""Returns T_map_cloud at a stamp (s); returns None or raises `InputError` where not known."""


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
    _tree: TransformTree
    _track: Track | None
    _ways: dict[str, Way | None] = field(default_factory=dict)
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
        tree, notes = read_tree(sources), list[str]()
        track = None if asked.pose_topic is None else read_track(sources, asked.pose_topic)
        if asked.mounting is not None and track is None:
            notes += mount(tree, asked.mounting, sources)
        frame_id = map_frame(sources, asked.frame, tree, track)
        placing = cls(frame_id, asked, tree, track, notes=notes)
        if track is not None:
            with named(f"`pose_topic` {asked.pose_topic}"):
                tree.check_way(frame_id, track.parent or frame_id)
        for source in sources:
            placing._check(source)
        return placing

    def place(self, source: Source, cloud: Cloud) -> Cloud | None:
        """Return a cloud moved into the map frame, with the position of the craft.

        Returns
        -------
        Cloud or None
            None where the pose of the cloud at its time is not known.

        Raises
        ------
        InputError
            Nothing leads from its frame to the map frame.
        """
        frame = bare(cloud.frame_id)
        if frame not in self._ways:
            self._ways[frame] = self._way(source, frame)
        way = self._ways[frame]
        placed = replace(cloud, frame_id=self.frame_id)
        if way is not None:
            try:
                pose = way(cloud.stamp)
            except InputError:
                # The frames are connected at other times only.
                pose = None
            if pose is None:
                return None
            placed = replace(placed, points=apply(pose, cloud.points), position=_place(pose))
            if axes_of(frame) == "camera":
                placed = replace(placed, attitude=_attitude(pose), axes="camera")
        craft = self.craft(cloud.stamp)
        if craft.has_position and not cloud.has_position:
            placed = replace(placed, position=craft.position)
        if craft.has_attitude and not placed.has_attitude:
            placed = replace(placed, attitude=craft.attitude, axes=craft.axes)
        return placed

    def moves_with_craft(self, frame_id: str) -> bool:
        """Return whether a frame is that of a sensor, which is itself at (0, 0, 0)."""
        frame = bare(frame_id)
        return (bool(frame) and not is_world(frame)) or self._ways.get(frame) is not None

    def craft(self, stamp: float) -> Cloud:
        """Return where the craft was and how it was held, in the map frame, as far as known.

        It is a cloud without points. Its position is that of the trajectory; without one, that of
        the pose of the craft. It has an attitude only where that may be the craft's own.
        """
        found, pose = Cloud(_NONE, stamp, frame_id=self.frame_id), self._craft(stamp)
        if self._asked.trajectory is not None:
            (position,) = self._asked.trajectory.at(np.array([stamp]))
            x, y, z = position.tolist()
            found = replace(found, position=(x, y, z))
        elif pose is not None:
            found = replace(found, position=_place(pose))
        if pose is not None and self._craft_axes is not None:
            found = replace(found, attitude=_attitude(pose), axes=self._craft_axes)
        return found

    def _craft(self, stamp: float) -> Pose | None:
        """Return the pose of the craft in the map frame; None where not known.

        It is that of the pose topic; or else of the transforms.
        """
        times, body = np.array([stamp]), self._body
        try:
            if self._track is not None:
                return _single(self._in_map(self._track, times))
            if body is None or body == self.frame_id:
                return None
            return _single(self._tree.lookup(self.frame_id, body, times))
        except InputError:
            # The frames are connected at other times only.
            return None

    @cached_property
    def _body(self) -> str | None:
        return body_of(self._tree)

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
        frame = bare(source.frame_id)
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
        if frame not in self._tree.frames:
            raise InputError(
                f"{source.label}: the clouds are in the frame {frame!r}, expected the map frame "
                f"{self.frame_id!r}, or transforms that lead to it"
            )
        # Refused now if nothing connects the frames at any time.
        with named(source.label):
            self._tree.check_way(self.frame_id, frame)
        return lambda stamp: _single(self._tree.lookup(self.frame_id, frame, np.array([stamp])))

    def _way_by_poses(self, track: Track, frame: str) -> Way:
        mounting = self._asked.mounting
        mount = None if mounting is None else mounting.poses
        body = track.child or self._body
        if mount is None and frame and body and {frame, body} <= {*self._tree.frames}:
            # Looked up for each stamp, as a sensor may move on the craft.
            return lambda stamp: _single(
                self._in_map(track, np.array([stamp])).chained(
                    self._tree.lookup(body, frame, np.array([stamp]))
                )
            )
        if mount is None and frame != body:
            self.notes.append(
                f"`pose_topic` {self._asked.pose_topic}: the mounting of {frame or 'the sensor'!r} "
                "on the craft is not known and taken as none; `extrinsic` gives it"
            )

        def way(stamp: float) -> Pose | None:
            poses = self._in_map(track, np.array([stamp]))
            return _single(poses if mount is None else poses.chained(mount))

        return way

    def _in_map(self, track: Track, stamps: Float64) -> Poses:
        """Return T_map_body at these stamps (M,)."""
        poses = track.poses.at(stamps)
        if track.parent in ("", self.frame_id):
            return poses
        return self._tree.lookup(self.frame_id, track.parent, stamps).chained(poses)


def _single(poses: Poses) -> Pose | None:
    return poses.pose(0) if poses.known[0] else None


def _place(pose: Pose) -> tuple[float, float, float]:
    x, y, z = pose.translation.tolist()
    return x, y, z


def _attitude(pose: Pose) -> tuple[float, float, float, float]:
    x, y, z, w = pose.rotation.tolist()
    return x, y, z, w
