"""A sample of a cloud, and planes fitted to the surroundings of its points."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from mlscli.geometry.splitmix import mixed
from mlscli.parameters.lengths import FARTHEST
from mlscli.runtime.arrays import Float64, UInt64
from mlscli.runtime.threads import in_ranges

SAMPLE = 30_000

# A plane is trusted by exp(-ratio / _THICKNESS), where the ratio is that of the variances across
# the plane and along its shorter side: e^-1 where it is a seventh as thick as wide.
_THICKNESS = 0.02
# Least ratio of the variances along the shorter and the longer side: neighbours on a line, such as
# one sweep of a laser, form no plane.
_THINNEST = 0.03
# Of so many rows a kernel mixes the bits, in a third of numpy's time; of fewer it is not loaded.
_MANY = 4096
# How many points a sample looks at together, at most.
_BLOCK = 32_768


class PointSample:
    """A bounded sample of distinct points; neither their order nor repetitions change it.

    Points are sorted by a hash of their coordinates, and the first `size` are kept.

    Parameters
    ----------
    size : int
        The most points that are kept.
    """

    def __init__(self, size: int = SAMPLE) -> None:
        self._size = size
        # Copies of points that were not looked at; points of low hashes; the hashes of these.
        self._waiting: list[Float64] = []
        self._low: list[Float64] = [np.empty((0, 3))]
        self._keys: list[UInt64] = [np.empty(0, dtype=np.uint64)]
        self._below = np.uint64(2**64 - 1)

    def add(self, points: Float64) -> None:
        """Add points, float64 (N, 3), without those that are not finite or beyond `FARTHEST`."""
        for begin in range(0, len(points), _BLOCK):
            some = points[begin : begin + _BLOCK]
            if len(some) + sum(map(len, self._waiting)) < _BLOCK // 2:
                self._waiting.append(some.copy())
            else:
                self._look(some)

    @property
    def points(self) -> Float64:
        """The sample, float64 (M, 3), sorted by hash: its first points are a smaller sample."""
        self._look(np.empty((0, 3)))
        self._settle()
        return self._low[0]

    def _look(self, points: Float64) -> None:
        """Put points and those that wait to the others, if their hashes are low enough."""
        if self._waiting:
            points, self._waiting = np.concatenate([*self._waiting, points]), []
        keys = hashed(points.T)
        low = np.flatnonzero(keys <= self._below)
        points, keys = points[low] + 0.0, keys[low]
        near = (np.abs(points) <= FARTHEST).all(axis=1)
        self._low.append(points[near])
        self._keys.append(keys[near])
        if sum(map(len, self._keys)) > 2 * self._size:
            self._settle()

    def _settle(self) -> None:
        """Keep the points of the lowest hashes."""
        keys, first = np.unique(np.concatenate(self._keys), return_index=True)
        self._keys = [keys[: self._size]]
        self._low = [np.concatenate(self._low)[first[: self._size]]]
        if len(keys) >= self._size:
            # The sample is full: from now on, only points of a lower hash come into it.
            self._below = keys[self._size - 1]


class Planes(NamedTuple):
    """The planes through the surroundings of points.

    Attributes
    ----------
    points : float64 (N, 3)
        Coordinates, in the unit of the recording.
    middles : float64 (N, 3)
        The means of the surroundings, which the planes run through.
    normals : float64 (N, 3)
        Unit normals, to either side of the plane.
    trust : float64 (N,)
        From 1, where the surroundings lie in the plane, down to 0, where they form no plane.
    variances : float64 (N, 3)
        Of the surroundings along the normal, then along the shorter and the longer side of the
        plane, in the square of the unit.
    reach : float64 (N,)
        Distance of the farthest neighbour, in the unit of the recording.
    """

    points: Float64
    middles: Float64
    normals: Float64
    trust: Float64
    variances: Float64
    reach: Float64


def planes(points: Float64, neighbours: int = 16) -> Planes:
    """Fit a plane to the nearest neighbours of each point.

    A plane is not trusted where these reach more than three times as far as the median.
    Parameters are those of `all_planes`.
    """
    return dense(all_planes(points, neighbours))


def dense(found: Planes) -> Planes:
    """Return planes without trust where neighbours reach three times as far as the median."""
    if not len(found.reach):
        return found
    is_sparse = found.reach > 3 * np.median(found.reach)
    return found._replace(trust=np.where(is_sparse, 0.0, found.trust))


def all_planes(points: Float64, neighbours: int = 16) -> Planes:
    """Fit a plane to the nearest neighbours of each point, however far away these are.

    Parameters
    ----------
    points : float64 (N, 3)
        No point twice.
    neighbours : int
        How many neighbours, the point itself among them.
    """
    from mlscli.runtime.tree import Tree

    middles, normals, variances = (np.empty((len(points), 3)) for _ in range(3))
    trust, reach = np.empty(len(points)), np.empty(len(points))
    tree = Tree(points)
    count = min(neighbours, len(points))

    def fit(begin: int, end: int) -> None:
        # In the order of the tree, the points of a range lie close together: that takes half as
        # long.
        rows = tree.rows[begin:end]
        distances, near = tree.nearest(points[rows], count)
        fitted = fit_planes(points[near])
        middles[rows], normals[rows], trust[rows], variances[rows] = fitted
        reach[rows] = distances[:, -1]

    if len(points):
        in_ranges(len(points), fit)
    return Planes(points, middles, normals, trust, variances, reach)


class Fitted(NamedTuple):
    """Planes, each fitted to points.

    Attributes
    ----------
    middles : float64 (N, 3)
        The mean of the points of each plane, which it runs through.
    normals : float64 (N, 3)
        Unit normals, to either side of the plane.
    trust : float64 (N,)
        From 1, where the points lie in the plane, down to 0, where they form no plane.
    variances : float64 (N, 3)
        Of the points along the normal, then along the shorter and the longer side of the plane,
        in the square of the unit of the recording.
    """

    middles: Float64
    normals: Float64
    trust: Float64
    variances: Float64


def fit_planes(around: Float64) -> Fitted:
    """Fit planes to points, float64 (N, K, 3): K for each of N planes."""
    middles = around.mean(axis=1)
    offsets = around - middles[:, None]
    squares, axes = np.linalg.eigh(np.einsum("nki,nkj->nij", offsets, offsets))
    squares = np.maximum(squares, 0.0)
    thickness, width, length = squares.T
    ratio = thickness / np.where(width > 0, width, 1.0)
    trust = np.where(width > _THINNEST * length, np.exp(-ratio / _THICKNESS), 0.0)
    return Fitted(middles, axes[:, :, 0], trust, squares / around.shape[1])


def hashed(columns: Iterable[Float64]) -> UInt64:
    """Return a hash of each row, uint64 (N,): bits mixed as in S. Vigna's splitmix64.

    Parameters
    ----------
    columns : iterable of float64 (N,)
        Coordinates, an axis after the other; -0.0 and 0.0 are the same.
    """
    keys = np.empty(0, dtype=np.uint64)
    for axis, column in enumerate(columns):
        # Columns can be long, and computed one by one: none is kept beside the next.
        bits = (column + 0.0).view(np.uint64)
        del column
        if not axis:
            keys = np.zeros(len(bits), dtype=np.uint64)
        if len(bits) < _MANY:
            keys = mixed(keys ^ bits)
        else:
            from mlscli.geometry.mixing import mix

            mix(keys, bits)
        del bits
    return keys
