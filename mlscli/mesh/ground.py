"""The route on the ground: what lies beneath the craft."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mlscli.maps.cells import cell_indices, on_grid
from mlscli.maps.neighbours import is_at, sought
from mlscli.maps.surface_map import SurfaceMap
from mlscli.runtime.arrays import Float64, Int32, Int64, repeated
from mlscli.runtime.kernels import inner, kernel

# In a hole of the map ground is sought this many cells around.
SEARCH_CELLS = 3

# A leg follows the ground cell by cell; where the whole route would take more steps than this,
# the steps are longer.
MAX_STEPS = 2_000_000


class GroundLine(NamedTuple):
    """A line on the ground.

    Attributes
    ----------
    vertices : float64 (R, 3)
        Coordinates in the map frame.
    legs : int64 (L, 2)
        Indices of the two vertices that each piece of the line runs between.
    """

    vertices: Float64
    legs: Int64


def route_on_ground(surface: SurfaceMap) -> GroundLine:
    """Return the route as it runs on the ground.

    The craft is taken to fly straight from each known position to the next. At both, and once per
    cell between, the line lies on the highest patch at or below the craft in its cell, or else in
    the nearest ring of cells around that has one, up to `SEARCH_CELLS` away. Where there is none,
    the line is interrupted, and so it is beyond the edge of the map: where the craft's cell is
    empty, and there are not cells of the map as near on both sides of it. A route without any
    ground beneath it, as in a room whose floor was not seen, is returned as it was flown.
    """
    position = surface.route[:, 1:]
    position = position[np.isfinite(position).all(axis=1)]
    position = position[on_grid(position, surface.cell_size)]
    position = _steps(position, surface.cell_size)
    cell = cell_indices(position[:, :2], surface.cell_size).astype(np.int64)
    height = np.ascontiguousarray(position[:, 2])
    ground = _ground_below(cell, height, *surface.cells, surface.height)
    if surface.size and not np.isfinite(ground).any():
        ground = position[:, 2]
    landed = np.column_stack((position[:, :2], ground)) + 0.0
    known = np.isfinite(ground)
    new = known.copy()
    new[1:] &= (landed[1:] != landed[:-1]).any(axis=1) | ~known[:-1]
    number = np.cumsum(new) - 1
    leg = np.flatnonzero(new[1:] & known[:-1])
    return GroundLine(landed[new], np.column_stack((number[leg], number[leg + 1])))


def _steps(position: Float64, cell_size: float) -> Float64:
    """Return positions (N, 3) with others inserted, at most a cell apart up to `MAX_STEPS`."""
    if len(position) < 2:
        return position
    leg = np.diff(position, axis=0)
    pieces = np.hypot(leg[:, 0], leg[:, 1]) / cell_size
    pieces *= min(1.0, MAX_STEPS / max(pieces.sum(), 1.0))
    count = np.maximum(np.ceil(pieces), 1).astype(np.int64)
    begin, step = repeated(count)
    share = step / count[begin]
    return np.concatenate((position[begin] + share[:, None] * leg[begin], position[-1:]))


@kernel
def _ground_below(
    craft_cell: Int64, craft_z: Float64, ix: Int32, iy: Int32, start: Int64, height: Float64
) -> Float64:
    """Return the height of the ground beneath each position, float64 (K,); NaN: there is none.

    Parameters
    ----------
    craft_cell : int64 (K, 2)
        Indices (ix, iy) of the cell at each position of the craft.
    craft_z : float64 (K,)
        Height of the craft at each position.
    ix, iy : int32 (C,)
        The map's occupied cells, ascending.
    start : int64 (C + 1,)
        Where the patches of each cell begin.
    height : float64 (P,)
        Heights of the patches.
    """
    ground = np.full(len(craft_z), np.nan)
    for k in range(len(craft_z)):
        x, y = craft_cell[k]
        own = sought(ix, iy, -1, x, y)
        if not is_at(ix, iy, own, x, y) and not _lies_between(ix, iy, x, y):
            continue
        for ring in range(SEARCH_CELLS + 1):
            highest = -np.inf
            for dx in range(-ring, ring + 1):
                for dy in range(-ring, ring + 1):
                    if max(abs(dx), abs(dy)) != ring:
                        continue
                    cell = sought(ix, iy, -1, x + dx, y + dy)
                    if is_at(ix, iy, cell, x + dx, y + dy):
                        for z in height[start[cell] : start[cell + 1]]:
                            if z <= craft_z[k]:
                                highest = max(highest, z)
            if highest > -np.inf:
                ground[k] = highest
                break
    return ground


@inner
def _lies_between(ix: Int32, iy: Int32, x: int, y: int) -> bool:
    """Whether cells lie near on both sides of one: along x, along y, or along a diagonal."""
    for along_x, along_y in ((1, 0), (0, 1), (1, 1), (1, -1)):
        sides = 0
        for sign in (-1, 1):
            for step in range(1, SEARCH_CELLS + 1):
                there_x, there_y = x + sign * step * along_x, y + sign * step * along_y
                cell = sought(ix, iy, -1, there_x, there_y)
                if is_at(ix, iy, cell, there_x, there_y):
                    sides += 1
                    break
        if sides == 2:
            return True
    return False
