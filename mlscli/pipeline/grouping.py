"""From points to measured patches: single linkage of the heights in each cell.

The ascending heights of a cell are split wherever two successive ones are more than `gap_size`
apart; sums run over the ascending heights, so that the order of the points changes no bit.
"""

from __future__ import annotations

import numpy as np

from mlscli.kernels import kernel
from mlscli.keyframes import Points
from mlscli.patches import upright
from mlscli.pipeline.ordering import cells_of, order_by_cell
from mlscli.surface_map import SurfaceMap
from mlscli.threads import LIGHT, in_ranges
from mlscli.typing import Float64, Int32, Int64, UInt32


def group(points: Points, cell_size: float, gap_size: float, thickness: float) -> SurfaceMap:
    """Return the map of measured patches that points make.

    Parameters
    ----------
    points : Points
        All within cells whose indices int32 can hold.
    cell_size, gap_size, thickness : float
        As in `SurfaceMap`.
    """
    ix, iy = cells_of(points.xyz, cell_size)
    order, cells, z = order_by_cell(ix, iy, points.xyz[:, 2])
    start = split_by_gaps(cells, z, gap_size)
    keyframe = points.keyframe[order]
    groups = len(start) - 1
    top, bottom, mean, variance = np.empty((4, groups))
    count = np.empty(groups, dtype=np.uint32)
    first, last = np.empty((2, groups), dtype=np.int32)

    def summarise_groups(begin: int, end: int) -> None:
        summarise(
            start, begin, end, z, keyframe,
            top, bottom, mean, variance, count, first, last,
        )  # fmt: skip

    in_ranges(groups, summarise_groups, weight=LIGHT)
    height, depth = upright(top, bottom, mean, variance, thickness)
    one_of_each = order[start[:-1]]
    return SurfaceMap(
        cell_size,
        gap_size,
        thickness,
        ix=ix[one_of_each],
        iy=iy[one_of_each],
        height=height,
        depth=depth,
        top=top,
        bottom=bottom,
        mean=mean,
        variance=variance,
        count=count,
        origin=np.zeros(groups, dtype=np.uint8),
        region=np.full(groups, -1, dtype=np.int32),
        first_keyframe=first,
        last_keyframe=last,
    )


@kernel
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


@kernel
def summarise(
    start: Int64,
    begin: int,
    end: int,
    z: Float64,
    keyframe: Int32,
    top: Float64,
    bottom: Float64,
    mean: Float64,
    variance: Float64,
    count: UInt32,
    first: Int32,
    last: Int32,
) -> None:
    """Note what groups `begin` to `end` are like."""
    for g in range(begin, end):
        lowest, highest, size = z[start[g]], z[start[g + 1] - 1], start[g + 1] - start[g]
        earliest = latest = keyframe[start[g]]
        above = 0.0
        for i in range(start[g], start[g + 1]):
            above += z[i] - lowest
            earliest = min(earliest, keyframe[i])
            latest = max(latest, keyframe[i])
        average = min(highest, lowest + above / size)
        squares = 0.0
        for i in range(start[g], start[g + 1]):
            squares += (z[i] - average) * (z[i] - average)
        bottom[g], top[g], mean[g], variance[g] = lowest, highest, average, squares / size
        count[g], first[g], last[g] = size, earliest, latest
