"""The frames of recordings: the tree of transforms, the poses of a topic, the mounting.

A world frame, which stands still, is known by its name; without one it is the root of the tree, if
the frame of the clouds moves in it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from itertools import islice
from typing import NamedTuple

import numpy as np

from mlscli.errors import InputError, UsageError
from mlscli.geometry.poses import Poses, PoseTrack, unit
from mlscli.geometry.transforms import Link, TransformTree, bare
from mlscli.io.plausibility.epochs import Epochs, told
from mlscli.io.plausibility.publishers import of_one_body
from mlscli.io.reading.history import History, Moment
from mlscli.io.reading.names import BODY_FRAMES, WORLD_FRAMES, is_world
from mlscli.io.source import Source
from mlscli.runtime.arrays import Float64


def listed(numbers: Sequence[float] | None) -> str | None:
    """Return numbers as the command line takes them; None where there are none."""
    return None if numbers is None else ",".join(f"{number:g}" for number in numbers)


class Mounting(NamedTuple):
    """T_body_sensor: where a sensor is on the craft.

    Attributes
    ----------
    translation : tuple of float
        x, y, z, in the unit of the recording.
    rotation : tuple of float
        Quaternion x, y, z, w, of any length but 0.
    """

    translation: tuple[float, float, float]
    rotation: tuple[float, float, float, float]

    @classmethod
    def of(cls, extrinsic: Sequence[float] | None) -> Mounting | None:
        """Return the mounting that the user states as x, y, z, qx, qy, qz, qw.

        Raises
        ------
        UsageError
            These are not seven finite numbers, or the quaternion is 0.
        """
        if extrinsic is None:
            return None
        if len(extrinsic) != 7 or not np.isfinite(extrinsic).all() or not any(extrinsic[3:]):
            raise UsageError(
                f"`extrinsic` {listed(extrinsic)}: expected x,y,z,qx,qy,qz,qw, finite numbers, the "
                "quaternion not all 0"
            )
        x, y, z, qx, qy, qz, qw = extrinsic
        return cls((x, y, z), (qx, qy, qz, qw))

    @property
    def poses(self) -> Poses:
        """The same as one pose, to be chained."""
        rotation = unit(np.array([self.rotation]))
        return Poses(np.array([self.translation]), rotation, np.array([True]))


class Track(NamedTuple):
    """T_parent_child over time, from a topic of poses.

    Attributes
    ----------
    parent, child : str
        Names of the frames; empty where the messages name none.
    epochs : Epochs
    poses : list of PoseTrack
        For each epoch.
    times : float64 (M, 2)
        The stamps of its messages, and when they were recorded.
    """

    parent: str
    child: str
    epochs: Epochs
    poses: list[PoseTrack]
    times: Float64

    def at(self, moment: Moment) -> PoseTrack:
        """Return the poses of the epoch of a moment."""
        return self.poses[self.epochs.at(moment.stamp, moment.logged)]

    def notes(self, topic: str) -> list[str]:
        """Return what the user should know about the poses of a topic."""
        jumps = [(begin.before, begin.after) for begin in self.epochs.begins]
        return [f"`pose_topic` {topic}: the clock jumps back {told(jumps)}"] if jumps else []


def read_tree(sources: Sequence[Source]) -> TransformTree:
    """Return the tree of the transforms of all sources, of whatever topic their clouds are."""
    return History(sources, of_clouds=False).whole


def read_track(sources: Sequence[Source], topic: str, gap: float | None = None) -> Track:
    """Return the poses of a topic, over all sources.

    Parameters
    ----------
    sources : sequence of Source
    topic : str
    gap : float, optional
        Nothing is interpolated across so many seconds, see `PoseTrack`.

    Raises
    ------
    UsageError
        The topic has no poses.
    InputError
        The topic has poses of several frames, or in several.
    """
    messages = [poses for source in sources for poses in source.poses(topic) if len(poses.stamps)]
    messages.sort(key=lambda poses: poses.logged)
    if not messages:
        there = [t.name for source in sources for t in source.topics() if t.poses]
        raise UsageError(
            f"`pose_topic` {topic}: found no poses; topics with poses: {', '.join(there) or 'none'}"
        )
    frames = sorted({(bare(poses.parent), bare(poses.child)) for poses in messages})
    if len(frames) > 1:
        found = ", ".join(f"of {child or 'no frame'!r} in {parent!r}" for parent, child in frames)
        raise InputError(
            f"`pose_topic` {topic}: tells poses {found}; expected those of one frame in one other"
        )
    logged = np.array([poses.logged for poses in messages])
    # A path tells all that was so far: its last pose is the time of the clock.
    clock = np.array([poses.stamps.max() for poses in messages])
    epochs = Epochs.of({topic: (logged, clock)})
    tracks = []
    for first, stop, *_ in epochs.runs[topic]:
        some = messages[first:stop]
        stamps = np.concatenate([poses.stamps for poses in some])
        translations = np.concatenate([poses.translations for poses in some])
        rotations = np.concatenate([poses.quaternions for poses in some])
        if len(some) == len(stamps):
            # A path tells again what was, and its last pose of a time counts.
            of_one_body(stamps, translations, rotations).accepted(
                lambda found: InputError(f"`pose_topic` {topic}: its poses are {found}")
            )
        tracks.append(PoseTrack(stamps, translations, rotations, gap=gap))
    return Track(*frames[0], epochs, tracks, np.column_stack((clock, logged)))


def leading_frame(source: Source, tree: TransformTree) -> str:
    """Return the frame of the clouds of a source: that of the first that can be mapped, if any.

    A node may publish before it knows its frame, and some clouds of a topic may be in a frame that
    no transforms lead from. The headers of so many clouds are looked at: 1,000, or 30 if they state
    no frame.
    """
    first = bare(source.frame_id)
    if _leads_on(first, tree):
        return first
    others = (bare(frame) for frame in islice(source.frames(), 1000 if first else 30))
    return next((frame for frame in others if frame != first and _leads_on(frame, tree)), first)


def _leads_on(frame: str, tree: TransformTree) -> bool:
    return is_world(frame) or frame in tree.frames


def mount(history: History, mounting: Mounting, frames: Iterable[str]) -> list[str]:
    """Add the mounting of the sensors to the transforms; return notes about it.

    Parameters
    ----------
    history : History
        Changed in place.
    mounting : Mounting
        As the user states it; the same for all sensors.
    frames : iterable of str
        The frames of the sensors.

    Raises
    ------
    UsageError
        The frame of a sensor is in the tree already, is a world frame or has no name, or the
        frame of the craft is not known.
    """
    tree = history.whole
    body = body_of(tree)
    notes = []
    for frame in sorted(set(frames)):
        if frame in tree.frames:
            raise UsageError(
                f"`extrinsic`: the recording's transforms tell where {frame!r} is; leave it out"
            )
        if not frame or is_world(frame):
            stated = f"in the frame {frame!r}" if frame else "in no frame"
            raise UsageError(f"`extrinsic`: the clouds are {stated}, which is on no craft")
        if body is None:
            raise UsageError(
                "`extrinsic`: the recording does not tell how the craft moves, found the frames "
                f"{', '.join(tree.frames) or 'none'}; give `pose_topic` too"
            )
        history.add_static(
            body, frame, np.array(mounting.translation), np.array(mounting.rotation, dtype=float)
        )
        notes.append(f"`extrinsic`: {frame!r} is taken as mounted on {body!r}")
    return notes


def body_of(tree: TransformTree, near: Sequence[str] = ()) -> str | None:
    """Return the craft's frame: one with a usual name, or the only leaf of the tree; or None.

    Of several with one name, as several robots have, it is the one above the frames that are
    `near`, or in a name space of theirs (which topics have, too); None if that is not one alone.
    """
    frames = tree.frames
    for name in BODY_FRAMES:
        named = [frame for frame in frames if frame.rpartition("/")[2] == name]
        if len(named) > 1:
            spaces = {bare(each).rpartition("/")[0] for each in near} - {""}
            above = {up for each in near for up in _above(tree, each)}
            own = [frame for frame in named if frame in above]
            own = own or [f for f in named if any(_within(s, f) for s in spaces)]
            return own[0] if len(own) == 1 else None
        if named:
            return named[0]
    try:
        leaves = tree.leaves()
    except InputError:
        # Frames that hang in a circle have no leaf.
        return None
    return leaves[0] if len(leaves) == 1 else None


def _above(tree: TransformTree, frame: str) -> list[str]:
    try:
        return tree.ancestors(frame)
    except InputError:
        # Frames that hang in a circle are above nothing.
        return []


def _within(space: str, frame: str) -> bool:
    """Return whether a frame is in a name space, or in one around it."""
    own = frame.rpartition("/")[0]
    return bool(own) and f"{space}/".startswith(f"{own}/")


def map_frame(
    sources: Sequence[tuple[Source, str]],
    declared: str | None,
    tree: TransformTree,
    track: Track | None,
) -> str:
    """Return the map frame: the one declared, or the world frame that the first clouds lead to.

    Where none is declared, the sources are asked in turn. The map frame is that of their clouds if
    it is a world frame; or else the parent of the track, if there is one; or else the world frame
    above that of the clouds. It is "map" where no frame is named.

    Parameters
    ----------
    sources : sequence of (Source, str)
        Each with the frame of its clouds.
    declared : str or None
        As the user names it.
    tree : TransformTree
        The transforms of the sources.
    track : Track or None
        The poses of the pose topic.

    Raises
    ------
    InputError
        The clouds of a source are in a frame that has no world frame above it.
    """
    if declared is not None:
        return bare(declared)
    for source, frame in sources:
        if is_world(frame):
            return frame
        if track is not None:
            return track.parent or "map"
        if frame:
            with named(source.label):
                above = world_above(tree, frame)
            if above is None:
                raise InputError(
                    f"{source.label}: the clouds are in the frame {frame!r}, expected a world "
                    f"frame ({', '.join(WORLD_FRAMES)}); {_ways_out(source, frame, tree)}"
                    + "".join(f"; {told}" for told in (*source.notes, *source.losses))
                )
            return above
    return "map"


def world_above(tree: TransformTree, frame: str) -> str | None:
    """Return the world frame above a frame; None where there is none.

    It is the topmost with the name of a world frame; or else the root, if the frame moves in it.
    A root in which the frame does not move is a part of the craft: where a node tells transforms
    the other way round, the one world frame that moves below it counts.
    """
    above = tree.ancestors(frame)[1:]
    worlds = [parent for parent in above if is_world(parent)]
    if worlds:
        return worlds[-1]
    if above and tree.moves(frame):
        return above[-1]
    below = [world for world in _moving_beside(tree, frame) if is_world(world)]
    top = [world for world in below if not set(below) & set(tree.ancestors(world)[1:])]
    return top[0] if len(top) == 1 else None


def _moving_beside(tree: TransformTree, frame: str) -> list[str]:
    """Return the frames that move below the root of a frame that does not, by name."""
    below: dict[str, list[Link]] = {}
    for link in tree.links:
        below.setdefault(link.parent, []).append(link)
    # Downwards, each frame once: to climb from each would cost the square of a long chain.
    moving = {tree.ancestors(frame)[-1]: False}
    waiting = list(moving)
    while waiting:
        parent = waiting.pop()
        for link in below.get(parent, ()):
            if link.child not in moving:
                moving[link.child] = moving[parent] or link.moves
                waiting.append(link.child)
    return sorted(child for child, moves in moving.items() if moves and child != frame)


def why_not_mapped(source: Source, tree: TransformTree | None = None) -> list[str]:
    """Return for each topic of a source why it cannot be mapped as it is; empty where it can.

    A topic of clouds in a sensor's frame can be mapped where transforms lead from it.

    Parameters
    ----------
    source : Source
    tree : TransformTree, optional
        The transforms of the source, where they have been read already.
    """
    tree = read_tree([source]) if tree is None else tree
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


def _ways_out(source: Source, frame: str, tree: TransformTree) -> str:
    """Return what the user can do about clouds in a sensor's frame."""
    root, body = tree.ancestors(frame)[-1], body_of(tree)
    tell = f"the transforms lead to {root!r} only" if root != frame else "no transforms lead on"
    ways = [f"`pose_topic` {t.name} moves them with the craft" for t in source.topics() if t.poses]
    beside = [] if tree.moves(frame) else _moving_beside(tree, frame)
    if beside:
        tell += f", {', '.join(map(repr, beside[:3]))} below; `frame` takes one that stands still"
    elif root == frame and body and world_above(tree, body):
        # As in a part of a split recording, whose static transforms are in the first.
        ways.append(
            f"`extrinsic` hangs it below {body!r}, as does a recording whose /tf_static holds it"
        )
    return "; ".join([tell, *ways[:3], f"where {root!r} stands still, `frame` {root} says so"])


@contextmanager
def named(what: str) -> Iterator[None]:
    """Put a name before the message of any `InputError` that is raised within."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{what}: {error}") from error
