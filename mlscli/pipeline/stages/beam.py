"""The points around a ray, and the depth at which a surface crosses it.

A ray leads from the craft to a point. Other points are described by how far they lie along it,
before or behind the point, and by two offsets across it, one of them level. A plane through them
gives the depth of the surface; it is fitted by least squares along the ray, in which direction the
depths err, first to the points nearest in depth, and then again to those that it passes closely.

Offsets are rounded to a 2^15th of the reach: sums of their products are whole numbers below 2^53,
exact in any order, so that neither the order of the points nor the symmetries of the grid change a
bit.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mlscli.maps.cells import key_of
from mlscli.pipeline.stages.nearest import nth_of
from mlscli.pipeline.stages.point_grid import (
    SHORT_POINTS,
    PointGrid,
    corner,
    first_from,
    part,
    wider,
)
from mlscli.runtime.arrays import Float64
from mlscli.runtime.kernels import inner
from mlscli.runtime.sorting import place_of

# Rows of a buffer: offsets across the ray, depth beyond the point, squared distance from the ray.
LEVEL, ACROSS, DEPTH, SQUARED = range(4)
ROWS = 4
# Points for which a buffer has room at first.
ROOM = 256
# Steps of an offset in the reach.
_STEPS = 2.0**15
# How often the plane is fitted again to the points that it passes closely.
_AGAIN = 4
# A plane needs so many points.
_FEWEST = 4
# Where points lie on a line, the plane is held level across it: their places count as if they were
# blurred by this share of the reach.
_BLUR = 1 / 400


class Ray(NamedTuple):
    """A ray through a point.

    Attributes
    ----------
    place : (float, float, float)
        The point.
    ahead : (float, float, float)
        Unit vector from the craft to the point.
    sigma : float
        Standard deviation of the point's depth, in the unit of the points.
    """

    place: tuple[float, float, float]
    ahead: tuple[float, float, float]
    sigma: float


class Seen(NamedTuple):
    """How points were seen, in the order of a `PointGrid`.

    Attributes
    ----------
    ahead : float64 (N, 3)
        Unit vectors from the craft to the points; 0 where it is not known from where they were
        seen.
    sigma : float64 (N,)
        Standard deviation of each point's depth; 0 where it is not known.
    """

    ahead: Float64
    sigma: Float64


@inner
def around(
    grid: PointGrid,
    seen: Seen,
    ray: Ray,
    itself: int,
    limits: tuple[float, float, float],
    near: Float64,
) -> tuple[Float64, int]:
    """Collect the points around a ray that can tell where the surface is.

    A point that is twice as uncertain cannot, nor one whose own noise moves it too far across.

    Parameters
    ----------
    grid : PointGrid
    seen : Seen
    ray : Ray
    itself : int
        Place of the ray's point in the grid, which is left out.
    limits : (reach, radius, across)
        How far along the ray, and how far from it, points are taken; and how far the noise of one
        may move it across the ray.
    near : float64 (4, M)
        A buffer.

    Returns
    -------
    near : float64 (4, M)
        The buffer, which may have grown.
    size : int
        How many points it holds.
    """
    xyz, fine, keys, side = grid.xyz, grid.fine, grid.keys, grid.side
    (x, y, z), (ux, uy, uz) = ray.place, ray.ahead
    reach, radius, across = limits
    flat = np.sqrt(ux * ux + uy * uy)
    level_x, level_y = (-uy / flat, ux / flat) if flat > 0.0 else (1.0, 0.0)
    up_x, up_y, up_z = -uz * level_y, uz * level_x, ux * level_y - uy * level_x
    # The margin outweighs the rounding of corners and offsets.
    wide = radius + 1e-6 * side
    far_x, far_y = abs(ux) * reach + wide, abs(uy) * reach + wide
    size = 0
    first_y, last_y = int(np.floor((y - far_y) / side)), int(np.floor((y + far_y) / side))
    for ix in range(int(np.floor((x - far_x) / side)), int(np.floor((x + far_x) / side)) + 1):
        column = place_of(keys, key_of(ix, first_y))
        last = key_of(ix, last_y)
        while column < len(keys) and keys[column] <= last:
            left, lower = corner(keys[column], side)
            divisions = grid.divisions[column]
            width = side / divisions
            west, south = left - x, lower - y
            for fx in range(divisions):
                # Where the ray passes the strip of fine columns, seen from above; and these there.
                low = west + fx * width - wide
                back, ahead = _passage(low, low + width + 2.0 * wide, ux, reach)
                if back > ahead:
                    continue
                low = min(back * uy, ahead * uy) - wide - south
                high = max(back * uy, ahead * uy) + wide - south
                if high < 0.0 or low > side:
                    continue
                row = grid.first[column] + fx * divisions
                lowest, highest = part(low, side, divisions), part(high, side, divisions)
                for number in range(row + lowest, row + highest + 1):
                    begin, end = fine[number], fine[number + 1]
                    if end - begin > SHORT_POINTS:
                        low = south + (number - row) * width - wide
                        since, until = _passage(low, low + width + 2.0 * wide, uy, reach)
                        since, until = max(since, back), min(until, ahead)
                        if since > until:
                            continue
                        low, high = min(since * uz, until * uz), max(since * uz, until * uz)
                        begin = first_from(xyz, begin, end, z + low - wide)
                        end = first_from(xyz, begin, end, z + high + wide)
                    if size + end - begin > near.shape[1]:
                        near = wider(near, 2 * (size + end - begin))
                    for j in range(begin, end):
                        dx, dy, dz = xyz[j, 0] - x, xyz[j, 1] - y, xyz[j, 2] - z
                        depth = (ux * dx + uy * dy) + uz * dz
                        a = level_x * dx + level_y * dy
                        b = (up_x * dx + up_y * dy) + up_z * dz
                        squared = a * a + b * b
                        if abs(depth) > reach or squared > radius * radius or j == itself:
                            continue
                        sigma = seen.sigma[j]
                        vx, vy, vz = seen.ahead[j, 0], seen.ahead[j, 1], seen.ahead[j, 2]
                        cosine = (ux * vx + uy * vy) + uz * vz
                        aside = sigma * sigma * (1.0 - cosine * cosine)
                        if sigma > 2.0 * ray.sigma or aside > across * across:
                            continue
                        near[LEVEL, size], near[ACROSS, size] = a, b
                        near[DEPTH, size], near[SQUARED, size] = depth, squared
                        size += 1
            column += 1
    return near, size


@inner
def _passage(low: float, high: float, slope: float, reach: float) -> tuple[float, float]:
    """Return the first and the last place on a ray at which a coordinate lies between two values.

    At the ray's point the coordinate is 0, and it grows with `slope`. There is no such place where
    the first lies beyond the last.
    """
    if slope == 0.0:
        return (-reach, reach) if low <= 0.0 <= high else (1.0, 0.0)
    first, last = low / slope, high / slope
    return max(min(first, last), -reach), min(max(first, last), reach)


@inner
def crossing(
    near: Float64, size: int, limit: float, reach: float, window: float, needed: float
) -> tuple[float, int]:
    """Return how far beyond its point a ray meets the surface of the points around it.

    Parameters
    ----------
    near : float64 (4, M)
        A buffer, as `around` leaves it; its rows are overwritten.
    size : int
        How many points it holds.
    limit : float
        Points at greater squared distances from the ray do not count.
    reach : float
        No offset is greater.
    window : float
        At first, points count that are no farther before or behind the point; then those that are
        no farther than half of that from the plane.
    needed : float
        At least so many must lie close to the plane.

    Returns
    -------
    beyond : float
        NaN: there is no such surface, or the point does not lie close to it.
    size : int
        How many points form it.
    """
    level, across, depth = near[LEVEL], near[ACROSS], near[DEPTH]
    steps = _STEPS / reach
    n = 0
    for j in range(size):
        if near[SQUARED, j] <= limit:
            level[n] = np.rint(level[j] * steps)
            across[n] = np.rint(across[j] * steps)
            depth[n] = np.rint(depth[j] * steps)
            n += 1
    blur = np.rint(_BLUR * _STEPS) * np.rint(_BLUR * _STEPS)
    slope_a = slope_b = middle = 0.0
    close = window * steps
    several = 0.0
    for _ in range(1 + _AGAIN):
        several = sa = sb = st = aa = bb = ab = at = bt = 0.0
        for j in range(n):
            a, b, t = level[j], across[j], depth[j]
            if abs(t - (slope_a * a + slope_b * b) - middle) <= close:
                several += 1.0
                sa, sb, st = sa + a, sb + b, st + t
                aa, bb, ab = aa + a * a, bb + b * b, ab + a * b
                at, bt = at + a * t, bt + b * t
        if several < _FEWEST:
            return np.nan, 0
        aa, bb, ab = several * aa - sa * sa, several * bb - sb * sb, several * ab - sa * sb
        at, bt = several * at - sa * st, several * bt - sb * st
        aa, bb = aa + several * several * blur, bb + several * several * blur
        determinant = aa * bb - ab * ab
        slope_a = (at * bb - bt * ab) / determinant
        slope_b = (bt * aa - at * ab) / determinant
        middle = (st - (slope_a * sa + slope_b * sb)) / several
        close = window * steps / 2.0
    size = 0
    for j in range(n):
        there = depth[j] - (slope_a * level[j] + slope_b * across[j])
        if abs(there - middle) <= close:
            near[SQUARED, size] = there
            size += 1
    if size < needed:
        return np.nan, size
    found = near[SQUARED]
    beyond = nth_of(found, found, size, size // 2)
    if size % 2 == 0:
        # The lesser half stands before it.
        lower = found[0]
        for j in range(size // 2):
            lower = max(lower, found[j])
        beyond = (lower + beyond) / 2
    return (beyond / steps if abs(beyond) <= close else np.nan), size
