"""Orphan patches (thesis, section 3.3): what lies alone is an outlier.

A patch stays if at least `min_neighbours` other patches lie in its box: cell indices within
`horizontal` in x and in y, and the distance of the intervals [height - depth, height] at most
`vertical`. Patches of the same cell count.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numba import njit

from mlscli.parameters import Cells, Length, in_units, parameter, whole_cells
from mlscli.patches import distance
from mlscli.pipeline.stage import MapStage
from mlscli.surface_map import SurfaceMap
from mlscli.typing import Bool, Float64, Int32, Int64


@dataclass(frozen=True)
class Orphans(MapStage):
    """Remove patches that have too few others near them."""

    name: ClassVar[str] = "orphans"

    horizontal: Length = parameter(
        Cells(2), "half the width of the search box, in x and in y", low=0
    )
    vertical: Length = parameter(
        Cells(2), "greatest vertical distance of a neighbour in the search box", low=0
    )
    min_neighbours: int = parameter(1, "a patch with fewer others in its box is removed", low=0)

    def reach(self, cell_size: float) -> int:
        """Return half the width of the box in whole cells."""
        return whole_cells(self.horizontal, cell_size)

    def transform(self, surface: SurfaceMap) -> SurfaceMap:
        """Return the map without its orphans."""
        # A box need not be wider than the map.
        columns = surface.cells.ix.astype(np.int64)
        widest = int(columns[-1] - columns[0]) if len(columns) else 0
        stays = _with_neighbours(
            *surface.cells,
            surface.low_end,
            surface.height,
            min(self.reach(surface.cell_size), widest),
            self.reach(surface.cell_size),
            in_units(self.vertical, surface.cell_size),
            self.min_neighbours,
        )
        return surface.take(stays)


@njit(cache=True, nogil=True)
def _with_neighbours(
    ix: Int32,
    iy: Int32,
    start: Int64,
    low: Float64,
    high: Float64,
    half_x: int,
    half_y: int,
    vertical: float,
    min_neighbours: int,
) -> Bool:
    """Tell which patches have enough others in their box."""
    stays = np.zeros(len(low), dtype=np.bool_)
    # For each column of the box, its first cell: it only moves on, as the cells are in order.
    first = np.zeros(2 * half_x + 1, dtype=np.int64)
    for cell in range(len(ix)):
        for column in range(2 * half_x + 1):
            x = np.int64(ix[cell]) + column - half_x
            y = np.int64(iy[cell]) - half_y
            at = first[column]
            while at < len(ix) and (ix[at] < x or (ix[at] == x and iy[at] < y)):
                at += 1
            first[column] = at
        for i in range(start[cell], start[cell + 1]):
            neighbours = -1  # The patch itself lies in its box, too.
            for column in range(2 * half_x + 1):
                x = np.int64(ix[cell]) + column - half_x
                there = first[column]
                while (
                    neighbours < min_neighbours
                    and there < len(ix)
                    and ix[there] == x
                    and iy[there] <= np.int64(iy[cell]) + half_y
                ):
                    for j in range(start[there], start[there + 1]):
                        if distance(low[i], high[i], low[j], high[j]) <= vertical:
                            neighbours += 1
                    there += 1
            stays[i] = neighbours >= min_neighbours
    return stays
