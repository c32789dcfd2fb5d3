"""The tree of frames that /tf and /tf_static define.

Each frame but the root has a parent, in which its pose is known over time (see `PoseTrack`) or at
all times. A frame may change its parent. As in tf2, the parent at any time is then that of the last
transform before it, and between transforms of different parents the earlier one holds.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from mlscli.errors import InputError
from mlscli.geometry.links import MovingLink, StaticLink
from mlscli.geometry.poses import Poses, are_poses, identity, unit, unknown
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

    Slashes at the beginning of a frame's name are ignored. Each static transform of a frame counts
    from its beginning until that of the next, and the first before that, too; none counts where the
    frame has transforms over time.

    Parameters
    ----------
    gap : float, optional
        Nothing is interpolated across so many seconds, see `PoseTrack`.
    """

    def __init__(self, gap: float | None = None) -> None:
        self._gap = gap
        self._moving: dict[str, MovingLink] = {}
        self._static: dict[str, StaticLink] = {}
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
            moving = self._moving.setdefault(child, MovingLink(self._gap))
            moving.add(parent, stamps[usable], translations[usable], rotations[usable])
            self._routes.clear()

    def add_static(
        self,
        parent: str,
        child: str,
        translation: Float64,
        rotation: Float64,
        begin: float = -math.inf,
    ) -> bool:
        """Add T_parent_child that stays from a time `begin` (s) on, as in `add`.

        Those added before that begin at the same time or later no longer count.

        Parameters
        ----------
        translation : float64 (3,)
        rotation : float64 (4,)

        Returns
        -------
        bool
            Whether it is another than the one before it; False where there is none before it.
        """
        parent, child = bare(parent), bare(child)
        translations, rotations = translation.reshape(1, 3), rotation.reshape(1, 4)
        if not (are_poses(np.zeros(1), translations, rotations) & _may_hang(parent, child)).all():
            return False
        self._routes.clear()
        pose = Poses(translations, unit(rotations), np.array([True])).pose(0)
        return self._static.setdefault(child, StaticLink()).add(parent, pose, begin)

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

    def leaves(self) -> list[str]:
        """Return the frames that are above no other, by the latest transforms and by name.

        Raises
        ------
        InputError
            Where the frames form a cycle.
        """
        known, above, frames = set[str](), set[str](), self.frames
        for frame in frames:
            chain = self._upwards(frame, {}, known)
            known.update(chain)
            above.update(chain[1:])
        return [frame for frame in frames if frame not in above]

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

    def in_gap(self, target: str, source: str, stamp: float) -> bool:
        """Return whether T_target_source is not known at a time for a gap in its transforms."""
        times = np.array([stamp])
        chains = [self._chain_at(bare(frame), times) for frame in (target, source)]
        links = [self._moving.get(child) for chain in chains for child in chain]
        return any(link.track.in_gap(times)[0] for link in links if link)

    def _chain_at(self, frame: str, times: Float64) -> list[str]:
        """Return a frame and its ancestors at a time (1,); none where they form a cycle."""
        changing, parents = self._changing, dict[str, str]()
        if changing:
            ((_, parents),) = self._periods(changing, times)
        try:
            return self._upwards(frame, parents)
        except InputError:
            return []

    def between(self, target: str, source: str) -> list[str]:
        """Return the frames whose transforms lead from one to another, by the latest transforms.

        None where the frames are not connected, or form a cycle.
        """
        try:
            route = self._find_route(bare(target), bare(source), {})
        except InputError:
            return []
        return [*route.above_target, *route.above_source]

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
        stamps = np.concatenate([self._links[child].changes for child in changing])
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
        return [child for child, link in self._links.items() if len(link.parents) > 1]

    def in_turn(self) -> dict[str, list[str]]:
        """Return the frames that go to and fro between parents, each with these, by name."""
        moving = sorted(set(self._changing) & set(self._moving))
        return {child: self._links[child].parents for child in moving if self._switches(child) > 3}

    def _switches(self, child: str) -> int:
        track = self._moving[child].track
        return int(np.count_nonzero(np.diff(track.series_at(track.stamps))))

    @property
    def _links(self) -> Mapping[str, MovingLink | StaticLink]:
        """What is told of each frame but the root."""
        return self._static | self._moving

    def _link(self, child: str) -> MovingLink | StaticLink | None:
        return self._moving.get(child) or self._static.get(child)

    def _parents(self, child: str) -> list[str]:
        """Return the parents that a frame has over time; none for the root."""
        link = self._link(child)
        return link.parents if link else []

    def _periods(
        self, changing: Sequence[str], stamps: Float64
    ) -> Iterator[tuple[Bool, dict[str, str]]]:
        """Yield times with the same parents, as a mask (M,), and these parents by child."""
        links = self._links
        series = np.stack([links[child].parent_at(stamps) for child in changing], 1)
        kept, period = np.unique(series, axis=0, return_inverse=True)
        for number, numbers in enumerate(kept.tolist()):
            parents = {
                child: links[child].parents[place]
                for child, place in zip(changing, numbers, strict=True)
            }
            yield period.ravel() == number, parents

    def _upwards(
        self, frame: str, parents: Mapping[str, str], known: Collection[str] = ()
    ) -> list[str]:
        """Return a frame and its ancestors; of several parents, that in `parents` or the last.

        It ends, too, with the first frame that is `known`.
        """
        chain, passed = [frame], {frame}
        while chain[-1] not in known and (above := self._parents(chain[-1])):
            parent = parents.get(chain[-1]) or above[0]
            if len(above) > 1 and chain[-1] not in parents:
                (last,) = self._links[chain[-1]].parent_at(np.array([np.inf]))
                parent = above[last]
            if parent in passed:
                circle = " below ".join(map(repr, [*chain[chain.index(parent) :], parent]))
                raise InputError(f"the frames hang in a circle, {circle}; expected a tree")
            chain.append(parent)
            passed.add(parent)
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
            link = self._moving.get(child) or self._static[child]
            step = link.at(stamps)
            poses = step if poses is None else step.chained(poses)
        return poses or identity(1)


@lru_cache(maxsize=4096)
def bare(frame: str) -> str:
    """Return the name of a frame without surrounding blanks and leading slashes."""
    return frame.strip().lstrip("/")


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
