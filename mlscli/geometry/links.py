"""What is told of one frame over time: static transforms, or poses, and in which parents."""

from __future__ import annotations

import numpy as np

from mlscli.geometry.poses import Pose, Poses, PoseTrack
from mlscli.runtime.arrays import Float64, Int64


class StaticLink:
    """A frame with static transforms: its parents, and its pose in the parent of each time.

    Attributes
    ----------
    parents : list of str
    """

    def __init__(self) -> None:
        self.parents: list[str] = []
        self._begins: list[float] = []
        self._poses: list[tuple[int, Pose]] = []

    def add(self, parent: str, pose: Pose, begin: float) -> bool:
        """Add a pose that counts from a time on; return whether the last one was another."""
        last = self._poses[-1] if self._poses else None
        while self._begins and self._begins[-1] >= begin:
            self._begins.pop()
            self._poses.pop()
        if parent not in self.parents:
            self.parents.append(parent)
        place = self.parents.index(parent)
        is_other = last is not None and not _are_same(last, (place, pose))
        if is_other or not self._poses:
            self._begins.append(begin)
            self._poses.append((place, pose))
            used = sorted({place for place, _ in self._poses})
            self.parents = [self.parents[place] for place in used]
            self._poses = [(used.index(place), pose) for place, pose in self._poses]
        return is_other

    @property
    def changes(self) -> Float64:
        """The times (s) from which the poses count."""
        return np.array(self._begins)

    def at(self, stamps: Float64) -> Poses:
        """Return the pose at each of these times (M,), at NaN the last; a single one for all."""
        rows = self._rows(stamps) if len(self._poses) > 1 else np.zeros(1, dtype=np.int64)
        translations, rotations = zip(*(pose for _, pose in self._poses), strict=True)
        known = np.ones(len(rows), dtype=np.bool_)
        return Poses(np.array(translations)[rows], np.array(rotations)[rows], known)

    def parent_at(self, stamps: Float64) -> Int64:
        """Return the index of the parent at each of these times (M,)."""
        return np.array([place for place, _ in self._poses])[self._rows(stamps)]

    def _rows(self, stamps: Float64) -> Int64:
        return np.maximum(np.searchsorted(self._begins, stamps, side="right") - 1, 0)


def _are_same(one: tuple[int, Pose], other: tuple[int, Pose]) -> bool:
    return one[0] == other[0] and all(map(np.array_equal, one[1], other[1]))


class MovingLink:
    """A frame with transforms over time: its parents, and its poses in the parent of each time.

    Attributes
    ----------
    parents : list of str
    """

    def __init__(self, gap: float | None) -> None:
        self._gap = gap
        self.parents: list[str] = []
        self._added: list[tuple[int, Float64, Float64, Float64]] = []
        self._track: PoseTrack | None = None

    def add(self, parent: str, stamps: Float64, translations: Float64, rotations: Float64) -> None:
        """Add poses in a parent, as in `TransformTree.add`."""
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
                self._gap,
            )
        return self._track

    @property
    def changes(self) -> Float64:
        """Times (s), among them all at which the parent changes."""
        return self.track.stamps

    def at(self, stamps: Float64) -> Poses:
        """Return the pose at each of these times (M,)."""
        return self.track.at(stamps)

    def parent_at(self, stamps: Float64) -> Int64:
        """Return the index of the parent at each of these times (M,)."""
        return self.track.series_at(stamps)
