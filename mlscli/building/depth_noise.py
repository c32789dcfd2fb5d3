"""`rays.noise: auto`: how the depths of a recording err, found from the recording itself.

Seen from one place, the inverse depth of a plane is linear in the direction. So a point whose
inverse depth differs from the linear fit to the points in the directions around it shows how much
inverse depths err, wherever its own depth has come to lie. Errors of triangulation are alike in
inverse depth: their standard deviation is that of a depth of 1.

What bends, and what is rough, differs from the fit as well, the more of it the farther away it is.
So there is a second witness. Points that lie together were often seen from different distances. If
depths err as those of triangulation do, those seen from afar lie farther off the plane through them
all; if errors are the same everywhere, they do not, however rough the surface is.

A laser measures ranges, which do not err so: its keyframes tell nothing.

Nothing depends on which axis is up, nor on the order of the points of a keyframe: points are taken
by the rank of their depths.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from mlscli.keyframes.batches import FARTHEST
from mlscli.keyframes.keyframe import Keyframe
from mlscli.pipeline.report import Report
from mlscli.runtime.arrays import Float64, Int64
from mlscli.runtime.kernels import inner, kernel
from mlscli.runtime.tree import Tree

# Keyframes are taken together until they have so many points, as long as the craft is no farther
# from where it was than this share of the depth in the middle.
_TOGETHER, _APART = 64, 0.2
# Of more points, so many are looked at, and so many are asked.
_MOST_POINTS, _MOST_ASKED = 4096, 128
# One of so many looks counts: of long recordings, from so many on up to twice as many in all.
_LOOKS = 512
# Directions around one, and how many of them the fit follows: wrong correspondences are left out.
_AROUND, _FOLLOWED, _FITS = 12, 9, 4
# The quartile of the absolute values of a standard normal distribution: moved little by the edges
# of surfaces and by wrong correspondences.
_QUARTILE = 0.3186394
# So many depths tell how they err, if some of them are so many times as great as others.
_ENOUGH, _LEAST_SPREAD = 300, 1.5
_PARTS = 10
# Errors grow with such a power of the depth: 2 in truth, less where surfaces bend, never more than
# the last. The second witness is heard so many times as loud, and counts up to so much.
_LEAST_POWER, _MOST_POWER = 1.1, 2.5
_LOUDER, _HEARD = 8.0, 0.1
# For it so many points are kept, or up to twice as many, and so many of them are asked.
_KEPT, _QUESTIONED = 30_000, 1500
# The points that lie together, and how many of them the plane follows.
_TOGETHER_IN_SPACE, _ON_PLANE = 24, 16
# They lie on a surface if they spread less, by this share of the variance along its shorter side;
# those off it by so many times the median do not count.
_FLAT, _OFF = 0.25, 9.0
# Logarithms of less than this share of the median say nothing.
_LEAST_OFF = 0.135


class DepthNoise:
    """Keyframes, as they come, and what they tell about errors of depth."""

    def __init__(self) -> None:
        self._waiting: list[Keyframe] = []
        self._size = 0
        # What looks tell, and one of how many does.
        self._found: list[Float64] = []
        self._looks, self._each = 0, 1
        # One of so many points, with the way from the craft to each.
        self._kept: list[Float64] = []
        self._every = 1
        self._passed = self._room = 0

    def add(self, keyframe: Keyframe) -> None:
        """Take the next keyframe; only triangulated points with a position tell anything."""
        if keyframe.is_ranged or not np.isfinite(keyframe.position).all():
            return
        inside = (np.abs(keyframe.points - keyframe.position) <= FARTHEST).all(axis=1)
        if not inside.any():
            return
        keyframe = replace(keyframe, points=keyframe.points[inside])
        if self._waiting and not self._is_near(keyframe):
            self._look()
        self._waiting.append(keyframe)
        self._size += len(keyframe.points)
        if self._size >= _TOGETHER:
            self._look()

    @property
    def value(self) -> float:
        """The standard deviation of a depth of 1, in the unit of the recording, to two digits.

        It is 0 where errors are not seen to grow with the depth, as those of triangulation do.
        """
        if self._waiting:
            self._look()
        found = np.concatenate([np.empty((0, 2)), *self._found])
        if len(found) < _ENOUGH:
            return 0.0
        error, depth = found[np.argsort(found[:, 1], kind="stable")].T
        parts = np.array_split(np.arange(len(depth)), _PARTS)
        places = np.log([np.median(depth[part]) for part in parts])
        errors = [np.quantile(error[part] * depth[part] ** 2, 0.25) for part in parts]
        if places[-1] - places[0] < np.log(_LEAST_SPREAD) or not min(errors) > 0.0:
            return 0.0
        power = np.polyfit(places, np.log(errors), 1)[0]
        if not power <= _MOST_POWER or power + _LOUDER * self._second < _LEAST_POWER:
            return 0.0
        return float(f"{np.quantile(error, 0.25) / _QUARTILE:.1e}")

    def _is_near(self, keyframe: Keyframe) -> bool:
        first = self._waiting[0]
        depth = np.median(np.linalg.norm(first.points - first.position, axis=1))
        moved = np.subtract(keyframe.position, first.position)
        return bool(np.linalg.norm(moved) <= _APART * depth)

    @property
    def _second(self) -> float:
        """What the second witness says, from -`_HEARD` to `_HEARD`."""
        rows = np.concatenate([np.empty((0, 6)), *self._kept])
        return float(np.clip(_growth_nearby(rows[:, :3], rows[:, 3:]), -_HEARD, _HEARD))

    def _look(self) -> None:
        """Note the errors and depths of the waiting keyframes' points, as seen from the first."""
        points = np.concatenate([keyframe.points for keyframe in self._waiting])
        sights = np.concatenate([each.points - each.position for each in self._waiting])
        rays = points - self._waiting[0].position
        self._waiting, self._size = [], 0
        depth = np.linalg.norm(rays, axis=1)
        order = np.argsort(depth)
        if not np.diff(depth[order]).all():
            # Points of one depth, whatever their order.
            order = np.lexsort((*points.T, depth))
        order = order[depth[order] > 0.0]
        self._keep(points, sights, order)
        order = order[_evenly(len(order), _MOST_POINTS)]
        if len(order) <= _AROUND:
            return
        if self._looks % self._each == 0:
            rays, depth = rays[order], depth[order]
            self._found.append(np.column_stack(_errors(rays / depth[:, None], depth)))
        self._looks += 1
        if len(self._found) == 2 * _LOOKS:
            self._found, self._each = self._found[::2], 2 * self._each

    def _keep(self, points: Float64, sights: Float64, order: Int64) -> None:
        """Keep one of so many points, half of what is kept once it is too much."""
        kept = order[-self._passed % self._every :: self._every]
        self._passed += len(order)
        self._kept.append(np.column_stack((points[kept], sights[kept])))
        self._room += len(kept)
        while self._room > 2 * _KEPT:
            self._kept = [np.concatenate(self._kept)[::2]]
            self._every *= 2
            self._room = len(self._kept[0])


def _evenly(size: int, most: int) -> Int64:
    """Return `most` of `size` ranks, or all, evenly spaced."""
    count = min(size, most)
    return np.arange(count) * size // max(count, 1)


def auto_noise(keyframes: Iterable[Keyframe]) -> float:
    """Return the standard deviation of a depth of 1, which grows with the square of the depth.

    Parameters
    ----------
    keyframes : iterable of Keyframe
        All of a recording, in their order.

    Returns
    -------
    float
        As `DepthNoise.value`.
    """
    noise = DepthNoise()
    for keyframe in keyframes:
        noise.add(keyframe)
    return noise.value


def told(noise: float, report: Report) -> float:
    """Return the noise that was found, and tell the report if there is any."""
    if noise:
        report.sizes["noise"] = f"auto: a depth errs by {noise:g} times its square"
    return noise


def _errors(ahead: Float64, depth: Float64) -> tuple[Float64, Float64]:
    """Return how far inverse depths are from those in the directions around, and the depths.

    Parameters
    ----------
    ahead : float64 (N, 3)
        Directions, as unit vectors.
    depth : float64 (N,)

    Returns
    -------
    errors, depths : float64 (M,)
        Of some of the points.
    """
    asked = _evenly(len(ahead), _MOST_ASKED)
    _, nearest = Tree(ahead).nearest(ahead[asked], _AROUND + 1)
    return _off_fits(ahead, depth, asked, nearest[:, 1:].copy()), depth[asked]


@kernel
def _off_fits(ahead: Float64, depth: Float64, asked: Int64, around: Int64) -> Float64:
    """Return how far inverse depths are from linear fits to those around, float64 (M,).

    Parameters
    ----------
    ahead, depth
        As for `_errors`.
    asked : int64 (M,)
        The points whose inverse depths are compared.
    around : int64 (M, K)
        The points around each.
    """
    errors = np.empty(len(asked))
    number = around.shape[1]
    u, v, inverse, off = np.empty(number), np.empty(number), np.empty(number), np.empty(number)
    for m in range(len(asked)):
        x, y, z = ahead[asked[m], 0], ahead[asked[m], 1], ahead[asked[m], 2]
        # Two axes across the direction: a level one, and (-z * b, z * a, x * b - y * a).
        flat = np.sqrt(x * x + y * y)
        a, b = (-y / flat, x / flat) if flat > 0.0 else (1.0, 0.0)
        for j in range(number):
            i = around[m, j]
            u[j] = ahead[i, 0] * a + ahead[i, 1] * b
            v[j] = ahead[i, 2] * (x * b - y * a) - z * (ahead[i, 0] * b - ahead[i, 1] * a)
            inverse[j] = 1.0 / depth[i]
        off[:] = 0.0
        middle = 0.0
        for fit in range(_FITS):
            middle = _fit(u, v, inverse, off, _FOLLOWED if fit else number)
        errors[m] = np.abs(1.0 / depth[asked[m]] - middle)
    return errors


@inner
def _fit(u: Float64, v: Float64, values: Float64, off: Float64, followed: int) -> float:
    """Return the value at (0, 0) of a linear fit to values at places (u, v).

    It follows those least off the fit before, and writes how far all are off this one.
    """
    s = su = sv = suu = suv = svv = b = bu = bv = 0.0
    for j in range(len(values)):
        rank = 0
        for k in range(len(values)):
            rank += (off[k] < off[j]) | ((off[k] == off[j]) & (k < j))
        if rank >= followed:
            continue
        s, su, sv = s + 1.0, su + u[j], sv + v[j]
        suu, suv, svv = suu + u[j] * u[j], suv + u[j] * v[j], svv + v[j] * v[j]
        b, bu, bv = b + values[j], bu + u[j] * values[j], bv + v[j] * values[j]
    # Where the places lie on a line, the fit is level across it.
    level = 1e-3 * (suu + svv) + 1e-100
    # Measured from the mean place, two unknowns are left.
    suu, suv, svv = suu + level - su * su / s, suv - su * sv / s, svv + level - sv * sv / s
    bu, bv = bu - su * b / s, bv - sv * b / s
    size = suu * svv - suv * suv
    slope, across = (bu * svv - bv * suv) / size, (bv * suu - bu * suv) / size
    middle = (b - su * slope - sv * across) / s
    for j in range(len(values)):
        off[j] = np.abs(middle + u[j] * slope + v[j] * across - values[j])
    return float(middle)


def _growth_nearby(points: Float64, sights: Float64) -> float:
    """Return with which power points lie off their surfaces, among those that lie together.

    Parameters
    ----------
    points : float64 (N, 3)
    sights : float64 (N, 3)
        The ways from the craft to them.

    Returns
    -------
    float
        The mean of two powers: of the square of the distance, and of this times the cosine between
        the sight and the normal, as errors of depth have it. 0 where nothing tells; it is less than
        1, as the points themselves choose the plane.
    """
    distance = np.linalg.norm(sights, axis=1)
    points, sights = points[distance > 0.0], sights[distance > 0.0]
    if len(points) < _ENOUGH:
        return 0.0
    order = np.argsort(distance[distance > 0.0], kind="stable")
    asked = order[_evenly(len(order), _QUESTIONED)]
    _, near = Tree(points).nearest(points[asked], _TOGETHER_IN_SPACE)
    # Measured from the point asked: coordinates may be large.
    around, seen = points[near] - points[asked, None], sights[near]
    weight = np.ones(near.shape)
    for _ in range(_FITS):
        share = weight / weight.sum(axis=1, keepdims=True)
        offsets = around - np.einsum("nki,nk->ni", around, share)[:, None]
        variances, axes = np.linalg.eigh(np.einsum("nki,nkj,nk->nij", offsets, offsets, share))
        off = np.abs(np.einsum("nki,ni->nk", offsets, axes[:, :, 0]))
        weight = (np.argsort(np.argsort(off, axis=1), axis=1) < _ON_PLANE).astype(np.float64)
    usual = np.median(off, axis=1, keepdims=True)
    flat = (variances[:, 0] < _FLAT * variances[:, 1]) & (usual[:, 0] > 0.0)
    if not flat.any():
        return 0.0
    off, usual, seen = off[flat], usual[flat], seen[flat]
    far = np.linalg.norm(seen, axis=2)
    slant = np.abs(np.einsum("nki,ni->nk", seen, axes[flat, :, 0])) / far
    counts = (off < _OFF * usual).astype(np.float64)
    error = _centred(np.log(np.maximum(off, _LEAST_OFF * usual)), counts)
    square = _centred(2.0 * np.log(far), counts)
    upright = square + _centred(np.log(np.maximum(slant, 0.05)), counts)
    powers = [_slope(cause, error) for cause in (square, upright)]
    return sum(powers) / len(powers)


def _centred(values: Float64, weight: Float64) -> Float64:
    """Return values (N, K) less the mean of their row, times their weight."""
    mean = (values * weight).sum(axis=1) / np.maximum(weight.sum(axis=1), 1.0)
    centred: Float64 = (values - mean[:, None]) * weight
    return centred


def _slope(cause: Float64, effect: Float64) -> float:
    square = float((cause * cause).sum())
    return float((cause * effect).sum()) / square if square > 0.0 else 0.0
