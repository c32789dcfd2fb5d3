"""Points of what stands upright, and how far they lie beside it.

A median of heights makes a floor smooth, and can do nothing for a wall: points that noise has moved
across it lie in the next cell, and what is flat there seems to be a part of the wall. So a wall has
a median of its own. A point and the nearest 12 of its neighbours, and others as far away as the
last, stand along a line, seen from above, if their variance along it is at least 4 times that
across it. The point is moved at right angles to that line by the median of their offsets (the mean
of the middle two of an even number), if it moves no farther than a limit.

Offsets are rounded to a 2^15th of the radius: sums of their products are whole numbers below 2^53,
exact in any order, so that neither the order of the points nor the symmetries of the grid change a
bit.
"""

from __future__ import annotations

import numpy as np

from mlscli.pipeline.stages.nearest import HEIGHT, SQUARED, nth_of
from mlscli.runtime.arrays import Float64
from mlscli.runtime.kernels import inner

# So many of the neighbours count: more reach around corners.
_NEAREST = 12
# Points stand along a line if their variance along it is so many times that across it.
_LINE = 4.0
# Steps of an offset in a radius.
_STEPS = 2.0**15


@inner
def aside(
    near: Float64, size: int, x: float, y: float, limit: float, radius: float, farthest: float
) -> tuple[float, float]:
    """Return by how much to move a point in x and y to the middle of what stands upright there.

    Parameters
    ----------
    near : float64 (ROWS, M)
        A buffer with x, y, z and squared distances of points, as `neighbours` leaves it; its row
        `HEIGHT` is overwritten.
    size : int
        How many points are in the buffer.
    x, y : float
        Where the point is.
    limit, radius : float
        The squared distance of the farthest neighbour, and the distance that none exceeds. At equal
        distances several can be the last.
    farthest : float
        A point that would move farther stays.

    Returns
    -------
    dx, dy : float
        0 where the point stays.
    """
    xs, ys, squared, row = near[0], near[1], near[SQUARED], near[HEIGHT]
    n = 0
    for j in range(size):
        # Written first and counted then, which avoids a branch.
        row[n] = squared[j]
        n += squared[j] <= limit
    if n > _NEAREST:
        limit = nth_of(row, row, n, _NEAREST - 1)
    steps = _STEPS / radius
    # The point itself lies at 0.
    several = 1.0
    sx = sy = xx = yy = xy = 0.0
    for j in range(size):
        if squared[j] <= limit:
            dx, dy = np.rint((xs[j] - x) * steps), np.rint((ys[j] - y) * steps)
            sx, sy, xx, yy, xy = sx + dx, sy + dy, xx + dx * dx, yy + dy * dy, xy + dx * dy
            several += 1.0
    xx, yy, xy = several * xx - sx * sx, several * yy - sy * sy, several * xy - sx * sy
    apart = np.sqrt((xx - yy) * (xx - yy) + 4.0 * (xy * xy))
    if apart == 0.0 or (xx + yy) + apart < _LINE * ((xx + yy) - apart):
        return 0.0, 0.0
    # Across the line, of any length.
    if xx >= yy:
        across_x, across_y = -xy, ((xx - yy) + apart) / 2.0
    else:
        across_x, across_y = ((yy - xx) + apart) / 2.0, -xy
    row[0], n = 0.0, 1
    for j in range(size):
        if squared[j] <= limit:
            dx, dy = np.rint((xs[j] - x) * steps), np.rint((ys[j] - y) * steps)
            row[n] = across_x * dx + across_y * dy
            n += 1
    middle = nth_of(row, row, n, n // 2)
    if n % 2 == 0:
        # The lesser half stands before it. Turned about, the mean of both is the same.
        lower = row[0]
        for j in range(n // 2):
            lower = max(lower, row[j])
        middle = (lower + middle) / 2.0
    middle /= (across_x * across_x + across_y * across_y) * steps
    dx, dy = middle * across_x, middle * across_y
    if dx * dx + dy * dy > farthest * farthest:
        return 0.0, 0.0
    return dx, dy
