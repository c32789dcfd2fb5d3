"""The tree of frames that /tf and /tf_static define.

Each frame but the root has a parent, in which its pose is known over time (see `PoseTrack`) or at
all times. A frame may change its parent. As in tf2, the parent at any time is then that of the last
transform before it, and between transforms of different parents the earlier one holds.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from mlscli.errors import InputError
from mlscli.geometry.poses import Poses, PoseTrack, are_poses, identity, unit, unknown
from mlscli.runtime.arrays import Bool, Float64


class Link(NamedTuple):
    """A frame and one of the parents that it has over time.

    Attributes
    ----------
    parent, child : str
        Names of the frames.
    moves : bool
        Whether the child has transforms over time, rather than a static one.
    """

    parent: str
    child: str
    moves: bool


class TransformTree:
    """Frames and the transforms between them, added in any order.

    Slashes at the beginning of a frame's name are ignored. Of several static transforms of a frame
    the last one added counts, and none where the frame has transforms over time.
    """

    def __init__(self) -> None:
        self._moving: dict[str, _Moving] = {}
        self._static: dict[str, _Static] = {}
        self._routes: dict[tuple[str, str], _Route] = {}

    def add(
        self, parent: str, child: str, stamps: Float64, translations: Float64, rotations: Float64
    ) -> None:
        """Add T_parent_child over time.

        Transforms with numbers that are not finite or a quaternion of length 0 are ignored, and all
        where a frame has no name or is its own parent.

        Parameters
        ----------
        parent, child : str
            Names of the frames.
        stamps : float64 (N,)
            Seconds, in any order. Of equal ones the last one added counts.
        translations : float64 (N, 3)
            In the unit of the recording.
        rotations : float64 (N, 4)
            Quaternions x y z w of any length but 0.
        """
        parent, child = bare(parent), bare(child)
        usable = are_poses(stamps, translations, rotations) & _may_hang(parent, child)
        if usable.any():
            moving = self._moving.setdefault(child, _Moving())
            moving.add(parent, stamps[usable], translations[usable], rotations[usable])
            self._routes.clear()

    def add_static(self, parent: str, child: str, translation: Float64, rotation: Float64) -> None:
        """Add T_parent_child for all times: translation (3,), quaternion (4,), as in `add`."""
        parent, child = bare(parent), bare(child)
        translations, rotations = translation.reshape(1, 3), rotation.reshape(1, 4)
        if (are_poses(np.zeros(1), translations, rotations) & _may_hang(parent, child)).all():
            poses = Poses(translations, unit(rotations), np.array([True]))
            self._static[child] = _Static(parent, poses)
            self._routes.clear()

    @property
    def frames(self) -> list[str]:
        """All frames, by name."""
        children = {*self._moving, *self._static}
        return sorted(children.union(*map(self._parents, children)))

    @property
    def links(self) -> list[Link]:
        """All frames with each of their parents, by name."""
        children = sorted({*self._moving, *self._static})
        return [Link(p, c, c in self._moving) for c in children for p in self._parents(c)]

    def ancestors(self, frame: str) -> list[str]:
        """Return a frame, its parent, and so on up to the root, by the latest transforms.

        Raises
        ------
        InputError
            Where the frames form a cycle.
        """
        return self._upwards(bare(frame), {})

    def moves(self, frame: str) -> bool:
        """Return whether a frame or one of its ancestors has transforms over time."""
        return any(above in self._moving for above in self.ancestors(frame))

    def lookup(self, target: str, source: str, stamps: Float64) -> Poses:
        """Return T_target_source at each of these times.

        It is known where all transforms between the frames are: static ones at all times, even
        at NaN, the others as in `PoseTrack`.

        Parameters
        ----------
        target, source : str
            Names of the frames.
        stamps : float64 (M,)
            Seconds.

        Raises
        ------
        InputError
            Where the transform is known at none of these times, and at some of them the frames are
            not connected or form a cycle.
        """
        target, source = bare(target), bare(source)
        if target == source:
            return identity(len(stamps))
        changing = self._changing
        if not changing:
            return self._along(self._route(target, source), stamps)
        poses, faults = unknown(len(stamps)), []
        for rows, parents in self._periods(changing, stamps):
            try:
                route = self._find_route(target, source, parents)
            except InputError as fault:
                faults.append(fault)
                continue
            for whole, part in zip(poses, self._along(route, stamps[rows]), strict=True):
                whole[rows] = part
        if faults and not poses.known.any():
            raise faults[0]
        return poses

    def check_way(self, target: str, source: str) -> None:
        """Raise an error if two frames are connected at no time.

        Raises
        ------
        InputError
            Where the frames are not connected, or form a cycle, at all times.
        """
        target, source = bare(target), bare(source)
        changing = self._changing
        if target == source:
            return
        if not changing:
            self._route(target, source)
            return
        # Parents change at these times, and at no others.
        stamps = np.concatenate([self._moving[child].track.stamps for child in changing])
        faults = []
        for _, parents in self._periods(changing, stamps):
            try:
                self._find_route(target, source, parents)
            except InputError as fault:
                faults.append(fault)
            else:
                return
        raise faults[0]

    @property
    def _changing(self) -> list[str]:
        """The frames with several parents over time."""
        return [child for child, moving in self._moving.items() if len(moving.parents) > 1]

    def _parents(self, child: str) -> list[str]:
        """Return the parents that a frame has over time; none for the root."""
        if child in self._moving:
            return self._moving[child].parents
        return [self._static[child].parent] if child in self._static else []

    def _periods(
        self, changing: Sequence[str], stamps: Float64
    ) -> Iterator[tuple[Bool, dict[str, str]]]:
        """Yield times with the same parents, as a mask (M,), and these parents by child."""
        series = np.stack([self._moving[child].track.series_at(stamps) for child in changing], 1)
        kept, period = np.unique(series, axis=0, return_inverse=True)
        for number, numbers in enumerate(kept.tolist()):
            parents = {
                child: self._moving[child].parents[place]
                for child, place in zip(changing, numbers, strict=True)
            }
            yield period.ravel() == number, parents

    def _upwards(self, frame: str, parents: Mapping[str, str]) -> list[str]:
        """Return a frame and its ancestors; of several parents, that in `parents` or the last."""
        chain = [frame]
        while above := self._parents(chain[-1]):
            parent = parents.get(chain[-1]) or above[0]
            if len(above) > 1 and chain[-1] not in parents:
                parent = self._moving[chain[-1]].last_parent
            if parent in chain:
                circle = " below ".join(map(repr, [*chain[chain.index(parent) :], parent]))
                raise InputError(f"the frames hang in a circle, {circle}; expected a tree")
            chain.append(parent)
        return chain

    def _route(self, target: str, source: str) -> _Route:
        """Return the route between two frames of a tree in which no frame changes its parent."""
        if (target, source) not in self._routes:
            self._routes[target, source] = self._find_route(target, source, {})
        return self._routes[target, source]

    def _find_route(self, target: str, source: str, parents: Mapping[str, str]) -> _Route:
        """Return the route between two frames, by `parents` where these change.

        Raises
        ------
        InputError
            Where the frames are not connected, or form a cycle.
        """
        chain_target, chain_source = self._upwards(target, parents), self._upwards(source, parents)
        meeting = next((frame for frame in chain_source if frame in chain_target), None)
        if meeting is None:
            raise InputError(
                f"no transform leads from the frame {source!r} to {target!r}: "
                f"{self._company(source)}; {self._company(target)}"
            )
        return _Route(
            chain_target[: chain_target.index(meeting)], chain_source[: chain_source.index(meeting)]
        )

    def _company(self, frame: str) -> str:
        """Return a text that says which frames a frame is connected with."""
        members, fresh = {frame}, [frame]
        links = [(child, parent) for child in self.frames for parent in self._parents(child)]
        while fresh:
            here = fresh.pop()
            near = {b for link in links for a, b in (link, link[::-1]) if a == here} - members
            members |= near
            fresh += near
        others = sorted(members - {frame})
        return f"{frame!r} is connected with {', '.join(map(repr, others)) or 'nothing'}"

    def _along(self, route: _Route, stamps: Float64) -> Poses:
        """Return T_target_source along a route."""
        poses = self._climb(route.above_source, stamps)
        if route.above_target:
            poses = self._climb(route.above_target, stamps).inverse.chained(poses)
        if len(poses.known) != len(stamps):
            poses = poses.chained(identity(len(stamps)))
        return poses

    def _climb(self, children: Sequence[str], stamps: Float64) -> Poses:
        """Chain the transforms of successive frames to their parents; none: the identity."""
        poses = None
        for child in children:
            moving = self._moving.get(child)
            step = moving.track.at(stamps) if moving else self._static[child].poses
            poses = step if poses is None else step.chained(poses)
        return poses or identity(1)


def bare(frame: str) -> str:
    """Return the name of a frame without surrounding blanks and leading slashes."""
    return frame.strip().lstrip("/")


class _Static(NamedTuple):
    """A frame with a static transform.

    Attributes
    ----------
    parent : str
    poses : Poses
        T_parent_child, a single pose.
    """

    parent: str
    poses: Poses


class _Moving:
    """A frame with transforms over time: its parents, and its poses in the parent of each time."""

    def __init__(self) -> None:
        self.parents: list[str] = []
        self._added: list[tuple[int, Float64, Float64, Float64]] = []
        self._track: PoseTrack | None = None

    def add(self, parent: str, stamps: Float64, translations: Float64, rotations: Float64) -> None:
        if parent not in self.parents:
            self.parents.append(parent)
        self._added.append((self.parents.index(parent), stamps, translations, rotations))
        self._track = None

    @property
    def track(self) -> PoseTrack:
        """All poses over time; the series of a pose is the index of its parent in `parents`."""
        if self._track is None:
            places, stamps, translations, rotations = zip(*self._added, strict=True)
            self._track = PoseTrack(
                np.concatenate(stamps),
                np.concatenate(translations),
                np.concatenate(rotations),
                np.repeat(places, [len(some) for some in stamps]),
            )
        return self._track

    @property
    def last_parent(self) -> str:
        return self.parents[int(self.track.series_at(np.array([np.inf]))[0])]


class _Route(NamedTuple):
    """The frames between two frames and their nearest common ancestor, without that.

    Attributes
    ----------
    above_target, above_source : list of str
        The target or the source itself and its ancestors, upwards; empty where it is the common
        ancestor.
    """

    above_target: list[str]
    above_source: list[str]


def _may_hang(parent: str, child: str) -> bool:
    return bool(parent and child and parent != child)
