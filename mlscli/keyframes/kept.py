"""The points of a recording, kept so that its map can be built again, with others."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple

import numpy as np

from mlscli.keyframes.keyframe import Keyframe
from mlscli.runtime.arrays import Float64, Int64


class KeptPoints(NamedTuple):
    """The points of all keyframes, as they were given to a builder.

    Attributes
    ----------
    xyz : float64 (N, 3)
        In the map frame, one keyframe after the other.
    sizes : int64 (K,)
        How many points each keyframe has; it is a row of the map's route.
    read : int
        How many points were read, also those dropped before.
    dropped : mapping of str to int
        How many of them were dropped before, by reason.
    """

    xyz: Float64
    sizes: Int64
    read: int
    dropped: Mapping[str, int]

    def keyframes(self, route: Float64) -> Iterator[Keyframe]:
        """Yield the keyframes; `route` (K, 4) has their times and where the craft was."""
        ends = np.cumsum(self.sizes)
        for (stamp, x, y, z), begin, end in zip(
            route.tolist(), (ends - self.sizes).tolist(), ends.tolist(), strict=True
        ):
            yield Keyframe(self.xyz[begin:end], stamp, (x, y, z))

    def followed_by(self, other: KeptPoints) -> KeptPoints:
        """Return the points of a recording and those of the next."""
        reasons = self.dropped.keys() | other.dropped.keys()
        return KeptPoints(
            np.concatenate((self.xyz, other.xyz)),
            np.concatenate((self.sizes, other.sizes)),
            self.read + other.read,
            {name: self.dropped.get(name, 0) + other.dropped.get(name, 0) for name in reasons},
        )


class PointKeeper:
    """Keeps the points of keyframes that pass."""

    def __init__(self) -> None:
        self._clouds = [np.empty((0, 3))]

    def watch(self, keyframes: Iterable[Keyframe]) -> Iterator[Keyframe]:
        """Yield keyframes, and keep their points."""
        for keyframe in keyframes:
            self._clouds.append(keyframe.points)
            yield keyframe

    def kept(self, read: int, dropped: Mapping[str, int]) -> KeptPoints:
        """Return what has passed; see `KeptPoints` for the counts."""
        sizes = np.array([len(cloud) for cloud in self._clouds[1:]], dtype=np.int64)
        return KeptPoints(np.concatenate(self._clouds), sizes, read, dict(dropped))
