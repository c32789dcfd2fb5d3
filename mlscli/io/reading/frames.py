"""What recordings tell of frames: the tree of transforms, the poses of a topic, the mounting.

Which frames stand still is told by their names, or by what moves below them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np

from mlscli.errors import InputError, UsageError
from mlscli.geometry.poses import Poses, PoseTrack, unit
from mlscli.geometry.transforms import TransformTree, bare
from mlscli.io.source import Source

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


class Track(NamedTuple):
    """T_parent_child over time, as a topic tells it."""

    parent: str
    child: str
    poses: PoseTrack


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


def told_track(sources: Sequence[Source], topic: str) -> Track:
    """Return the poses that a topic of the sources tells.

    Raises
    ------
    UsageError
        It tells none.
    InputError
        It tells poses of several frames.
    """
    told = [poses for source in sources for poses in source.poses(topic)]
    stamps = np.concatenate([np.empty(0), *(poses.stamps for poses in told)])
    if not len(stamps):
        there = [t.name for source in sources for t in source.topics() if t.poses]
        raise UsageError(
            f"`pose_topic` {topic}: found no poses; topics with poses: {', '.join(there) or 'none'}"
        )
    frames = sorted(
        {(bare(poses.parent), bare(poses.child)) for poses in told if len(poses.stamps)}
    )
    if len(frames) > 1:
        found = ", ".join(f"of {child or 'no frame'!r} in {parent!r}" for parent, child in frames)
        raise InputError(
            f"`pose_topic` {topic}: tells poses {found}; expected those of one frame in one other"
        )
    track = PoseTrack(
        stamps,
        np.concatenate([poses.translations for poses in told]),
        np.concatenate([poses.quaternions for poses in told]),
    )
    return Track(*frames[0], track)


def mount(tree: TransformTree, mounting: Mounting, sources: Sequence[Source]) -> list[str]:
    """Hang the sensors where the user says that they are mounted; say where that is."""
    body = body_of(tree)
    notes = []
    for frame in sorted({bare(source.frame_id) for source in sources}):
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
        tree.add_static(
            body, frame, np.array(mounting.translation), np.array(mounting.rotation, dtype=float)
        )
        notes.append(f"`extrinsic`: {frame!r} is taken as mounted on {body!r}")
    return notes


def body_of(tree: TransformTree) -> str | None:
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


def map_frame(
    sources: Sequence[Source], declared: str | None, tree: TransformTree, track: Track | None
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
            with named(source.label):
                above = world_above(tree, frame)
            if above is None:
                raise InputError(
                    f"{source.label}: the clouds are in the frame {frame!r}, expected a world "
                    f"frame ({', '.join(WORLD_FRAMES)}); {_ways_out(source, frame, tree)}"
                )
            return above
    return "map"


def is_world(frame: str) -> bool:
    """Tell by its name whether a frame stands still."""
    return bare(frame).rpartition("/")[2] in WORLD_FRAMES


def world_above(tree: TransformTree, frame: str) -> str | None:
    """Return the frame above another that stands still; None where there is none.

    It is the topmost with the name of a world frame, or the root where something moves below it:
    a root that all hangs below unmoved is a part of the craft.
    """
    above = tree.ancestors(frame)[1:]
    worlds = [parent for parent in above if is_world(parent)]
    if worlds:
        return worlds[-1]
    return above[-1] if above and tree.moves(frame) else None


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


def _ways_out(source: Source, frame: str, tree: TransformTree) -> str:
    """Say what the user can do about clouds in a sensor's frame."""
    root = tree.ancestors(frame)[-1]
    tell = f"the transforms lead to {root!r} only" if root != frame else "no transforms lead on"
    ways = [f"`pose_topic` {t.name} moves them with the craft" for t in source.topics() if t.poses]
    return "; ".join([tell, *ways[:2], f"where {root!r} stands still, `frame` {root} says so"])


@contextmanager
def named(what: str) -> Iterator[None]:
    """Let errors of the tree say whose frames they are about."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{what}: {error}") from error
