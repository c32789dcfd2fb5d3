"""Poles: narrow columns of points that stand alone."""

from __future__ import annotations

import numpy as np

from mlscli.pipeline.stages.point_grid import SHORT_POINTS, PointGrid, first_from
from mlscli.runtime.arrays import Int64
from mlscli.runtime.kernels import inner

# More points beside it are no pole, whatever there is in the pole.
_MOST_BESIDE = 24
_FEWEST_IN_A_ROW = 2


@inner
def is_pole(
    grid: PointGrid, around: Int64, i: int, z: float, radius: float, level: float, close: float
) -> bool:
    """Return whether a point is of a pole.

    Parameters
    ----------
    grid : PointGrid
    around : int64 (C,)
        The columns of the grid in which neighbours are sought.
    i : int
        The point.
    z : float
        The height from which neighbours are sought, in the unit of the points.
    radius : float
        How far beside the point others count as beside it, horizontally, in the same unit.
    level : float
        What is nearer than this, horizontally, is not beside it; neighbours are sought twice as far
        upwards and downwards.
    close : float
        What is nearer than this, horizontally, is of the pole itself.
    """
    xyz, fine, first = grid.xyz, grid.fine, grid.first
    x, y = xyz[i, 0], xyz[i, 1]
    beside, own = 0, 0
    reach = 2.0 * level
    near = 1.001 * reach + 1e-9 * abs(z)
    size = len(around)
    for k in range(size):
        column = around[(k + size // 2) % size]
        for number in range(first[column], first[column + 1]):
            begin, end = fine[number], fine[number + 1]
            if end - begin > SHORT_POINTS:
                begin = first_from(xyz, begin, end, z - near)
                end = first_from(xyz, begin, end, z + near)
            for j in range(begin, end):
                if abs(xyz[j, 2] - z) <= reach:
                    dx, dy = xyz[j, 0] - x, xyz[j, 1] - y
                    squared = dx * dx + dy * dy
                    own += squared <= close * close
                    beside += (squared <= radius * radius) & (squared > level * level)
            if beside > _MOST_BESIDE:
                return False
    if beside > own or own < 3:
        return False
    occupied = np.int64(0)
    for column in around:
        for number in range(first[column], first[column + 1]):
            for j in range(fine[number], fine[number + 1]):
                dx, dy = xyz[j, 0] - x, xyz[j, 1] - y
                if dx * dx + dy * dy <= close * close:
                    layer = np.rint((xyz[j, 2] - z) / (2.0 * level))
                    occupied |= np.int64(1) << np.int64(min(max(layer, -31.0), 31.0) + 31.0)
    up = down = 0
    while up < 31 and occupied & (np.int64(1) << np.int64(31 + up + 1)):
        up += 1
    while down < 31 and occupied & (np.int64(1) << np.int64(31 - down - 1)):
        down += 1
    return up + down >= _FEWEST_IN_A_ROW
