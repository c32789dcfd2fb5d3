"""What a patch is: its shape from what was measured, and its distance from another."""

from __future__ import annotations

import numpy as np

from mlscli.maps.neighbours import is_at, onward
from mlscli.runtime.arrays import Array, Bool, Float64, Int32, Int64
from mlscli.runtime.kernels import inner, kernel


def runs(keys: Array) -> Int64:
    """Return where runs of equal keys begin, and the end of the last, for sorted keys."""
    new = np.ones(len(keys), dtype=np.bool_)
    new[1:] = keys[1:] != keys[:-1]
    return np.append(np.flatnonzero(new), len(keys))


@inner
def shape_of(
    top: float, bottom: float, mean: float, variance: float, thickness: float
) -> tuple[float, float]:
    """Return height and depth of a measured patch: it is vertical where it spreads too far.

    The spread is the extent, or that of a uniform distribution of the same variance where this
    is less: the bare extent grows with the number of points, so that more data would turn noisy
    floors into walls.
    """
    extent = top - bottom
    if min(extent, np.sqrt(12 * variance)) > thickness:
        return top, extent
    return mean, 0.0


@kernel
def shapes_of(
    top: Float64, bottom: Float64, mean: Float64, variance: Float64, thickness: float
) -> tuple[Float64, Float64]:
    """Return heights and depths of measured patches; see `shape_of`."""
    height, depth = np.empty(len(top)), np.empty(len(top))
    for i in range(len(top)):
        height[i], depth[i] = shape_of(top[i], bottom[i], mean[i], variance[i], thickness)
    return height, depth


@inner
def begins_group(low: float, reached: float, gap_size: float) -> bool:
    """Tell whether an interval begins a new group: single linkage of intervals in one dimension.

    Parameters
    ----------
    low : float
        Its low end; those of a cell are looked at in ascending order.
    reached : float
        The highest end in the group before it.
    gap_size : float
        Intervals farther apart are not linked.
    """
    return low - reached > gap_size


@kernel
def linked(cells: Int64, low: Float64, high: Float64, gap_size: float) -> Int64:
    """Return where groups of intervals begin, and the end of the last; see `begins_group`.

    Parameters
    ----------
    cells : int64 (C + 1,)
        Where the intervals of each cell begin, and the end of the last.
    low, high : float64 (P,)
        Ends of the intervals, the low ones ascending in each cell.
    gap_size : float
        Intervals farther apart are not linked.
    """
    start = np.empty(len(low) + 1, dtype=np.int64)
    groups = 0
    for cell in range(len(cells) - 1):
        reached = 0.0
        for i in range(cells[cell], cells[cell + 1]):
            if i == cells[cell] or begins_group(low[i], reached, gap_size):
                start[groups] = i
                groups += 1
                reached = high[i]
            else:
                reached = max(reached, high[i])
    start[groups] = len(low)
    return start[: groups + 1]


@kernel
def distance(low: float, high: float, other_low: float, other_high: float) -> float:
    """Return how far apart two intervals are; 0 where they overlap."""
    return max(0.0, max(low - other_high, other_low - high))


@kernel
def within_gap(
    ix: Int32,
    iy: Int32,
    start: Int64,
    low: Float64,
    high: Float64,
    other_ix: Int32,
    other_iy: Int32,
    other_start: Int64,
    other_low: Float64,
    other_high: Float64,
    gap_size: float,
) -> Bool:
    """Tell which intervals in cells are within `gap_size` of one of the others in their cell.

    Of both, the cells are given as `mlscli.maps.order.OccupiedCells`.
    """
    near = np.zeros(len(low), dtype=np.bool_)
    there = 0
    for cell in range(len(ix)):
        there = onward(other_ix, other_iy, there, ix[cell], iy[cell])
        if not is_at(other_ix, other_iy, there, ix[cell], iy[cell]):
            continue
        for i in range(start[cell], start[cell + 1]):
            for j in range(other_start[there], other_start[there + 1]):
                if distance(low[i], high[i], other_low[j], other_high[j]) <= gap_size:
                    near[i] = True
    return near
