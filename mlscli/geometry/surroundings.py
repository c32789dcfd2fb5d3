"""What the points around a point form: a sample of a cloud, and planes through it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mlscli.keyframes.keyframe import FARTHEST
from mlscli.runtime.arrays import Float64, UInt64

SAMPLE = 30_000

# The variance across a plane over that along its shorter side: a plane is trusted by
# exp(-thickness / _THICKNESS), which is e^-1 where it is a seventh as thick as wide.
_THICKNESS = 0.02
# Neighbours on a line, such as one sweep of a laser, form no plane.
_THINNEST = 0.03
_AT_ONCE = 4096


class PointSample:
    """A bounded sample of points, whatever their order and however often they come.

    Points are put in the order of a hash of their coordinates, and the first are kept.
    """

    def __init__(self, size: int = SAMPLE) -> None:
        self._size = size
        self._points = np.empty((0, 3))
        self._keys = np.empty(0, dtype=np.uint64)
        self._waiting: list[Float64] = []
        self._unsettled = 0

    def add(self, points: Float64) -> None:
        """Add points (N, 3); those that are no measurement are left out."""
        self._waiting.append(points)
        self._unsettled += len(points)
        if self._unsettled > self._size:
            self._settle()

    @property
    def points(self) -> Float64:
        """The sample (M, 3), in the order of the hash: its beginning is a smaller sample."""
        self._settle()
        return self._points

    def _settle(self) -> None:
        points = np.concatenate([self._points, *self._waiting]) + 0.0
        points = points[(np.abs(points) <= FARTHEST).all(axis=1)]
        self._keys, first = np.unique(_hash(points), return_index=True)
        self._keys, self._points = self._keys[: self._size], points[first[: self._size]]
        self._waiting, self._unsettled = [], 0


class Planes(NamedTuple):
    """The planes through the surroundings of points.

    Attributes
    ----------
    points : float64 (N, 3)
    normals : float64 (N, 3)
        Of length 1; which of the two is not said.
    trust : float64 (N,)
        1 where the surroundings lie in the plane, down to 0 where they form none.
    """

    points: Float64
    normals: Float64
    trust: Float64


def planes(points: Float64, neighbours: int = 16) -> Planes:
    """Fit a plane to so many nearest neighbours of each point, itself among them.

    Parameters
    ----------
    points : float64 (N, 3)
        No point twice.
    """
    from scipy.spatial import cKDTree

    normals, trust, reach = np.empty((len(points), 3)), np.empty(len(points)), np.empty(len(points))
    tree = cKDTree(points)
    ranks = np.arange(1, min(neighbours, len(points)) + 1)
    for begin in range(0, len(points), _AT_ONCE):
        rows = slice(begin, begin + _AT_ONCE)
        distances, near = tree.query(points[rows], k=ranks)
        offsets = points[near] - points[near].mean(axis=1, keepdims=True)
        variances, axes = np.linalg.eigh(np.einsum("nki,nkj->nij", offsets, offsets))
        thickness, width, length = np.maximum(variances.T, 0.0)
        ratio = thickness / np.where(width > 0, width, 1.0)
        trust[rows] = np.where(width > _THINNEST * length, np.exp(-ratio / _THICKNESS), 0.0)
        normals[rows], reach[rows] = axes[:, :, 0], distances[:, -1]
    if len(points):
        trust[reach > 3 * np.median(reach)] = 0.0
    return Planes(points, normals, trust)


def _hash(points: Float64) -> UInt64:
    """Mix the bits of three coordinates (splitmix64, by S. Vigna)."""
    key = np.zeros(len(points), dtype=np.uint64)
    for bits in np.ascontiguousarray(points).view(np.uint64).T:
        key = (key ^ bits) + np.uint64(0x9E3779B97F4A7C15)
        key = (key ^ (key >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        key = (key ^ (key >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        key ^= key >> np.uint64(31)
    return key
