"""Batches of keyframes, and their points, which are all that the pipeline sees of keyframes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from mlscli.keyframes.keyframe import Keyframe
from mlscli.runtime.arrays import Bool, Float32, Float64, Int32, Int64

# So far, at most, is a craft from a point in one axis.
FARTHEST = 1e30


class Points(NamedTuple):
    """Points on their way through the pipeline.

    Attributes
    ----------
    xyz : float64 (N, 3)
        Coordinates in the map frame.
    keyframe : int32 (N,)
        The number of each point's keyframe: its row in the map's route.
    sight : float32 (N, 3)
        From the craft to each point, as it was recorded; NaN where the craft's position is not
        known.
    noise : float32 (N,)
        Variance of the error of each height, in the square of the unit; NaN where it is not known,
        as with all points that no stage has looked at.
    """

    xyz: Float64
    keyframe: Int32
    sight: Float32
    noise: Float32

    @classmethod
    def of(cls, xyz: Float64, keyframe: Int32, position: Float64 | None = None) -> Points:
        """Return points (N, 3) seen from positions (N, 3), or from where is not known."""
        noise = np.full(len(xyz), np.nan, dtype=np.float32)
        if position is None:
            return cls(xyz, keyframe, np.full(xyz.shape, np.nan, dtype=np.float32), noise)
        sight = xyz - position
        # What float32 cannot hold is no place of a craft.
        sight[np.abs(sight) > FARTHEST] = np.nan
        return cls(xyz, keyframe, sight.astype(np.float32), noise)

    @property
    def size(self) -> int:
        """The number of points."""
        return len(self.xyz)

    def take(self, which: Bool | Int64 | slice) -> Points:
        """Return the points that a mask, indices or a slice select."""
        return Points(self.xyz[which], self.keyframe[which], self.sight[which], self.noise[which])


class Batch(NamedTuple):
    """Successive keyframes.

    Attributes
    ----------
    points : Points
        The points of all keyframes of the batch.
    route : float64 (K, 4)
        Time (s), x, y, z of the craft, a row for each keyframe of the batch; NaN where not known.
    """

    points: Points
    route: Float64


def gather(keyframes: Iterable[Keyframe], first: int = 0) -> Batch:
    """Return a batch of keyframes, numbered from `first` in the order given."""
    clouds, route = [], []
    for keyframe in keyframes:
        clouds.append(keyframe.points)
        route.append((keyframe.stamp, *keyframe.position))
    numbers = np.arange(first, first + len(clouds), dtype=np.int32)
    sizes = [len(cloud) for cloud in clouds]
    xyz = clouds[0] if len(clouds) == 1 else np.concatenate([np.empty((0, 3)), *clouds])
    whole = np.array(route, dtype=np.float64).reshape(-1, 4)
    # Where no position is known, none takes memory.
    is_known = bool(np.isfinite(whole[:, 1:]).any())
    positions = np.repeat(whole[:, 1:], sizes, axis=0) if is_known else None
    points = Points.of(np.ascontiguousarray(xyz), np.repeat(numbers, sizes), positions)
    return Batch(points, whole)


def batches(keyframes: Iterable[Keyframe], min_points: int) -> Iterator[Batch]:
    """Yield batches of successive keyframes, each as soon as it has at least `min_points` points.

    The last batch takes the keyframes that are left, so that no point is lost. (Thesis, section
    4.1: the minimum size of published point clouds.)
    """
    waiting: list[Keyframe] = []
    size = first = 0
    for keyframe in keyframes:
        waiting.append(keyframe)
        size += len(keyframe.points)
        if size >= min_points:
            yield gather(waiting, first)
            first += len(waiting)
            waiting, size = [], 0
    if waiting:
        yield gather(waiting, first)
