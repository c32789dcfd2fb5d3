"""Layers of all points around a point: whether its own is much thinner than others.

The rule stands in `mlscli.pipeline.stages.median`, under `layer_share`. It is put twice: to all
points around, and to those that stand close about the point, at horizontal distances of at most
half of `level`, if three of them at least, the point itself counted, lie in its layer. Beside a
pole stands nothing but the floor below, which holds more points than the pole's layers; in a column
as narrow as the pole these are alike up to its end, and outliers are hardly ever three in one.
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


@inner
def stands_out(
    grid: PointGrid, around: Int64, i: int, radius: float, level: float, least: float
) -> bool:
    """Return whether enough of all points around point i, or close about it, lie in its layer.

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
        or _is_enough(grid, around, i, _CLOSE * level, level, least, _FEWEST)
    )


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
