"""From points to measured patches: single linkage of the heights in each cell.

The ascending heights of a cell are split wherever two successive ones are more than `gap_size`
apart; sums run over the ascending heights, so that the order of the points changes no bit.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from mlscli.cells import cell_indices, pack, unpack
from mlscli.keyframes import Points
from mlscli.patches import runs, upright
from mlscli.surface_map import SurfaceMap
from mlscli.typing import Float64, Int32, Int64, UInt32, UInt64


def order_by_cell(keys: UInt64, z: Float64) -> Int64:
    """Return the order of points by (cell key, height)."""
    order: Int64 = np.lexsort((z, keys))
    return order


def group(points: Points, cell_size: float, gap_size: float, thickness: float) -> SurfaceMap:
    """Return the map of measured patches that points make.

    Parameters
    ----------
    points : Points
        All within cells whose indices int32 can hold.
    cell_size, gap_size, thickness : float
        As in `SurfaceMap`.
    """
    index = cell_indices(points.xyz[:, :2], cell_size).astype(np.int32)
    keys = pack(index[:, 0], index[:, 1])
    order = order_by_cell(keys, points.xyz[:, 2])
    keys, z, keyframe = keys[order], points.xyz[order, 2], points.keyframe[order]
    start = split_by_gaps(runs(keys), z, gap_size)
    top, bottom, mean, variance, count, first, last = summarise(start, z, keyframe)
    height, depth = upright(top, bottom, mean, variance, thickness)
    ix, iy = unpack(keys[start[:-1]])
    return SurfaceMap(
        cell_size,
        gap_size,
        thickness,
        ix=ix,
        iy=iy,
        height=height,
        depth=depth,
        top=top,
        bottom=bottom,
        mean=mean,
        variance=variance,
        count=count,
        origin=np.zeros(len(ix), dtype=np.uint8),
        region=np.full(len(ix), -1, dtype=np.int32),
        first_keyframe=first,
        last_keyframe=last,
    )


@njit(cache=True, nogil=True)
def split_by_gaps(cells: Int64, z: Float64, gap_size: float) -> Int64:
    """Return where groups begin, and the end of the last: at a new cell or after a gap."""
    start = np.empty(len(z) + 1, dtype=np.int64)
    groups = 0
    for cell in range(len(cells) - 1):
        for i in range(cells[cell], cells[cell + 1]):
            if i == cells[cell] or z[i] - z[i - 1] > gap_size:
                start[groups] = i
                groups += 1
    start[groups] = len(z)
    return start[: groups + 1]


@njit(cache=True, nogil=True)
def summarise(
    start: Int64, z: Float64, keyframe: Int32
) -> tuple[Float64, Float64, Float64, Float64, UInt32, Int32, Int32]:
    """Return top, bottom, mean, variance, count, first and last keyframe of each group."""
    groups = len(start) - 1
    top, bottom, mean, variance = np.empty((4, groups))
    count = np.empty(groups, dtype=np.uint32)
    first = np.empty(groups, dtype=np.int32)
    last = np.empty(groups, dtype=np.int32)
    for g in range(groups):
        begin, end = start[g], start[g + 1]
        bottom[g], top[g], count[g] = z[begin], z[end - 1], end - begin
        first[g] = last[g] = keyframe[begin]
        above = 0.0
        for i in range(begin, end):
            above += z[i] - bottom[g]
            first[g] = min(first[g], keyframe[i])
            last[g] = max(last[g], keyframe[i])
        mean[g] = min(top[g], bottom[g] + above / count[g])
        squares = 0.0
        for i in range(begin, end):
            squares += (z[i] - mean[g]) * (z[i] - mean[g])
        variance[g] = squares / count[g]
    return top, bottom, mean, variance, count, first, last
