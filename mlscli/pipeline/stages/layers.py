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

from mlscli.pipeline.stages.point_grid import PointGrid
from mlscli.runtime.arrays import Int64
from mlscli.runtime.kernels import inner

# Layers this far above or below a point's own, and beyond, are one.
_FARTHEST_LAYER = 31
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
    xyz, fine, first = grid.xyz, grid.fine, grid.first
    x, y, z = xyz[i, 0], xyz[i, 1], xyz[i, 2]
    narrow = (_CLOSE * level) * (_CLOSE * level)
    beside, everything, occupied = 0, 0, np.int64(0)
    close_beside, close, close_occupied = 0, 0, np.int64(0)
    for column in around:
        for j in range(fine[first[column]], fine[first[column + 1]]):
            dx, dy = xyz[j, 0] - x, xyz[j, 1] - y
            squared = dx * dx + dy * dy
            if squared <= radius * radius:
                layer = np.rint((xyz[j, 2] - z) / (2.0 * level))
                layer = min(max(layer, -_FARTHEST_LAYER), _FARTHEST_LAYER)
                bit = np.int64(1) << np.int64(layer + _FARTHEST_LAYER)
                everything += 1
                beside += layer == 0
                occupied |= bit
                if squared <= narrow:
                    close += 1
                    close_beside += layer == 0
                    close_occupied |= bit
    return bool(
        _is_enough(beside, occupied, everything, least)
        or (close_beside >= _FEWEST and _is_enough(close_beside, close_occupied, close, least))
    )


@inner
def _is_enough(beside: int, occupied: np.signedinteger[Any], everything: int, least: float) -> bool:
    """Return whether a layer holds the least share of what one that holds any does in the mean."""
    layers = 0
    while occupied:
        occupied &= occupied - 1  # The lowest bit goes.
        layers += 1
    return bool(beside * layers >= least * everything)
