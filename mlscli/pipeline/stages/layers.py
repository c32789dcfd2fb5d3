"""Layers of all points around a point: whether its own is much thinner than others.

The rule stands in `mlscli.pipeline.stages.median`, under `layer_share`.
"""

from __future__ import annotations

import numpy as np

from mlscli.pipeline.stages.point_grid import PointGrid
from mlscli.runtime.arrays import Int64
from mlscli.runtime.kernels import inner

# Layers this far above or below a point's own, and beyond, are one.
_FARTHEST_LAYER = 31


@inner
def stands_out(
    grid: PointGrid, around: Int64, i: int, radius: float, level: float, least: float
) -> bool:
    """Return whether enough of all points around point i, at any height, lie in its layer.

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
    beside, everything, occupied = 0, 0, np.int64(0)
    for column in around:
        for j in range(fine[first[column]], fine[first[column + 1]]):
            dx, dy = xyz[j, 0] - x, xyz[j, 1] - y
            if dx * dx + dy * dy <= radius * radius:
                layer = np.rint((xyz[j, 2] - z) / (2.0 * level))
                layer = min(max(layer, -_FARTHEST_LAYER), _FARTHEST_LAYER)
                everything += 1
                beside += layer == 0
                occupied |= np.int64(1) << np.int64(layer + _FARTHEST_LAYER)
    layers = 0
    while occupied:
        occupied &= occupied - 1  # The lowest bit goes.
        layers += 1
    return bool(beside * layers >= least * everything)
