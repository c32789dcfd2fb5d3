"""Cells that share an edge, and the patches in them."""

from __future__ import annotations

import numpy as np
from numba import njit

from mlscli.typing import Float64, Int32, Int64


@njit(cache=True, nogil=True)
def shifted(ix: Int32, iy: Int32, dx: int, dy: int) -> Int64:
    """Return for each cell the number of the cell at (ix + dx, iy + dy); -1: none.

    Cells are in order of (ix, iy), and so are the cells sought: one walk over both finds them.
    """
    found = np.full(len(ix), -1, dtype=np.int64)
    there = 0
    for cell in range(len(ix)):
        x, y = np.int64(ix[cell]) + dx, np.int64(iy[cell]) + dy
        while there < len(ix) and (ix[there] < x or (ix[there] == x and iy[there] < y)):
            there += 1
        if there < len(ix) and ix[there] == x and iy[there] == y:
            found[cell] = there
    return found


@njit(cache=True, nogil=True)
def beside(ix: Int32, iy: Int32) -> Int64:
    """Return for each cell the numbers of the four that share an edge with it, (C, 4); -1: none."""
    four = np.empty((len(ix), 4), dtype=np.int64)
    four[:, 0] = shifted(ix, iy, -1, 0)
    four[:, 1] = shifted(ix, iy, 1, 0)
    four[:, 2] = shifted(ix, iy, 0, -1)
    four[:, 3] = shifted(ix, iy, 0, 1)
    return four


@njit(cache=True, nogil=True)
def nearest_in(begin: int, end: int, height: Float64, z: float) -> int:
    """Return the patch of ``begin`` to ``end`` nearest to z in height (equal: the higher)."""
    nearest = -1
    for j in range(begin, end):
        # Heights ascend in a cell: of two equally near ones the later is the higher.
        if nearest < 0 or abs(height[j] - z) <= abs(height[nearest] - z):
            nearest = j
    return nearest
