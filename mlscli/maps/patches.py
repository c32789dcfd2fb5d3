"""Patches: their shape, and their linkage and distance as intervals of height."""

from __future__ import annotations

import numpy as np

from mlscli.maps.neighbours import is_at, onward
from mlscli.maps.order import OccupiedCells
from mlscli.runtime.arrays import Array, Bool, Float64, Int32, Int64, frozen
from mlscli.runtime.kernels import inner, kernel


def runs(keys: Array) -> Int64:
    """Return where the runs of equal values in sorted keys begin, and the end of the last."""
    new = np.ones(len(keys), dtype=np.bool_)
    new[1:] = keys[1:] != keys[:-1]
    return np.append(np.flatnonzero(new), len(keys))


@inner
def shape_of(
    top: float, bottom: float, mean: float, variance: float, thickness: float
) -> tuple[float, float]:
    """Return height and depth of a measured patch: vertical if its spread exceeds `thickness`.

    The spread is the extent, or that of a uniform distribution of the same variance if this is
    less: the extent alone grows with the number of points, so that more data would turn noisy
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
    """Return heights and depths of measured patches, float64 (P,); see `shape_of`."""
    height, depth = np.empty(len(top)), np.empty(len(top))
    for i in range(len(top)):
        height[i], depth[i] = shape_of(top[i], bottom[i], mean[i], variance[i], thickness)
    return height, depth


def reach_beyond(height: Float64, depth: Float64, top: Float64, bottom: Float64) -> Bool:
    """Return which patches do not lie within what their points span, bool (P,).

    These are patches whose ``[height - depth, height]`` leaves ``[bottom, top]`` by more than the
    rounding of that difference. Those without points, where top and bottom are NaN, are not.
    """
    beyond: Bool = height > top
    low = height - depth
    # To find the rounding takes longer than all else.
    below = np.flatnonzero(low < bottom)
    greatest = np.maximum(np.abs(top[below]), np.abs(bottom[below]))
    beyond[below] |= low[below] < bottom[below] - 4 * np.spacing(greatest)
    return beyond


def overlap(ix: Int32, iy: Int32, bottom: Float64, top: Float64) -> bool:
    """Return whether some intervals of height, float64 (P,), overlap or touch in their cell."""
    order = np.lexsort((bottom, iy, ix))
    ix, iy, bottom, top = ix[order], iy[order], bottom[order], top[order]
    same = (ix[1:] == ix[:-1]) & (iy[1:] == iy[:-1])
    return bool(np.any(same & (bottom[1:] <= top[:-1])))


@inner
def begins_group(low: float, reached: float, gap_size: float) -> bool:
    """Return whether an interval begins a new group in single linkage in one dimension.

    Parameters
    ----------
    low : float
        The lower end of the interval; those of a cell are visited in ascending order.
    reached : float
        The highest upper end in the group before it.
    gap_size : float
        Intervals farther apart are not linked.
    """
    return low - reached > gap_size


@kernel
def linked(cells: Int64, low: Float64, high: Float64, gap_size: float) -> Int64:
    """Return where groups of intervals begin, and the end of the last, int64 (G + 1,).

    See `begins_group`.

    Parameters
    ----------
    cells : int64 (C + 1,)
        Where the intervals of each cell begin, and the end of the last.
    low, high : float64 (P,)
        Lower and upper ends of the intervals; the lower ones ascend in each cell.
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


def within_gap(
    cells: OccupiedCells,
    low: Float64,
    high: Float64,
    others: OccupiedCells,
    other_low: Float64,
    other_high: Float64,
    gap_size: float,
) -> Bool:
    """Return which intervals are within `gap_size` of one of the others in the same cell.

    Parameters
    ----------
    cells : OccupiedCells
        Where the intervals are.
    low, high : float64 (P,)
        Their lower and upper ends.
    others : OccupiedCells
        Where the others are.
    other_low, other_high : float64 (Q,)
        Their lower and upper ends.
    gap_size : float
        The greatest distance, inclusive.

    Returns
    -------
    bool (P,)
    """
    ends, other_ends = (frozen(low), frozen(high)), (frozen(other_low), frozen(other_high))
    near: Bool = _within_gap(cells, *ends, others, *other_ends, gap_size)
    return near


@kernel
def _within_gap(
    cells: OccupiedCells,
    low: Float64,
    high: Float64,
    others: OccupiedCells,
    other_low: Float64,
    other_high: Float64,
    gap_size: float,
) -> Bool:
    """Do the work of `within_gap`.

    Parameters
    ----------
    cells, low, high, others, other_low, other_high, gap_size
        As there.
    """
    near = np.zeros(len(low), dtype=np.bool_)
    there = 0
    for cell in range(len(cells.ix)):
        x, y = cells.ix[cell], cells.iy[cell]
        there = onward(others.ix, others.iy, there, x, y)
        if not is_at(others.ix, others.iy, there, x, y):
            continue
        for i in range(cells.start[cell], cells.start[cell + 1]):
            for j in range(others.start[there], others.start[there + 1]):
                if distance(low[i], high[i], other_low[j], other_high[j]) <= gap_size:
                    near[i] = True
    return near
