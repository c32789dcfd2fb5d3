"""Layers of all points around a point: whether its own is much thinner than others, or a pole's.

The rule stands in `mlscli.pipeline.stages.median`, under `layer_share`. It is put twice: to all
points around, and to those that stand close about the point, at horizontal distances of at most
half of `level`, if three of them at least, the point itself counted, lie in its layer. Beside a
pole stands nothing but the floor below, which holds more points than the pole's layers; in a column
as narrow as the pole these are alike up to its end, and outliers are hardly ever three in one.

The end of a thin pole has hardly any neighbours, or of a dense one so many that the nearest spread
no farther in height than sideways, as on a floor. Both are told from outliers and floors by what
stands beside them: nothing. A point is of a pole if

- of the points at most the thickness of a layer above or below it, three at least, itself counted,
  stand close about it, and half as many at most, and never more than 24, at horizontal distances of
  more than 1.5 times `level` up to the radius;
- what stands close about it goes on, at any height, through two layers at least that follow its own
  without a gap, those above and below added up.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from mlscli.pipeline.stages.point_grid import SHORT_POINTS, PointGrid, first_from
from mlscli.runtime.arrays import Int64
from mlscli.runtime.kernels import inner

# Layers this far above or below a point's own, and beyond, are one.
_FARTHEST_LAYER = 31
_LAYERS = 2 * _FARTHEST_LAYER + 1
# What stands close about a point lies at most this share of `level` beside it, and so many of that
# must lie in its layer.
_CLOSE, _FEWEST = 0.5, 3
# Beside a pole, so many times `level` away and more, stand so many points at most, and at most this
# share of those close about it; and it goes on through so many layers.
_WIDE, _MOST_BESIDE, _BESIDE, _GOES_ON = 1.5, 24, 0.5, 2


@inner
def stands_out(
    grid: PointGrid, around: Int64, i: int, radius: float, level: float, least: float
) -> bool:
    """Return whether enough points lie in the layer of point i, or it is of a pole.

    Enough of all around it, or of those close about it.

    Parameters
    ----------
    grid : PointGrid
    around : int64
        The point's column, and those that touch it.
    i : int
        Place of the point in the grid.
    radius : float
        Points at horizontal distances of at most this count.
    level : float
        Half the thickness of a layer.
    least : float
        The share of the mean layer that the point's own must hold.
    """
    return bool(
        _is_enough(grid, around, i, radius, level, least, 1)
        or _is_enough(grid, around, i, min(_CLOSE * level, radius), level, least, _FEWEST)
        or is_pole(grid, around, i, grid.xyz[i, 2], radius, level)
    )


@inner
def is_pole(grid: PointGrid, around: Int64, i: int, z: float, radius: float, level: float) -> bool:
    """Return whether point i, as if it were at height z, is of a pole.

    Parameters
    ----------
    grid, around, i, radius, level
        As in `stands_out`.
    z : float
        Where the point is taken to lie.
    """
    xyz, fine, first = grid.xyz, grid.fine, grid.first
    x, y = xyz[i, 0], xyz[i, 1]
    # The margin outweighs rounding.
    near = 1.001 * (2.0 * level) + 1e-9 * abs(z)
    farthest = radius * radius
    narrow, wide = min(_CLOSE * level * (_CLOSE * level), farthest), _WIDE * level * (_WIDE * level)
    close = beside = 0
    for k in range(len(around)):
        # The point's own column, in the middle, comes first: on a floor it is enough.
        column = around[(k + len(around) // 2) % len(around)]
        for number in range(first[column], first[column + 1]):
            begin, end = fine[number], fine[number + 1]
            if end - begin > SHORT_POINTS:
                begin = first_from(xyz, begin, end, z - near)
                end = first_from(xyz, begin, end, z + near)
            for j in range(begin, end):
                if abs(xyz[j, 2] - z) <= 2.0 * level:
                    dx, dy = xyz[j, 0] - x, xyz[j, 1] - y
                    squared = dx * dx + dy * dy
                    close += squared <= narrow
                    beside += (wide < squared) & (squared <= farthest)
            if beside > _MOST_BESIDE:
                return False
    if close < _FEWEST or beside > _BESIDE * close:
        return False
    occupied = np.int64(0)
    for column in around:
        for number in range(first[column], first[column + 1]):
            for j in range(fine[number], fine[number + 1]):
                dx, dy = xyz[j, 0] - x, xyz[j, 1] - y
                if dx * dx + dy * dy <= narrow:
                    occupied |= np.int64(1) << (_layer(xyz[j, 2] - z, level) + _FARTHEST_LAYER)
    above, below = occupied >> (_FARTHEST_LAYER + 1), occupied << 1
    goes_on = 0
    while above & 1:
        above, goes_on = above >> 1, goes_on + 1
    while below >> _FARTHEST_LAYER & 1:
        below, goes_on = below << 1, goes_on + 1
    return goes_on >= _GOES_ON


@inner
def _is_enough(
    grid: PointGrid, around: Int64, i: int, radius: float, level: float, least: float, fewest: int
) -> bool:
    """Return whether the layer of point i holds enough of all points within a radius.

    Parameters
    ----------
    grid, around, i, radius, level, least
        As in `stands_out`.
    fewest : int
        So many the point's own layer must hold, whatever their share.
    """
    xyz, fine, first = grid.xyz, grid.fine, grid.first
    x, y, z = xyz[i, 0], xyz[i, 1], xyz[i, 2]
    beside = 0
    # The margin outweighs rounding.
    near = 1.001 * level + 1e-9 * abs(z)
    for column in around:
        for number in range(first[column], first[column + 1]):
            begin, end = fine[number], fine[number + 1]
            if end - begin > SHORT_POINTS:
                begin = first_from(xyz, begin, end, z - near)
                end = first_from(xyz, begin, end, z + near)
            for j in range(begin, end):
                above = xyz[j, 2] - z
                if abs(above) <= near and _layer(above, level) == 0:
                    dx, dy = xyz[j, 0] - x, xyz[j, 1] - y
                    beside += dx * dx + dy * dy <= radius * radius
    if beside < fewest:
        return False
    everything, occupied = 0, np.int64(0)
    for column in around:
        for number in range(first[column], first[column + 1]):
            for j in range(fine[number], fine[number + 1]):
                dx, dy = xyz[j, 0] - x, xyz[j, 1] - y
                if dx * dx + dy * dy <= radius * radius:
                    everything += 1
                    occupied |= np.int64(1) << (_layer(xyz[j, 2] - z, level) + _FARTHEST_LAYER)
                    # Even if there were something in every layer, this would be too much.
                    if beside * _LAYERS < least * everything:
                        return False
    layers = 0
    while occupied:
        occupied &= occupied - 1  # The lowest bit goes.
        layers += 1
    return bool(beside * layers >= least * everything)


@inner
def _layer(above: float, level: float) -> np.signedinteger[Any]:
    """Return the layer of what lies so far above a point."""
    layer = np.rint(above / (2.0 * level))
    return np.int64(min(max(layer, -_FARTHEST_LAYER), _FARTHEST_LAYER))
