"""The last step: least squares of the distances between the surfaces of two maps.

Each point is drawn to the plane through the surface of the other map next to it, as Y. Chen and
G. Medioni have it (*Object modelling by registration of multiple range images*, Image and Vision
Computing 10, 1992), both ways, with the weights of J. W. Tukey against what has no counterpart.
What planes do not settle, as the place along a wall, stays as the evidence has it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from mlscli.aligning.search import Pair
from mlscli.geometry.similarity import Similarity
from mlscli.runtime.arrays import Bool, Float64

_ROUNDS = 20
_NEIGHBOURS = 12
# Points within so many cells are next to each other.
_NEAR = 1.5
# The sigma of where the evidence has led to, in cells; and how many points err as one.
_PRIOR, _ALIKE = 0.5, 16


@dataclass(frozen=True, eq=False)
class _Planes:
    """The planes through the surfaces of a map, at each of its points.

    Attributes
    ----------
    points, middles, normals : float64 (N, 3)
    flat : bool (N,)
        Where the points around lie in a plane.
    """

    points: Float64
    middles: Float64
    normals: Float64
    flat: Bool

    @classmethod
    def of(cls, points: Float64, width: float) -> _Planes:
        tree = KDTree(points)
        many = min(_NEIGHBOURS, len(points))
        away, near = tree.query(points, k=[*range(1, many + 1)], distance_upper_bound=3 * width)
        there = np.isfinite(away)
        around = points[np.where(there, near, 0)]
        number = there.sum(axis=1)
        middles = (around * there[:, :, None]).sum(axis=1) / number[:, None]
        off = (around - middles[:, None]) * there[:, :, None]
        spreads, axes = np.linalg.eigh(np.einsum("nki,nkj->nij", off, off))
        flat = (number >= 5) & (spreads[:, 0] < 0.25 * spreads[:, 1])
        return cls(points, middles, axes[:, :, 0], flat)


def refined(pair: Pair, start: Similarity, width: float, scaled: bool) -> tuple[Similarity, float]:
    """Return the fit of least distances, and the root mean square of those of floors.

    Parameters
    ----------
    pair : Pair
    start : Similarity
        To within a cell.
    width : float
        The wider of the cells of both maps, in the unit of the first.
    scaled : bool
        Whether the scale is to be found, too.
    """
    one, other = _Planes.of(pair.one, width), _Planes.of(pair.other, width / start.scale)
    tree = KDTree(one.points)
    turn = width / (pair.radius * start.scale)
    units = np.array([turn, turn, width, width, width])
    fit, gone, rms = start, np.zeros(5), math.nan
    for _ in range(_ROUNDS):
        rows, off, level = _distances(fit, one, other, tree, width)
        weights = np.zeros(len(off))
        for which in (level, ~level):
            sigma = (
                max(1.4826 * float(np.median(np.abs(off[which]))), 0.02 * width)
                if which.any()
                else 1.0
            )
            share = off[which] / (4 * sigma)
            weights[which] = np.where(np.abs(share) < 1, (1 - share**2) ** 2, 0) / (
                _ALIKE * sigma**2
            )
        used = level & (weights > 0)
        rms = float(np.sqrt(np.mean(off[used] ** 2))) if used.any() else math.nan
        rows = rows * units
        if not scaled:
            rows[:, 1] = 0
        normal = (rows * weights[:, None]).T @ rows + np.eye(5) / _PRIOR**2
        step = np.linalg.solve(normal, (rows * weights[:, None]).T @ off + gone / _PRIOR**2)
        gone -= step
        yaw, scale, x, y, z = (gone * units).tolist()
        shift = (start.shift[0] + x, start.shift[1] + y, start.shift[2] + z)
        fit = Similarity(start.yaw + yaw, start.scale * math.exp(scale if scaled else 0.0), shift)
        if np.abs(step).max() < 1e-4:
            break
    return fit, rms


def _distances(
    fit: Similarity, one: _Planes, other: _Planes, tree: KDTree, width: float
) -> tuple[Float64, Float64, Bool]:
    """Return the signed distances of points to planes next to them, both ways.

    Returns
    -------
    rows : float64 (N, 5)
        How each changes with yaw, the logarithm of the scale, and the shift.
    distances : float64 (N,)
    level : bool (N,)
        Where the plane is more level than upright.
    """
    moved = fit.points(other.points)
    turned = other.normals @ fit.linear.T / fit.scale
    pairs = []
    _, near = tree.query(moved, distance_upper_bound=_NEAR * width)
    which = np.flatnonzero(near < len(one.points))
    which = which[one.flat[near[which]]]
    pairs.append((moved[which], one.middles[near[which]], one.normals[near[which]], 1.0))
    _, near = KDTree(moved).query(one.points, distance_upper_bound=_NEAR * width)
    which = np.flatnonzero(near < len(moved))
    which = which[other.flat[near[which]]]
    middles = fit.points(other.middles)
    pairs.append((one.points[which], middles[near[which]], turned[near[which]], -1.0))
    rows, distances, level = [], [], []
    for points, planes, normals, sign in pairs:
        arm = points - fit.shift
        yaw = normals[:, 1] * arm[:, 0] - normals[:, 0] * arm[:, 1]
        rows.append(np.column_stack((yaw, (normals * arm).sum(axis=1), normals)))
        distances.append(sign * ((points - planes) * normals).sum(axis=1))
        level.append(np.abs(normals[:, 2]) > math.sqrt(0.5))
    return np.concatenate(rows), np.concatenate(distances), np.concatenate(level)
