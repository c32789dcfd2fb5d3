"""The nearest neighbours of a point, found in a buffer of the points around it.

Where only the nearest count and the buffer has too few, the search grows until it has found enough.
Equal distances are told apart by height, so that the neighbours do not depend on the order of the
points.
"""

from __future__ import annotations

import numpy as np

from mlscli.pipeline.stages.point_grid import PointGrid, gather
from mlscli.runtime.arrays import Float64, Int64
from mlscli.runtime.kernels import inner

# How much the search grows where it finds too few.
_RETRY_GROWTH = 1.5
# Trials to find a limit within which exactly `max_nb` points lie; with equal distances none may.
_TRIALS = 12
# At most so many heights are sorted faster without a branch.
_FEW_HEIGHTS = 32
# Of normal values with the standard deviation 1, those from the lowest eighth to the median lie so
# far below it on average, and so far does the quartile; a median of fewer says nothing.
_INNER, _QUARTILE, _FEWEST_SPREAD = 0.5149, 0.6745, 2
# Rows of a buffer after x, y, z of the points around: squared distances, and heights of those that
# count. Then the number of rows, and the length at first.
SQUARED, HEIGHT, ROWS, ROOM = 3, 4, 5, 256


@inner
def neighbours(
    grid: PointGrid,
    around: Int64,
    i: int,
    z: float,
    radius: float,
    max_nb: int,
    distance: float,
    near: Float64,
    size: int,
    own: int,
) -> tuple[Float64, int, int, float]:
    """Find the neighbours that count of point i, as if it were at height z.

    With `max_nb`, the search is complete as soon as so many points lie within the distance; until
    then the distance grows, up to the radius.

    Parameters
    ----------
    grid : PointGrid
        All points, by columns.
    around : int64
        The point's column, and those that touch it.
    i : int
        Place of the point in the grid.
    z : float
        Height from which neighbours are sought.
    radius : float
        Radius in which neighbours are sought, in the unit of the points.
    max_nb : int
        The most neighbours that count; 0: all.
    distance : float
        All points within this distance are in the buffer, and maybe others.
    near : float64 (ROWS, M)
        The buffer, with x, y, z of points.
    size : int
        How many points are in the buffer.
    own : int
        Index of the point itself in the buffer; -1: it is not there.

    Returns
    -------
    near : float64 (ROWS, M)
        The buffer, or another one: with the squared distances of all points but the point itself
        in its row `SQUARED`, and the heights of the neighbours in its row `HEIGHT`.
    size : int
        How many points are in it.
    n : int
        How many neighbours count.
    limit : float
        The square of the greatest distance at which a point can be one of them.
    """
    while True:
        _measure(near, size, grid.xyz[i, 0], grid.xyz[i, 1], z)
        near[SQUARED, own] = np.inf
        whole = distance >= radius
        limit = radius * radius if whole else min(distance * distance, radius * radius)
        n, limit = _nearest(near, size, limit, max_nb)
        if whole or 0 < max_nb <= n:
            return near, size, n, limit
        distance *= _RETRY_GROWTH
        near = np.empty((ROWS, ROOM))
        near, size, own, _ = gather(grid, around, (i, i + 1), (z, z), min(distance, radius), near)


@inner
def _measure(near: Float64, size: int, x: float, y: float, z: float) -> None:
    """Write the squared distances of the buffer's points from (x, y, z) into the buffer."""
    xs, ys, zs, squared = near[0], near[1], near[2], near[SQUARED]
    for j in range(size):
        dx, dy, dz = xs[j] - x, ys[j] - y, zs[j] - z
        squared[j] = (dx * dx + dy * dy) + dz * dz


@inner
def _nearest(near: Float64, size: int, limit: float, max_nb: int) -> tuple[int, float]:
    """Write the heights of points at squared distances of at most `limit` into the buffer.

    Of more than `max_nb`, those of the nearest come first.

    Returns
    -------
    n : int
        How many of these points count.
    limit : float
        The squared distance within which they lie.
    """
    zs, squared, heights = near[2], near[SQUARED], near[HEIGHT]
    below, above = 0, _within(squared, size, limit)
    if 0 < max_nb < above:
        # A limit within which exactly `max_nb` points lie is sought by linear interpolation.
        less = 0.0
        for _ in range(_TRIALS):
            between = less + (limit - less) * ((max_nb - below) / (above - below))
            n = _within(squared, size, between)
            if n >= max_nb:
                limit, above = between, n
            else:
                less, below = between, n
            if n == max_nb:
                break
    n = 0
    for j in range(size):
        # Written first and counted then, which avoids a branch.
        heights[n] = zs[j]
        n += squared[j] <= limit
    if 0 < max_nb < n:
        # No such limit was found, mostly for equal distances.
        among = squared[:size][squared[:size] <= limit]
        limit = nth_of(among, heights, n, max_nb - 1)
        n = max_nb
    return n, limit


@inner
def _within(squared: Float64, size: int, limit: float) -> int:
    """Count the points whose squared distance is at most a limit."""
    n = 0
    for j in range(size):
        n += squared[j] <= limit
    return n


@inner
def middle(heights: Float64, others: Float64, n: int) -> float:
    """Return the element at index ``n // 2`` of the first n heights as sorted; reorders both."""
    if n > _FEW_HEIGHTS:
        return nth_of(heights, others, n, n // 2)
    for place in range(n // 2 + 1):
        least = heights[place]
        for j in range(place + 1, n):
            height = heights[j]
            heights[j], least = max(height, least), min(height, least)
        heights[place] = least
    return float(heights[n // 2])


@inner
def error_of(median: float, heights: Float64, others: Float64, n: int) -> float:
    """Return the variance of the error of a median of n heights; NaN: too few to tell.

    It follows from how far the lower of them lie from it, those far below left out, which can be
    outliers: `middle` has sorted these. Few heights lie farther from their median than many.

    Parameters
    ----------
    median : float
        What `middle` returned.
    heights, others : float64
        As `middle` left them; they are reordered again.
    n : int
    """
    if n < _FEWEST_SPREAD:
        return np.nan
    if n > _FEW_HEIGHTS:
        below = median - nth_of(heights, others, n // 2, n // 4)
        return below * below * (np.pi / 2.0 / _QUARTILE**2) / n
    below = 0.0
    for place in range(n // 8, n // 2):
        below += median - heights[place]
    inner = n // 2 - n // 8
    # One division: this runs for every point.
    return below * below * (np.pi / 2.0 / _INNER**2) / (inner * inner * n)


@inner
def nth_of(values: Float64, others: Float64, n: int, nth: int) -> float:
    """Return the element at index `nth` of the first n values as sorted (quickselect).

    Lesser values are moved before it, each along with its element of `others`; equal values are
    ordered by these. Both may be the same array.
    """
    begin, end = 0, n
    while True:
        value, other = values[(begin + end) // 2], others[(begin + end) // 2]
        less = begin
        for j in range(begin, end):
            v, o = values[j], others[j]
            values[j], others[j] = values[less], others[less]
            values[less], others[less] = v, o
            less += (v < value) | ((v == value) & (o < other))
        if nth < less:
            end = less
            continue
        equal = less
        for j in range(less, end):
            v, o = values[j], others[j]
            values[j], others[j] = values[equal], others[equal]
            values[equal], others[equal] = v, o
            equal += (v == value) & (o == other)
        if nth < equal:
            return float(value)
        begin = equal
