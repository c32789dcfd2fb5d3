"""The slope on which a point and its neighbours lie, and heights carried along it.

A plane is fitted to the point and its neighbours by least squares in height. They lie on a slope
unless an upright surface explains them better: unless the variance of the heights about the plane
is at least twice that of the places about a line, seen from above. So it is along walls, trunks and
poles. A point with fewer than four neighbours lies on no slope, nor one that lies with all of them
on a line, seen from above.

Offsets are rounded to a 2^15th of the radius: sums of their products are whole numbers below 2^53,
exact in any order, so that neither the order of the points nor the symmetries of the grid change a
bit.
"""

from __future__ import annotations

import numpy as np

from mlscli.pipeline.stages.nearest import HEIGHT, SQUARED
from mlscli.runtime.arrays import Float64
from mlscli.runtime.kernels import inner

# Steps of an offset in a radius.
_STEPS = 2.0**15
# A plane needs so many neighbours besides the point.
_FEWEST = 4
# An upright surface is taken where it explains the points so much better, in variances.
_UPRIGHT = 2.0
# From here on it may be an upright one, of which the neighbours show too little.
_UNSURE = 0.5


@inner
def carry(
    near: Float64,
    size: int,
    place: tuple[float, float, float],
    limit: float,
    radius: float,
    steepest: float,
) -> tuple[int, float, bool]:
    """Carry the heights of a point's neighbours along their slope to the point's x and y.

    All points at squared distances of at most `limit` are neighbours.

    Parameters
    ----------
    near : float64 (ROWS, M)
        A buffer with x, y, z and squared distances of points, as `neighbours` leaves it; its row
        `HEIGHT` receives the heights.
    size : int
        How many points are in the buffer.
    place : (x, y, z)
        Where the point is.
    limit, radius : float
        The squared distance of the farthest neighbour, and the distance that none exceeds.
    steepest : float
        The steepest slope that counts, rise over run.

    Returns
    -------
    n : int
        The number of neighbours; -1: they lie on no such slope.
    across : float
        Where they stand upright, the variance of their places about a line, seen from above: noise
        that the point's height has, too. Otherwise NaN.
    unsure : bool
        Whether they lie on a slope, and yet the variance of their heights about it is at least half
        of that of their places about a line.
    """
    xs, ys, zs, squared, heights = near[0], near[1], near[2], near[SQUARED], near[HEIGHT]
    x, y, z = place
    steps = _STEPS / radius
    n = 0
    for j in range(size):
        # Written first and counted then, which avoids a branch.
        heights[n] = j
        n += squared[j] <= limit
    if n < _FEWEST:
        return -1, np.nan, False
    sx = sy = sz = xx = yy = zz = xy = xz = yz = 0.0
    for i in range(n):
        j = int(heights[i])
        dx, dy, dz = (
            np.rint((xs[j] - x) * steps),
            np.rint((ys[j] - y) * steps),
            np.rint((zs[j] - z) * steps),
        )
        sx, sy, sz = sx + dx, sy + dy, sz + dz
        xx, yy, zz = xx + dx * dx, yy + dy * dy, zz + dz * dz
        xy, xz, yz = xy + dx * dy, xz + dx * dz, yz + dy * dz
    # The point itself lies at 0.
    several = n + 1.0
    xx, yy, zz = several * xx - sx * sx, several * yy - sy * sy, several * zz - sz * sz
    xy, xz, yz = several * xy - sx * sy, several * xz - sx * sz, several * yz - sy * sz
    across = ((xx + yy) - np.sqrt((xx - yy) * (xx - yy) + 4.0 * (xy * xy))) / 2.0
    determinant = xx * yy - xy * xy
    if not determinant > 0.0:
        return -1, np.nan, False
    along_x = (xz * yy - yz * xy) / determinant
    along_y = (yz * xx - xz * xy) / determinant
    scatter = zz - (along_x * xz + along_y * yz)
    if _UPRIGHT * across <= scatter or along_x * along_x + along_y * along_y > steepest * steepest:
        return -1, max(0.0, across) / (several * several * steps * steps), False
    for i in range(n):
        j = int(heights[i])
        heights[i] = zs[j] - (along_x * (xs[j] - x) + along_y * (ys[j] - y))
    return n, np.nan, bool(_UNSURE * across <= scatter)
