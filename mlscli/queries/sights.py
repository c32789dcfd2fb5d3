"""What would be seen of places from others, as far as a map tells: straight lines past its patches.

A line of sight ends a cell before its place, as those of a flight do. Each patch is as wide as its
cell, and hides what lies behind it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mlscli.maps.cells import GREATEST_INDEX, LEAST_INDEX, key_of, pack
from mlscli.maps.free_space import voxels_at
from mlscli.maps.surface_map import ARTIFICIAL, SurfaceMap
from mlscli.runtime.arrays import Bool, Float64, Int64, UInt64, repeated
from mlscli.runtime.kernels import inner, kernel
from mlscli.runtime.sorting import place_of
from mlscli.runtime.threads import in_ranges


class Hiding(NamedTuple):
    """Patches that hide what lies behind them, by their cells.

    Attributes
    ----------
    key : uint64 (C,)
        Packed keys of their cells, ascending.
    start : int64 (C + 1,)
        The patches of cell c are ``start[c]:start[c + 1]``.
    low, high : float64 (P,)
        Their ends.
    """

    key: UInt64
    start: Int64
    low: Float64
    high: Float64

    @classmethod
    def of(cls, surface: SurfaceMap, least: int) -> Hiding:
        """Return the patches of a map, but for artificial ones that `least` lines passed through.

        These are guesses that sight lines refute.
        """
        surface = surface.take(~refuted(surface, least))
        cells = surface.cells
        return cls(pack(cells.ix, cells.iy), cells.start, surface.low_end, surface.height)


def refuted(surface: SurfaceMap, least: int) -> Bool:
    """Return which patches are artificial, with all their voxels seen through, bool (P,)."""
    wrong = np.zeros(surface.size, dtype=np.bool_)
    guessed = np.flatnonzero(surface.origin == ARTIFICIAL)
    if surface.free is None or not len(guessed):
        return wrong
    half = surface.cell_size / 2
    low, high = (np.floor(end[guessed] / half) for end in (surface.low_end, surface.height))
    # Of a level patch, the voxel below counts, too, as for a clearance.
    low -= surface.depth[guessed] == 0
    patch, step = repeated((high - low + 1).astype(np.int64))
    middle = np.column_stack(
        (
            (surface.ix[guessed][patch] + 0.5) * surface.cell_size,
            (surface.iy[guessed][patch] + 0.5) * surface.cell_size,
            (low[patch] + step + 0.5) * half,
        )
    )
    lines = surface.free.lines_through(*voxels_at(middle, surface.cell_size))
    wrong[guessed] = np.bincount(patch, lines < least, len(guessed)) == 0
    return wrong


def in_sight(hiding: Hiding, side: float, views: Float64, places: Float64, reach: float) -> Bool:
    """Return which places would be seen from which views, bool (V, N).

    Parameters
    ----------
    hiding : Hiding
    side : float
        Side of a cell.
    views : float64 (V, 3)
    places : float64 (N, 3)
    reach : float
        How far one sees.
    """
    seen = np.zeros((len(views), len(places)), dtype=np.bool_)

    def work(begin: int, end: int) -> None:
        _in_sight(begin, end, hiding, side, views, places, reach, seen)

    in_ranges(len(views), work, weight=float(max(len(places), 1)))
    return seen


@kernel
def _in_sight(
    begin: int,
    end: int,
    hiding: Hiding,
    side: float,
    views: Float64,
    places: Float64,
    reach: float,
    seen: Bool,
) -> None:
    """Find out which places are seen from views ``begin:end``.

    Parameters
    ----------
    begin, end : int
    hiding, side, views, places, reach
        As for `in_sight`.
    seen : bool (V, N)
        Is given which place is seen from which view.
    """
    for v in range(begin, end):
        for n in range(len(places)):
            dx, dy, dz = places[n] - views[v]
            far = math.sqrt(dx * dx + dy * dy + dz * dz)
            if far <= reach:
                share = max(1.0 - side / far, 0.0) if far > 0.0 else 0.0
                seen[v, n] = _is_clear(hiding, side, views[v], dx * share, dy * share, dz * share)


@inner
def _is_clear(hiding: Hiding, side: float, view: Float64, dx: float, dy: float, dz: float) -> bool:
    """Return whether no patch meets a line.

    Parameters
    ----------
    hiding, side
        As for `in_sight`.
    view : float64 (3,)
        Where it begins.
    dx, dy, dz : float
        From there to its end.
    """
    x, y, z = view[0], view[1], view[2]
    ix, iy = math.floor(x / side), math.floor(y / side)
    last_x, last_y = math.floor((x + dx) / side), math.floor((y + dy) / side)
    step_x, step_y = (1 if dx > 0 else -1), (1 if dy > 0 else -1)
    enter = 0.0
    for _ in range(abs(last_x - ix) + abs(last_y - iy) + 1):
        # Shares of the line at which it leaves the cell through either side.
        across = np.inf if ix == last_x else ((ix + (dx > 0)) * side - x) / dx
        along = np.inf if iy == last_y else ((iy + (dy > 0)) * side - y) / dy
        leave = min(across, along, 1.0)
        one, other = z + enter * dz, z + leave * dz
        if _meets(hiding, ix, iy, min(one, other), max(one, other)):
            return False
        if across < along:
            ix += step_x
        else:
            iy += step_y
        enter = leave
    return True


@inner
def _meets(hiding: Hiding, ix: int, iy: int, low: float, high: float) -> bool:
    """Return whether a patch of a cell reaches between two heights."""
    if min(ix, iy) < LEAST_INDEX or max(ix, iy) > GREATEST_INDEX:
        return False
    key = key_of(ix, iy)
    cell = place_of(hiding.key, key)
    if cell == len(hiding.key) or hiding.key[cell] != key:
        return False
    for patch in range(hiding.start[cell], hiding.start[cell + 1]):
        if hiding.low[patch] <= high and hiding.high[patch] >= low:
            return True
    return False
