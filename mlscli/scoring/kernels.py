"""Kernels that find the patches of one map near those of another, by cell and by height."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from mlscli.maps.neighbours import onward
from mlscli.maps.patches import distance
from mlscli.maps.surface_map import MEASURED, SurfaceMap
from mlscli.runtime.arrays import Bool, Float64, Int32, Int64, frozen
from mlscli.runtime.kernels import inner, kernel


class Patches(NamedTuple):
    """The patches of a map as far as they are compared, sorted by (ix, iy, high).

    Attributes
    ----------
    ix, iy : int32 (P,)
        Cell indices.
    low, high : float64 (P,)
        Lower end and height of each patch, in the unit of the map.
    vertical : bool (P,)
        Which patches are vertical: those with a depth above 0.
    """

    ix: Int32
    iy: Int32
    low: Float64
    high: Float64
    vertical: Bool

    @classmethod
    def of(cls, surface: SurfaceMap) -> Patches:
        """Return the patches of a map."""
        low, vertical = frozen(surface.low_end), frozen(surface.depth > 0)
        return cls(surface.ix, surface.iy, low, surface.height, vertical)

    @classmethod
    def measured(cls, surface: SurfaceMap) -> Patches:
        """Return the measured patches of a map, as far as their points span."""
        part = surface.take(surface.origin == MEASURED)
        low, high = (np.clip(end, part.bottom, part.top) for end in (part.low_end, part.height))
        order = np.lexsort((high, part.iy, part.ix))
        return cls(part.ix, part.iy, low, high, part.depth > 0).take(order)

    def take(self, which: Bool | Int64) -> Patches:
        """Return the patches that a mask chooses, or indices, in the order of the indices."""
        columns: list[Any] = [frozen(column[which]) for column in self]
        return Patches(*columns)


@kernel
def nearby(ix: Int32, iy: Int32, other_ix: Int32, other_iy: Int32, reach: int) -> Int64:
    """Return which of the other map's patches lie within `reach` cells, in x and in y.

    The patches of both maps are sorted by (ix, iy), so that those of one ix in neighbouring cells
    form a range.

    Parameters
    ----------
    ix, iy : int32 (P,)
        Cells of the patches.
    other_ix, other_iy : int32 (Q,)
        Cells of the other map's patches.
    reach : int
        In cells; 0: the patch's own cell only.

    Returns
    -------
    int64 (P, 2 reach + 1, 2)
        For each patch and each ix within reach of it, begin and end of a range of the others.
    """
    near = np.empty((len(ix), 2 * reach + 1, 2), dtype=np.int64)
    for row in range(2 * reach + 1):
        begin = end = 0
        for i in range(len(ix)):
            x, y = int(ix[i]) + row - reach, int(iy[i])
            begin = onward(other_ix, other_iy, begin, x, y - reach)
            end = onward(other_ix, other_iy, end, x, y + reach + 1)
            near[i, row, 0], near[i, row, 1] = begin, end
    return near


@kernel
def covered(
    low: Float64,
    high: Float64,
    near: Int64,
    other_low: Float64,
    other_high: Float64,
    margin: float,
) -> Bool:
    """Return which patches are covered by the others near them, bool (P,).

    Parameters
    ----------
    low, high : float64 (P,)
        Ends of the patches.
    near : int64 (P, R, 2)
        Ranges of the others, as `nearby` returns them.
    other_low, other_high : float64 (Q,)
        Ends of the others.
    margin : float
        Each of the others is widened by this much up and down.
    """
    result = np.empty(len(low), dtype=np.bool_)
    for i in range(len(low)):
        result[i] = _is_covered(low[i], high[i], near[i], other_low, other_high, margin)
    return result


@inner
def _is_covered(
    low: float, high: float, near: Int64, other_low: Float64, other_high: Float64, margin: float
) -> bool:
    """Return whether a patch is covered: going down from `high`, the others reach `low`.

    Parameters
    ----------
    low, high : float
        Ends of the patch.
    near : int64 (R, 2)
        Ranges of the others near it.
    other_low, other_high : float64 (Q,)
        Ends of the others.
    margin : float
        Each of the others is widened by this much up and down.
    """
    here = high
    lower = True
    while lower:
        lower = False
        for row in range(len(near)):
            for j in range(near[row, 0], near[row, 1]):
                if distance(here, here, other_low[j], other_high[j]) <= margin:
                    if other_low[j] - low <= margin:
                        return True
                    if other_low[j] - margin < here:
                        here = other_low[j] - margin
                        lower = True
    return False


@kernel
def nearest(
    height: Float64, near: Int64, other_low: Float64, other_high: Float64, farthest: float
) -> Int64:
    """Return for each height the index of the nearest of the others, int64 (P,); -1: none.

    Of equally near ones it is the higher, then the later in the file.

    Parameters
    ----------
    height : float64 (P,)
    near : int64 (P, 1, 2)
        The others in the height's cell, as `nearby` returns them for a reach of 0.
    other_low, other_high : float64 (Q,)
        Ends of the others.
    farthest : float
        Others farther from the height than this do not count.
    """
    result = np.full(len(height), -1, dtype=np.int64)
    for i in range(len(height)):
        least = farthest
        # Upper ends ascend in a cell: of two equally near ones the later is the higher.
        for j in range(near[i, 0, 0], near[i, 0, 1]):
            apart = distance(height[i], height[i], other_low[j], other_high[j])
            if apart <= least:
                result[i], least = j, apart
    return result


@kernel
def match(
    height: Float64,
    start: Int64,
    other_height: Float64,
    other_start: Int64,
    cells: Int64,
    other_cells: Int64,
    farthest: float,
) -> Int64:
    """Match patches of two maps, one to one within a cell, by height.

    Two patches match where each is the other's nearest (equal: the higher, then the later in the
    file) among those not matched yet. Which map is the first makes no difference.

    Parameters
    ----------
    height, other_height : float64 (P,) and (Q,)
        Heights of the patches, ascending in each cell.
    start, other_start : int64 (C + 1,) and (D + 1,)
        The patches of cell c are ``start[c]`` to ``start[c + 1]``.
    cells, other_cells : int64 (S,)
        The numbers, in either map, of the cells that both have.
    farthest : float
        Patches farther apart in height than this do not match.

    Returns
    -------
    int64 (P,)
        For each patch of the first map the index of its match; -1: none.
    """
    matched = np.full(len(height), -1, dtype=np.int64)
    other_matched = np.full(len(other_height), -1, dtype=np.int64)
    for cell, other_cell in zip(cells, other_cells):  # noqa: B905  # numba knows no strict
        begin, end = start[cell], start[cell + 1]
        other_begin, other_end = other_start[other_cell], other_start[other_cell + 1]
        more = True
        while more:
            more = False
            for i in range(begin, end):
                if matched[i] >= 0:
                    continue
                j = _nearest_free(other_begin, other_end, other_height, other_matched, height[i])
                if j < 0 or abs(height[i] - other_height[j]) > farthest:
                    continue
                if _nearest_free(begin, end, height, matched, other_height[j]) == i:
                    matched[i], other_matched[j] = j, i
                    more = True
    return matched


@inner
def _nearest_free(begin: int, end: int, height: Float64, matched: Int64, z: float) -> int:
    """Return the patch of ``begin`` to ``end`` without a match that is nearest to z; -1: none."""
    free = -1
    for j in range(begin, end):
        # Heights ascend in a cell: of two equally near ones the later is the higher.
        if matched[j] < 0 and (free < 0 or abs(height[j] - z) <= abs(height[free] - z)):
            free = j
    return free
