"""The evidence for a vertical: flat surroundings of points, the extent of the cloud, attitudes.

What the points say of a direction, and as much of its opposite, is a product of two:

- flat surfaces are *level* or *plumb*: floors, ground and roofs lie across the vertical, walls
  along it. Floors count twice as much as walls: otherwise all three axes of a room would be
  supported equally;
- the cloud extends little: a flight covers more ground than height.

Attitudes are in `mlscli.geometry.attitudes`.
"""

from __future__ import annotations

import math

import numpy as np

from mlscli.geometry.attitudes import known_of, likelihoods
from mlscli.geometry.surroundings import Planes, all_planes, dense
from mlscli.keyframes.keyframe import Axes
from mlscli.runtime.arrays import Float64

# Surroundings of growing size: how many neighbours, and among which part of the points (one in so
# many). They grow until those of enough points are flat; in a noisy cloud, small ones are not.
_SURROUNDINGS = ((16, 1), (32, 1), (64, 1), (128, 1), (128, 4), (128, 16))
# Sums of trust: the first is enough, and less than the second is too little.
_ENOUGH = 50.0
FEWEST = 10.0
# The points whose extent is measured, at most, and the most that a small extent counts: less where
# it is known how cameras were held, so that no facade passes for ground as it is thin.
_POINTS = 2000
_FLATTEST, _FLATTEST_SEEN = 20.0, 4.0
# The share of the trust with which an axis holds its own.
_HOLD = 0.05
# Directions to which normals are rounded, and those whose extents are compared.
_NORMALS, _EXTENTS = 2000, 200


class Evidence:
    """What points and attitudes say about the vertical.

    Parameters
    ----------
    points : float64 (N, 3)
        A `PointSample` of the cloud: finite, no point twice.
    attitudes : float64 (K, 4), optional
        Quaternions x y z w from the axes of the craft, or of its camera, to the frame of the
        points; NaN where not known.
    axes : {"camera", "body", "unknown"}
        Which axes these are.

    Attributes
    ----------
    surfaces : Planes
        Through the smallest surroundings of which enough are flat, those that are dense.
    all_surfaces : Planes
        The same with those that were hardly seen.
    trusted : float
        The trust in them in all; with less than `FEWEST` they say nothing.
    has_attitudes : bool
        Whether any attitude is known.
    """

    def __init__(
        self, points: Float64, attitudes: Float64 | None = None, axes: Axes = "unknown"
    ) -> None:
        from mlscli.runtime.tree import Tree

        self._attitudes, self._axes = attitudes, axes
        self.has_attitudes = bool(known_of(attitudes).any())
        is_seen = self.has_attitudes and axes != "unknown"
        self._flattest = _FLATTEST_SEEN if is_seen else _FLATTEST
        self._points = points[:_POINTS]
        self.all_surfaces = _surfaces(points)
        self.surfaces = dense(self.all_surfaces)
        self.trusted = float(self.surfaces.trust.sum())
        self._normals = half_sphere(_NORMALS)
        self._votes = np.zeros(_NORMALS)
        if self.trusted >= FEWEST:
            both = np.concatenate((self._normals, -self._normals))
            nearest = Tree(both).nearest(self.surfaces.normals, 1)[1][:, 0]
            votes = np.bincount(nearest % _NORMALS, self.surfaces.trust, _NORMALS)
            self._votes = votes / self.trusted
            self._usual = float(np.median(self._extent(half_sphere(_EXTENTS))))

    def of_points(self, directions: Float64) -> Float64:
        """Return the natural logarithm of what the points say of directions (D, 3)."""
        if self.trusted < FEWEST:
            return np.zeros(len(directions))
        along = np.abs(dots(directions, self._normals))
        # Ground and roofs may slope: they count in full up to 15 degrees, and less up to 45.
        fit = dots(level(along, 15, 45) + plumb(along, 0, 15) / 2, self._votes)
        return np.asarray(np.log(np.maximum(fit, 1e-3) * self.flatness(directions)))

    def flatness(self, directions: Float64) -> Float64:
        """Return the cloud's usual extent over that along each direction (D, 3), up to a limit."""
        extent = self._extent(directions)
        return np.asarray(self._usual / np.maximum(extent, self._usual / self._flattest))

    def of_attitudes(self, directions: Float64) -> Float64:
        """Return the natural logarithm of what the attitudes say of directions (D, 3)."""
        return likelihoods(self._attitudes, self._axes, directions)

    def shares(self, axis: Float64, within: float = 15.0) -> tuple[float, float]:
        """Return the shares of planes, weighted by trust, level and plumb within some degrees."""
        along, trust = np.abs(dots(self.surfaces.normals, axis)), self.surfaces.trust
        both = (float((trust * which(along, within, within)).sum()) for which in (level, plumb))
        of_level, of_plumb = (share / (self.trusted or 1.0) for share in both)
        return of_level, of_plumb

    def fitted(self, axis: Float64) -> Float64:
        """Return the axis (3,) near this one that best fits the normals of level and plumb planes.

        Where only attitudes speak, it is the one for which they speak most.
        """
        if self.trusted < FEWEST:
            return self.climbed(axis)
        normals, trust = self.surfaces.normals, self.surfaces.trust
        for _ in range(20):
            along = np.abs(dots(normals, axis))
            weight = trust * (level(along, 0, 25) - plumb(along, 0, 15))
            # Walls of one direction fit to many axes: the one that there is holds its own.
            held = _HOLD * self.trusted * np.outer(axis, axis)
            tensor = np.einsum("n,ni,nj->ij", weight, normals, normals) + held
            found = np.linalg.eigh(tensor)[1][:, 2]
            axis = found if found @ axis > 0 else -found
        return axis

    def climbed(self, axis: Float64) -> Float64:
        """Return the direction (3,) near this one for which most speaks, by smaller steps."""
        for degrees in (4.0, 1.5, 0.5):
            near = around(axis, degrees)
            axis = near[int((self.of_points(near) + self.of_attitudes(near)).argmax())]
        return axis

    def _extent(self, directions: Float64) -> Float64:
        low, high = np.percentile(dots(directions, self._points), [10, 90], axis=1)
        return np.asarray(high - low)


def _surfaces(points: Float64) -> Planes:
    """Return the planes through the smallest surroundings of which enough are dense and flat."""
    best, most = all_planes(points[:0]), -1.0
    for neighbours, part in _SURROUNDINGS:
        some = points[: len(points) // part]
        if part > 1 and len(some) < 4 * neighbours:
            break
        found = all_planes(some, neighbours)
        trusted = float(dense(found).trust.sum())
        if trusted > most:
            best, most = found, trusted
        if most >= _ENOUGH:
            break
    return best


def half_sphere(count: int) -> Float64:
    """Return unit vectors (count, 3) spread evenly over a half sphere, along a spiral."""
    z = (np.arange(count) + 0.5) / count
    turn = np.arange(count) * (math.pi * (3 - math.sqrt(5)))
    radius = np.sqrt(1 - z * z)
    return np.column_stack((radius * np.cos(turn), radius * np.sin(turn), z))


def around(axis: Float64, degrees: float) -> Float64:
    """Return unit vectors (64, 3) within so many degrees of an axis, itself the first of them."""
    turn = np.arange(64) * (math.pi * (3 - math.sqrt(5)))
    radius = math.tan(math.radians(degrees)) * np.sqrt(np.arange(64) / 64)
    sides = np.column_stack((radius * np.cos(turn), radius * np.sin(turn)))
    near = axis + dots(sides, np.linalg.svd(axis[np.newaxis])[2][1:].T)
    return np.asarray(near / np.linalg.norm(near, axis=1, keepdims=True))


def dots(vectors: Float64, others: Float64) -> Float64:
    """Return the dot products of vectors (N, 3) with one (3,) or several (M, 3), without BLAS."""
    return np.asarray(np.einsum("ni,...i->n...", vectors, others))


def level(along: Float64, full: float, none: float) -> Float64:
    """Return weights of planes by how level they are: 1 up to `full` degrees, 0 from `none` on.

    `along` is the cosine of the angle between the normal and the vertical, 0 to 1.
    """
    return ramp(along, math.cos(math.radians(none)), math.cos(math.radians(full)))


def plumb(along: Float64, full: float, none: float) -> Float64:
    """Return weights of planes by how plumb they are, as `level`."""
    return ramp(-along, -math.sin(math.radians(none)), -math.sin(math.radians(full)))


def ramp(values: Float64, zero: float, one: float) -> Float64:
    """Return a linear ramp from 0 at `zero` to 1 at `one`, or a step where these are equal."""
    if zero == one:
        return np.asarray(values >= one, dtype=np.float64)
    return np.asarray(np.clip((values - zero) / (one - zero), 0.0, 1.0))
