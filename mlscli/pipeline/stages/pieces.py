"""Pieces of walls: patches one above the other that are one wall.

Where hardly anything upright was sampled, `gap_size: auto` is small, lest the ground and what lies
above it become one; a wall that stands there alone then falls to pieces wherever its points lie
farther apart. Two successive measured patches of a cell, more than `gap_size` and at most a given
height apart, are one if

- hardly anything around is level with the upper one: at most 4 of the eight cells around hold a
  patch within `gap_size` of it. A surface has more, up to its edge, where it is straight;
- a wall goes on beside them: 2 of the eight cells around hold a vertical patch within `gap_size` of
  the space between them.

There are two rounds, so that what the first has joined bears out what stands beside it. The points
of what is joined stay together: its height and depth follow from them as those of every measured
patch.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from mlscli.maps.merging import shape, take_in
from mlscli.maps.neighbours import sought
from mlscli.maps.patches import distance
from mlscli.maps.records import columns_of, records_of
from mlscli.maps.surface_map import SurfaceMap
from mlscli.runtime.arrays import ZERO, Array, Bool, Float64, Int32, Int64
from mlscli.runtime.kernels import kernel
from mlscli.runtime.threads import LIGHT, in_ranges

ROUNDS = 2
"""How often pieces are joined: what is read lies a cell farther away for each."""

# Of the eight cells around, so many at most may hold something level with what is joined, and so
# many at least must hold a wall.
_MOST_LEVEL, _FEWEST_WALLS = 4, 2


def joined(surface: SurfaceMap, farthest: float) -> SurfaceMap:
    """Return the map with the pieces of its walls joined.

    Parameters
    ----------
    surface : SurfaceMap
    farthest : float
        Pieces farther apart stay, in the unit of the recording.
    """
    for _ in range(ROUNDS if farthest > surface.gap_size else 0):
        onto_lower = _pieces(surface, farthest)
        if not onto_lower.any():
            break
        records: Array = _put_together(records_of(surface), onto_lower, surface.thickness)
        surface = replace(surface, **columns_of(records)).sorted()
    return surface


def _pieces(surface: SurfaceMap, farthest: float) -> Bool:
    """Return which patches are one with the next lower one of their cell, bool (P,)."""
    onto_lower = np.zeros(surface.size, dtype=np.bool_)
    ends = surface.low_end, surface.height, surface.bottom, surface.top

    def find(begin: int, end: int) -> None:
        _find_pieces(begin, end, *surface.cells, *ends, surface.gap_size, farthest, onto_lower)

    in_ranges(len(surface.cells.ix), find, weight=LIGHT)
    return onto_lower


@kernel
def _find_pieces(
    begin: int,
    end: int,
    ix: Int32,
    iy: Int32,
    start: Int64,
    low: Float64,
    high: Float64,
    bottom: Float64,
    top: Float64,
    gap_size: float,
    farthest: float,
    onto_lower: Bool,
) -> None:
    """Find the pieces of walls in cells `begin` to `end`.

    Parameters
    ----------
    begin, end : int
        Range of cells.
    ix, iy : int32 (C,)
        The occupied cells, ascending.
    start : int64 (C + 1,)
        Where the patches of each cell begin.
    low, high : float64 (P,)
        Lower and upper ends of all patches.
    bottom, top : float64 (P,)
        Those of their points; NaN where a patch was inserted.
    gap_size, farthest : float
        Patches at most so far, and farther, apart are no pieces, in the unit of the recording.
    onto_lower : bool (P,)
        Receives which patches of these cells are one with the next lower one.
    """
    around = np.empty(8, dtype=np.int64)
    first = np.full(3, -1, dtype=np.int64)
    for cell in range(begin, end):
        x, y, beside = np.int64(ix[cell]), np.int64(iy[cell]), -1
        for i in range(start[cell] + 1, start[cell + 1]):
            space = low[i] - high[i - 1]
            # Only what was measured is joined: any comparison with NaN is false.
            if not (gap_size < space <= farthest and bottom[i] > top[i - 1]):
                continue
            if beside < 0:
                beside = ZERO
                for column in range(3):
                    # Cells are in order, so that the first one of each column only moves on.
                    there = sought(ix, iy, first[column], x + column - 1, y - 1)
                    first[column] = there
                    while there < len(ix) and ix[there] == x + column - 1 and iy[there] <= y + 1:
                        if there != cell:
                            around[beside] = there
                            beside += 1
                        there += 1
            level = walls = 0
            for there in around[:beside]:
                is_level = is_wall = False
                for j in range(start[there], start[there + 1]):
                    is_level |= distance(low[i], high[i], low[j], high[j]) <= gap_size
                    is_wall |= (high[j] > low[j]) & (
                        distance(high[i - 1], low[i], low[j], high[j]) <= gap_size
                    )
                level += is_level
                walls += is_wall
            onto_lower[i] = (level <= _MOST_LEVEL) & (walls >= _FEWEST_WALLS)


@kernel
def _put_together(records: Any, onto_lower: Bool, thickness: float) -> Array:
    """Return the patches, (P,), those put together that are one with the next lower one."""
    together = np.empty(len(records), dtype=records.dtype)
    size, parts = ZERO, 0
    for i in range(len(records)):
        if onto_lower[i]:
            take_in(together[size - 1], records[i])
            parts += 1
            continue
        if size > 0:
            shape(together, size - 1, parts, thickness)
        together[size], parts = records[i], 1
        size += 1
    if size > 0:
        shape(together, size - 1, parts, thickness)
    return together[:size]
