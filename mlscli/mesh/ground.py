"""The route on the ground: what lies beneath the craft."""

from __future__ import annotations

import numpy as np
from numba import njit

from mlscli.cells import cell_indices, on_grid
from mlscli.surface_map import SurfaceMap
from mlscli.typing import Float64, Int32, Int64

# Where nothing was mapped beneath the craft itself, the ground is sought this many cells around.
SEARCH_CELLS = 3


def route_on_ground(surface: SurfaceMap) -> Float64:
    """Return the route as it runs on the ground, float64 (R, 3).

    Each position of the craft goes down to the highest patch at or below it in its cell, or else
    in the nearest ring of cells around that has one, up to three cells away. Positions that are
    not known or have no ground are left out, and those that repeat the one before them.
    """
    position = surface.route[:, 1:]
    position = position[np.isfinite(position).all(axis=1)]
    position = position[on_grid(position, surface.cell_size)]
    cell = cell_indices(position[:, :2], surface.cell_size).astype(np.int64)
    ground = _ground_below(cell, position[:, 2], *surface.cells, surface.height)
    landed = np.column_stack((position[:, :2], ground))[np.isfinite(ground)] + 0.0
    new = np.ones(len(landed), dtype=np.bool_)
    new[1:] = (landed[1:] != landed[:-1]).any(axis=1)
    return landed[new]


@njit(cache=True, nogil=True)
def _ground_below(
    craft_cell: Int64, craft_z: Float64, ix: Int32, iy: Int32, start: Int64, height: Float64
) -> Float64:
    """Return the height of the ground beneath each position; NaN where there is none."""
    ground = np.full(len(craft_z), np.nan)
    for k in range(len(craft_z)):
        x, y = craft_cell[k]
        for ring in range(SEARCH_CELLS + 1):
            highest = -np.inf
            for dx in range(-ring, ring + 1):
                for dy in range(-ring, ring + 1):
                    if max(abs(dx), abs(dy)) != ring:
                        continue
                    cell = _find(ix, iy, x + dx, y + dy)
                    if cell >= 0:
                        z = height[start[cell] : start[cell + 1]]
                        below = np.searchsorted(z, craft_z[k], side="right")
                        if below > 0:
                            highest = max(highest, z[below - 1])
            if highest > -np.inf:
                ground[k] = highest
                break
    return ground


@njit(cache=True, nogil=True)
def _find(ix: Int32, iy: Int32, x: int, y: int) -> int:
    """Return the number of the cell at (x, y); -1: it holds nothing."""
    low, high = 0, len(ix)
    while low < high:
        middle = (low + high) // 2
        if ix[middle] < x or (ix[middle] == x and iy[middle] < y):
            low = middle + 1
        else:
            high = middle
    return low if low < len(ix) and ix[low] == x and iy[low] == y else -1
