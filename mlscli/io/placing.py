"""Where clouds are in the map: frames, transforms, poses, and the mounting of the sensor.

A cloud in the map frame, or in no frame, is taken as it is. Any other is moved by the transforms
of the recording (/tf, /tf_static), or by the poses of a topic, at its own time. What is known of
the craft's position on the way becomes the route.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from mlscli.errors import InputError, UsageError
from mlscli.io.base import Cloud, Source
from mlscli.io.trajectory import Trajectory
from mlscli.poses import Pose, Poses, PoseTrack, apply, unit
from mlscli.transforms import TransformTree, bare
from mlscli.typing import Float64

WORLD_FRAMES = (
    *("map", "odom", "odom_combined", "world", "earth", "global", "origin", "local_origin"),
    *("camera_init", "vicon"),
)
"""Frames that stand still, whatever name space they are in."""

BODY_FRAMES = ("base_link", "base_footprint", "base", "body", "base_stabilized", "imu_link")
"""What the craft's own frame is mostly called, the likeliest first."""


class Mounting(NamedTuple):
    """T_body_sensor: where a sensor is on the craft.

    Attributes
    ----------
    translation : tuple
        x, y, z.
    rotation : tuple
        Quaternion x, y, z, w, of any length but 0.
    """

    translation: tuple[float, float, float]
    rotation: tuple[float, float, float, float]

    @property
    def poses(self) -> Poses:
        """The same, to be chained."""
        rotation = unit(np.array([self.rotation]))
        return Poses(np.array([self.translation]), rotation, np.array([True]))


@dataclass(frozen=True)
class Asked:
    """What the user says of frames and poses.

    Attributes
    ----------
    frame : str or None
        The map frame.
    pose_topic : str or None
        The topic that tells where the craft was.
    mounting : Mounting or None
        Where the sensor is on the craft, where the recording does not tell.
    trajectory : Trajectory or None
        Where the craft was, from a file.
    """

    frame: str | None = None
    pose_topic: str | None = None
    mounting: Mounting | None = None
    trajectory: Trajectory | None = None


_NEVER = np.array([np.nan])
# Asked about this time, a tree only tells whether frames are connected.

Way = Callable[[float], Pose | None]
"""T_map_cloud at a time; None where not known."""


@dataclass(eq=False)
class Placing:
    """The map frame, and the way into it from every other.

    Attributes
    ----------
    frame_id : str
        The map frame.
    notes : list of str
        How clouds come into it.
    """

    frame_id: str
    _asked: Asked
    _tree: TransformTree
    _track: _Track | None
    _ways: dict[str, Way | None] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    @classmethod
    def of(cls, sources: Sequence[Source], asked: Asked) -> Placing:
        """Read what the sources tell of frames, and settle the map frame.

        Raises
        ------
        InputError
            The clouds of a source can never come into the map frame.
        UsageError
            What is asked for fits no source.
        """
        tree, notes = told_tree(sources), list[str]()
        track = None if asked.pose_topic is None else _told_track(sources, asked.pose_topic)
        if asked.mounting is not None and track is None:
            notes += _mount(tree, asked.mounting, sources)
        frame_id = _map_frame(sources, asked.frame, tree, track)
        placing = cls(frame_id, asked, tree, track, notes=notes)
        if track is not None:
            with _named(f"--pose-topic {asked.pose_topic}"):
                placing._in_map(track, _NEVER)
        for source in sources:
            placing._check(source)
        return placing

    def place(self, source: Source, cloud: Cloud) -> Cloud | None:
        """Return a cloud in the map frame, with the craft's position; None where not known where.

        Raises
        ------
        InputError
            Nothing leads from its frame to the map frame.
        """
        frame = bare(cloud.frame_id)
        if frame not in self._ways:
            self._ways[frame] = self._way(source, frame)
        way = self._ways[frame]
        points, position, attitude = cloud.points, cloud.position, cloud.attitude
        if way is not None:
            pose = way(cloud.stamp)
            if pose is None:
                return None
            points = apply(pose, points)
            position, attitude = _told(pose)
        known = position if cloud.has_position else self._position(cloud.stamp)
        return Cloud(points, cloud.stamp, known or position, self.frame_id, attitude)

    def moves_with_craft(self, frame_id: str) -> bool:
        """Tell whether a frame is a sensor's: there, (0, 0, 0) is where the sensor is itself."""
        frame = bare(frame_id)
        return (bool(frame) and not is_world(frame)) or self._ways.get(frame) is not None

    def _position(self, stamp: float) -> tuple[float, float, float] | None:
        """Return where the craft was, by the best that is known; None where nothing is."""
        times = np.array([stamp])
        if self._asked.trajectory is not None:
            return _known(self._asked.trajectory.at(times))
        if self._track is not None:
            return _known(self._in_map(self._track, times).translation)
        body = self._body
        if body is None or body == self.frame_id:
            return None
        try:
            return _known(self._tree.lookup(self.frame_id, body, times).translation)
        except InputError:
            return None

    @cached_property
    def _body(self) -> str | None:
        return _body(self._tree)

    # --- ways into the map frame ---

    def _check(self, source: Source) -> None:
        """Find the way of a source's first cloud, and say which it is."""
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
        """Return the way of clouds of a frame; None where they are taken as they are."""
        if self._track is not None and frame != self.frame_id:
            return self._way_by_poses(self._track, frame)
        if frame in ("", self.frame_id):
            return None
        if frame not in self._tree.frames:
            raise InputError(
                f"{source.label}: the clouds are in the frame {frame!r}, expected the map frame "
                f"{self.frame_id!r}, or transforms that lead to it"
            )
        # Refused at once where nothing connects the frames at any time.
        with _named(source.label):
            self._tree.lookup(self.frame_id, frame, _NEVER)
        return self._way_by_tree(frame)

    def _way_by_tree(self, frame: str) -> Way:
        def way(stamp: float) -> Pose | None:
            try:
                return _single(self._tree.lookup(self.frame_id, frame, np.array([stamp])))
            except InputError:
                # The frames are connected at other times.
                return None

        return way

    def _way_by_poses(self, track: _Track, frame: str) -> Way:
        mounting = self._asked.mounting
        mount = None if mounting is None else mounting.poses
        body = track.child or self._body
        if mount is None and frame and body and {frame, body} <= {*self._tree.frames}:
            # A sensor that moves on the craft is looked up anew each time.
            return lambda stamp: _single(
                self._in_map(track, np.array([stamp])).chained(
                    self._tree.lookup(body, frame, np.array([stamp]))
                )
            )
        if mount is None and frame != body:
            self.notes.append(
                f"--pose-topic {self._asked.pose_topic}: the mounting of {frame or 'the sensor'!r} "
                "on the craft is not known and taken as none; --extrinsic gives it"
            )

        def way(stamp: float) -> Pose | None:
            poses = self._in_map(track, np.array([stamp]))
            return _single(poses if mount is None else poses.chained(mount))

        return way

    def _in_map(self, track: _Track, stamps: Float64) -> Poses:
        """Return T_map_body."""
        poses = track.poses.at(stamps)
        if track.parent in ("", self.frame_id):
            return poses
        return self._tree.lookup(self.frame_id, track.parent, stamps).chained(poses)


class _Track(NamedTuple):
    """T_parent_child over time, as a topic tells it."""

    parent: str
    child: str
    poses: PoseTrack


def why_not_mapped(source: Source, tree: TransformTree | None = None) -> list[str]:
    """Say for each topic of a source what stands against mapping it as it is; nothing where none.

    A topic of clouds in a sensor's frame can be mapped where transforms lead from it.

    Parameters
    ----------
    source : Source
    tree : TransformTree, optional
        Of the source, where it has been read already.
    """
    tree = told_tree([source]) if tree is None else tree
    reasons = []
    for topic in source.topics():
        frame = bare(topic.frame)
        try:
            leads_on = not frame or is_world(frame) or world_above(tree, frame) is not None
            why_not = f"frame {frame!r} is no world frame; {_ways_out(source, frame, tree)}"
        except InputError as error:
            leads_on, why_not = False, str(error)
        reasons.append(topic.why_not if leads_on or not topic.mappable else why_not)
    return reasons


def is_world(frame: str) -> bool:
    """Tell by its name whether a frame stands still."""
    return bare(frame).rpartition("/")[2] in WORLD_FRAMES


def told_tree(sources: Sequence[Source]) -> TransformTree:
    """Return the frames that the transforms of all sources tell."""
    tree = TransformTree()
    for source in sources:
        for told, stays in source.transforms():
            if stays:
                for translation, rotation in zip(told.translations, told.quaternions, strict=True):
                    tree.add_static(told.parent, told.child, translation, rotation)
            else:
                tree.add(told.parent, told.child, told.stamps, told.translations, told.quaternions)
    return tree


def _told_track(sources: Sequence[Source], topic: str) -> _Track:
    told = [poses for source in sources for poses in source.poses(topic)]
    stamps = np.concatenate([np.empty(0), *(poses.stamps for poses in told)])
    if not len(stamps):
        there = [topic.name for source in sources for topic in source.topics() if topic.poses]
        raise UsageError(
            f"--pose-topic {topic}: found no poses; topics with poses: {', '.join(there) or 'none'}"
        )
    frames = sorted(
        {(bare(poses.parent), bare(poses.child)) for poses in told if len(poses.stamps)}
    )
    if len(frames) > 1:
        found = ", ".join(f"of {child or 'no frame'!r} in {parent!r}" for parent, child in frames)
        raise InputError(
            f"--pose-topic {topic}: tells poses {found}; expected those of one frame in one other"
        )
    track = PoseTrack(
        stamps,
        np.concatenate([poses.translations for poses in told]),
        np.concatenate([poses.quaternions for poses in told]),
    )
    return _Track(*frames[0], track)


def _mount(tree: TransformTree, mounting: Mounting, sources: Sequence[Source]) -> list[str]:
    """Hang the sensors where the user says that they are mounted; say where that is."""
    body = _body(tree)
    notes = []
    for frame in sorted({bare(source.frame_id) for source in sources}):
        if frame in tree.frames:
            raise UsageError(
                f"--extrinsic: the recording's transforms tell where {frame!r} is; leave it out"
            )
        if not frame or is_world(frame):
            stated = f"in the frame {frame!r}" if frame else "in no frame"
            raise UsageError(f"--extrinsic: the clouds are {stated}, which is on no craft")
        if body is None:
            raise UsageError(
                "--extrinsic: the recording does not tell how the craft moves, found the frames "
                f"{', '.join(tree.frames) or 'none'}; give --pose-topic too"
            )
        tree.add_static(
            body, frame, np.array(mounting.translation), np.array(mounting.rotation, dtype=float)
        )
        notes.append(f"--extrinsic: {frame!r} is taken as mounted on {body!r}")
    return notes


def _body(tree: TransformTree) -> str | None:
    """Return the craft's frame: one of the usual names, or the only one that others hang not on."""
    frames = tree.frames
    for name in BODY_FRAMES:
        for frame in frames:
            if frame.rpartition("/")[2] == name:
                return frame
    try:
        above = {parent for frame in frames for parent in tree.ancestors(frame)[1:]}
    except InputError:
        # Frames that hang in a circle hang on no craft.
        return None
    leaves = [frame for frame in frames if frame not in above]
    return leaves[0] if len(leaves) == 1 else None


def _map_frame(
    sources: Sequence[Source], declared: str | None, tree: TransformTree, track: _Track | None
) -> str:
    """Return the frame declared, or the world frame that the first clouds are in or lead to."""
    if declared is not None:
        return bare(declared)
    for source in sources:
        frame = bare(source.frame_id)
        if is_world(frame):
            return frame
        if track is not None:
            return track.parent or "map"
        if frame:
            with _named(source.label):
                above = world_above(tree, frame)
            if above is None:
                raise InputError(
                    f"{source.label}: the clouds are in the frame {frame!r}, expected a world "
                    f"frame ({', '.join(WORLD_FRAMES)}); {_ways_out(source, frame, tree)}"
                )
            return above
    return "map"


def world_above(tree: TransformTree, frame: str) -> str | None:
    """Return the frame above another that stands still; None where there is none.

    It is the topmost with the name of a world frame, or the root where something moves below it:
    a root that all hangs below unmoved is a part of the craft.
    """
    above = tree.ancestors(frame)[1:]
    named = [parent for parent in above if is_world(parent)]
    if named:
        return named[-1]
    return above[-1] if above and tree.moves(frame) else None


def _ways_out(source: Source, frame: str, tree: TransformTree) -> str:
    """Say what the user can do about clouds in a sensor's frame."""
    root = tree.ancestors(frame)[-1]
    tell = f"the transforms lead to {root!r} only" if root != frame else "no transforms lead on"
    ways = [f"--pose-topic {t.name} moves them with the craft" for t in source.topics() if t.poses]
    return "; ".join([tell, *ways[:2], f"where {root!r} stands still, --frame {root} says so"])


@contextmanager
def _named(what: str) -> Iterator[None]:
    """Let errors of the tree say whose frames they are about."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{what}: {error}") from error


def _single(poses: Poses) -> Pose | None:
    return poses.pose(0) if poses.known[0] else None


def _told(pose: Pose) -> tuple[tuple[float, float, float], tuple[float, float, float, float]]:
    """Return the position and the attitude that a pose tells."""
    x, y, z = pose.translation.tolist()
    qx, qy, qz, qw = pose.rotation.tolist()
    return (x, y, z), (qx, qy, qz, qw)


def _known(positions: Float64) -> tuple[float, float, float] | None:
    """Return a position (1, 3); None where it is not known."""
    x, y, z = positions[0].tolist()
    return (x, y, z) if np.isfinite(positions).all() else None
