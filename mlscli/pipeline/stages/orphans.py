"""Orphan patches (thesis, section 3.3): what lies alone is an outlier.

A patch stays if at least `min_neighbours` other patches lie in its box: cell indices within
`horizontal` in x and in y, and the distance of the intervals [height - depth, height] at most
`vertical`. Patches of the same cell count.

With `min_share`, it must also be a part of what was measured around it, in a box of its own,
`share_horizontal` and `share_vertical`: of the points of all patches in the columns of that box, it
and those near it in height hold at least that share. Outliers that lie near each other bear each
other out, but where a surface was seen well, they are few beside its points. A surface that was
seen as seldom as all around it is none of them. Of a tower with hundreds of levels each holds next
to nothing: where the cells of the box hold more than 10 patches in the mean, what 10 in each hold
in the mean counts as all.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from mlscli.maps.neighbours import sought
from mlscli.maps.patches import distance
from mlscli.maps.surface_map import SurfaceMap
from mlscli.parameters.fields import parameter
from mlscli.parameters.lengths import Cells, Length, in_units, whole_cells
from mlscli.pipeline.stages.stage import MapStage
from mlscli.runtime.arrays import Bool, Float64, Int32, Int64
from mlscli.runtime.kernels import inner, kernel
from mlscli.runtime.sorting import place_of
from mlscli.runtime.threads import LIGHT, in_ranges

# Of a cell with more patches, only those of about the same height are compared.
_MANY = 16
# The points of at most so many levels count as all around.
_LEVELS = 10


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
    min_share: float = parameter(
        0.0,
        "a patch is removed if it and the others near it hold a smaller share of the points in the "
        "columns around, at any height, or of ten levels' where there are more",
        low=0,
        high=1,
    )
    share_horizontal: Length = parameter(
        Cells(3), "half the width of the box of min_share, in x and in y", low=0
    )
    share_vertical: Length = parameter(
        Cells(1), "how far in height others are near a patch that count for min_share", low=0
    )

    def reach(self, cell_size: float) -> int:
        """Return half the width of the wider box in whole cells."""
        reach = whole_cells(self.horizontal, cell_size)
        if self.min_share > 0:
            reach = max(reach, whole_cells(self.share_horizontal, cell_size))
        return reach

    def transform(self, surface: SurfaceMap) -> SurfaceMap:
        """Return the map without its orphans."""
        cells = surface.cells
        low, high, stays = surface.low_end, surface.height, np.empty(surface.size, dtype=np.bool_)
        deepest = float((high - low).max()) if surface.size else 0.0

        def look_around(begin: int, end: int) -> None:
            box = self._box(surface, self.horizontal, self.vertical)
            _look_around(begin, end, *cells, low, high, *box, deepest, self.min_neighbours, stays)

        def weigh(begin: int, end: int) -> None:
            box = self._box(surface, self.share_horizontal, self.share_vertical)
            _weigh(
                begin, end, *cells, low, high, points, *box, deepest, float(self.min_share), stays
            )

        in_ranges(len(cells.ix), look_around, weight=LIGHT)
        if self.min_share > 0:
            points = np.concatenate(([0], np.cumsum(surface.count, dtype=np.int64)))
            in_ranges(len(cells.ix), weigh, weight=LIGHT)
        return surface.take(stays)

    @staticmethod
    def _box(surface: SurfaceMap, horizontal: Length, vertical: Length) -> tuple[int, int, float]:
        """Return half the width of a box in x and in y, in cells, and its reach in height."""
        half_y, columns = whole_cells(horizontal, surface.cell_size), surface.cells.ix
        # It need not be wider than the map.
        half_x = min(half_y, int(columns[-1]) - int(columns[0])) if len(columns) else 0
        return half_x, half_y, in_units(vertical, surface.cell_size)


@kernel
def _look_around(
    begin: int,
    end: int,
    ix: Int32,
    iy: Int32,
    start: Int64,
    low: Float64,
    high: Float64,
    half_x: int,
    half_y: int,
    vertical: float,
    deepest: float,
    min_neighbours: int,
    stays: Bool,
) -> None:
    """Find the patches of cells `begin` to `end` that have enough others in their box.

    Parameters
    ----------
    begin, end : int
        Range of cells.
    ix, iy : int32 (C,)
        The occupied cells, ascending.
    start : int64 (C + 1,)
        Where the patches of each cell begin.
    low, high : float64 (P,)
        Lower and upper ends of the patches.
    half_x, half_y : int
        Half the width of the box in x and in y, in cells.
    vertical : float
        Greatest distance of a neighbour in height, in the unit of the recording.
    deepest : float
        No patch is deeper.
    min_neighbours : int
        How many others are enough.
    stays : bool (P,)
        Receives whether each patch of these cells has enough others.
    """
    columns = 2 * half_x + 1
    # For each column of the box, a cell that does not come after its first one; it only moves on,
    # as the cells are in order.
    first = np.full(columns, -1, dtype=np.int64)
    for cell in range(begin, end):
        lowest, highest = np.int64(iy[cell]) - half_y, np.int64(iy[cell]) + half_y
        for i in range(start[cell], start[cell + 1]):
            neighbours = -1  # The patch itself lies in its box, too.
            # The patch's own column comes first: mostly it suffices.
            for column in range(half_x, half_x + columns):
                if neighbours >= min_neighbours:
                    break
                column %= columns
                x = np.int64(ix[cell]) + column - half_x
                there = sought(ix, iy, first[column], x, lowest)
                first[column] = there
                while (
                    neighbours < min_neighbours
                    and there < len(ix)
                    and ix[there] == x
                    and iy[there] <= highest
                ):
                    ends = _level(start, there, low[i], high, i, vertical, deepest)
                    for j in range(ends[0], ends[1]):
                        neighbours += distance(low[i], high[i], low[j], high[j]) <= vertical
                    there += 1
            stays[i] = neighbours >= min_neighbours


@kernel
def _weigh(
    begin: int,
    end: int,
    ix: Int32,
    iy: Int32,
    start: Int64,
    low: Float64,
    high: Float64,
    points: Int64,
    half_x: int,
    half_y: int,
    vertical: float,
    deepest: float,
    min_share: float,
    stays: Bool,
) -> None:
    """Find the patches of cells `begin` to `end` that are too small a part of what is around them.

    Parameters
    ----------
    begin, end, ix, iy, start, low, high, half_x, half_y, vertical, deepest
        As in `_look_around`.
    points : int64 (P + 1,)
        How many points all patches before each one have.
    min_share : float
        The least share of the points around.
    stays : bool (P,)
        Receives False for patches of these cells that hold less.
    """
    columns = 2 * half_x + 1
    # For each column of the box, its first cell, and the first one beyond it.
    first, beyond = np.full(columns, -1, dtype=np.int64), np.full(columns, -1, dtype=np.int64)
    for cell in range(begin, end):
        lowest, highest = np.int64(iy[cell]) - half_y, np.int64(iy[cell]) + half_y
        everything, patches, cells = 0, 0, 0
        for column in range(columns):
            x = np.int64(ix[cell]) + column - half_x
            first[column] = sought(ix, iy, first[column], x, lowest)
            beyond[column] = sought(ix, iy, beyond[column], x, highest + 1)
            everything += points[start[beyond[column]]] - points[start[first[column]]]
            patches += start[beyond[column]] - start[first[column]]
            cells += beyond[column] - first[column]
        enough = min_share * everything
        if patches > _LEVELS * cells:
            enough = min_share * (everything * _LEVELS * cells / patches)
        for i in range(start[cell], start[cell + 1]):
            alike = points[i + 1] - points[i]
            # The patch's own column comes first: mostly it suffices.
            for column in range(half_x, half_x + columns):
                if alike >= enough:
                    break
                column %= columns
                for there in range(first[column], beyond[column]):
                    ends = _level(start, there, low[i], high, i, vertical, deepest)
                    for j in range(ends[0], ends[1]):
                        near = distance(low[i], high[i], low[j], high[j]) <= vertical
                        alike += (points[j + 1] - points[j]) * (near & (j != i))
            stays[i] &= alike >= enough


@inner
def _level(
    start: Int64, cell: int, low: float, high: Float64, i: int, vertical: float, deepest: float
) -> tuple[int, int]:
    """Return the range of patches of a cell outside which none is near patch i in height.

    Patches of a cell ascend by their upper ends.

    Parameters
    ----------
    start : int64 (C + 1,)
        Where the patches of each cell begin, and the end of the last.
    cell : int
        The cell that is looked at.
    low : float
        The lower end of patch i.
    high : float64 (P,)
        The upper ends of all patches.
    i : int
        Index of the patch.
    vertical, deepest : float
        How far off in height a patch is near, and the greatest depth of one.
    """
    begin, end = start[cell], start[cell + 1]
    if end - begin <= _MANY:
        return begin, end
    # The margin outweighs rounding.
    margin = 1e-9 * (abs(low) + abs(high[i]) + vertical + deepest)
    there = high[begin:end]
    first = place_of(there, low - vertical - margin)
    return begin + first, begin + place_of(there, high[i] + vertical + deepest + margin)
