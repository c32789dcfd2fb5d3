"""From points to measured patches: single linkage of the heights in each cell.

The ascending heights of a cell are split wherever two successive ones are more than `gap_size`
apart; sums run over the ascending heights, so that the order of the points changes no bit.
"""

from __future__ import annotations

import numpy as np

from mlscli.keyframes.batches import Points
from mlscli.maps.columns import new_columns
from mlscli.maps.grid import Grid
from mlscli.maps.patches import begins_group, shapes_of
from mlscli.maps.surface_map import MEASURED, SurfaceMap
from mlscli.pipeline.stages.ordering import cells_of, order_by_cell
from mlscli.runtime.arrays import Array, Float32, Float64, Int32, Int64, UInt32
from mlscli.runtime.kernels import kernel
from mlscli.runtime.threads import LIGHT, in_ranges

# Steps of an error's variance in the square of a cell, and the greatest that counts, in these
# squares: whole numbers add up exactly in any order.
_STEPS, _GREATEST = 2.0**24, 2.0**10


def group(points: Points, grid: Grid) -> SurfaceMap:
    """Return the map of the measured patches of points.

    Parameters
    ----------
    points : Points
        All in cells whose indices int32 can hold.
    grid : Grid
    """
    ix, iy = cells_of(points.xyz, grid.cell_size)
    order, cells, z = order_by_cell(ix, iy, points.xyz[:, 2])

    def split(begin: int, end: int) -> tuple[Int64, Int64]:
        starts: tuple[Int64, Int64] = split_by_gaps(begin, end, cells.start, z, grid.gap_size)
        return starts

    starts, of_cells = zip(*in_ranges(len(cells.ix), split, weight=LIGHT), strict=True)
    start, of_cell = np.concatenate((*starts, [points.size])), np.concatenate(of_cells)
    new = new_columns(len(start) - 1)

    def summarise_groups(begin: int, end: int) -> None:
        part = {name: column[begin:end] for name, column in new.items()}
        summarise(
            start[begin : end + 1], order, z, points.keyframe, points.noise, grid.cell_size,
            part["top"], part["bottom"], part["mean"], part["variance"], part["noise"],
            part["count"], part["first_keyframe"], part["last_keyframe"],
        )  # fmt: skip
        part["ix"][:], part["iy"][:] = (axis[of_cell[begin:end]] for axis in cells[:2])
        part["height"][:], part["depth"][:] = shapes_of(
            part["top"], part["bottom"], part["mean"], part["variance"], grid.thickness
        )
        part["origin"][:], part["moved"][:], part["region"][:] = MEASURED, 0, -1

    in_ranges(len(start) - 1, summarise_groups, weight=LIGHT)
    return SurfaceMap.of(grid, new)


@kernel
def split_by_gaps(
    begin: int, end: int, cells: Int64, z: Float64, gap_size: float
) -> tuple[Int64, Int64]:
    """Split the heights of cells into groups, wherever two successive ones are too far apart.

    Parameters
    ----------
    begin, end : int
        The cells to split: from `begin` up to, but without, `end`.
    cells : int64 (C + 1,)
        Where the heights of each cell begin, and the end of the last.
    z : float64 (N,)
        The heights, ascending in each cell.
    gap_size : float
        Heights farther apart belong to different groups.

    Returns
    -------
    start, of_cell : int64 (G,)
        Where in `z` each group begins, and the number of its cell.
    """
    most = cells[end] - cells[begin]
    start, of_cell = np.empty(most, dtype=np.int64), np.empty(most, dtype=np.int64)
    groups = 0
    for cell in range(begin, end):
        for i in range(cells[cell], cells[cell + 1]):
            if i == cells[cell] or begins_group(z[i], z[i - 1], gap_size):
                start[groups], of_cell[groups] = i, cell
                groups += 1
    return start[:groups].copy(), of_cell[:groups].copy()


@kernel
def summarise(
    start: Int64,
    order: Array,
    z: Float64,
    keyframe: Int32,
    errors: Float32,
    unit: float,
    top: Float64,
    bottom: Float64,
    mean: Float64,
    variance: Float64,
    noise: Float32,
    count: UInt32,
    first: Int32,
    last: Int32,
) -> None:
    """Compute the statistics of groups of heights.

    Parameters
    ----------
    start : int64 (G + 1,)
        The heights of group g are ``z[start[g]:start[g + 1]]``.
    order : uint32 or int64 (N,)
        The number of the point of each height.
    z : float64 (N,)
        Heights, ascending in each group.
    keyframe : int32 (N,)
        The keyframe of each point, by its number.
    errors : float32 (N,)
        The variance of the error of each point's height, by its number; NaN where not known.
    unit : float
        A length of the size of usual errors, in which they are rounded.
    top, bottom, mean, variance : float64 (G,)
        Receive the statistics of the heights of each group.
    noise : float32 (G,)
        Receives the mean of the errors known; NaN where none is.
    count : uint32 (G,)
        Receives the numbers of points.
    first, last : int32 (G,)
        Receive the first and the last keyframe of each group.
    """
    for g in range(len(start) - 1):
        lowest, highest, size = z[start[g]], z[start[g + 1] - 1], start[g + 1] - start[g]
        earliest = latest = keyframe[order[start[g]]]
        above, known, total = 0.0, 0, 0
        for i in range(start[g], start[g + 1]):
            above += z[i] - lowest
            earliest = min(earliest, keyframe[order[i]])
            latest = max(latest, keyframe[order[i]])
            error = errors[order[i]]
            if error == error:
                known += 1
                total += int(np.rint(min(error / (unit * unit), _GREATEST) * _STEPS))
        average = min(highest, lowest + above / size)
        squares = 0.0
        for i in range(start[g], start[g + 1]):
            squares += (z[i] - average) * (z[i] - average)
        bottom[g], top[g], mean[g], variance[g] = lowest, highest, average, squares / size
        noise[g] = unit * unit * total / (_STEPS * known) if known else np.nan
        count[g], first[g], last[g] = size, earliest, latest
