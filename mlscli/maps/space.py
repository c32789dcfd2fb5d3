"""What is known of places: occupied, free, or neither."""

from __future__ import annotations

import numpy as np

from mlscli.errors import UsageError, expect
from mlscli.maps.cells import pack
from mlscli.maps.free_space import voxels_at
from mlscli.maps.surface_map import SurfaceMap
from mlscli.runtime.arrays import Bool, Float64, Int64, UInt8, UInt64
from mlscli.runtime.kernels import kernel
from mlscli.runtime.sorting import place_of

UNKNOWN, FREE, OCCUPIED = 0, 1, 2


def space_at(surface: SurfaceMap, xyz: Float64, least: int = 2) -> UInt8:
    """Return what is known of places, uint8 (N,): 0 unknown, 1 free, 2 occupied.

    A place is occupied if a patch, whatever its origin, reaches into its voxel; else it is free if
    enough sight lines passed through the voxel. All other places are unknown, and those through
    which no line passed were never seen.

    Parameters
    ----------
    surface : SurfaceMap
        With free space.
    xyz : float64 (N, 3)
        The places, in the frame of the map; one that is not finite is unknown.
    least : int
        How many lines are enough. One may be wrong.

    Raises
    ------
    UsageError
        Where the map has no free space.
    """
    expect(surface, SurfaceMap, "surface", "a map (SurfaceMap)")
    expect(xyz, np.ndarray, "xyz", "places as an array (N, 3)")
    if surface.free is None:
        raise UsageError("the map does not say what was seen through; build it with `free_space`")
    ix, iy, iz = voxels_at(xyz, surface.cell_size)
    known = surface.free.lines_through(ix, iy, iz)
    space = np.where(known >= least, FREE, UNKNOWN).astype(np.uint8)
    inside = (np.abs(ix + 0.5) < 2.0**31) & (np.abs(iy + 0.5) < 2.0**31)
    cells, half = surface.cells, surface.cell_size / 2
    low, high = (np.floor(end / half) for end in (surface.low_end, surface.height))
    places = np.flatnonzero(inside)
    keys = pack(ix[places].astype(np.int32), iy[places].astype(np.int32))
    heights = iz[places].astype(np.float64)
    taken = _taken(keys, heights, pack(cells.ix, cells.iy), cells.start, low, high)
    space[places[taken]] = OCCUPIED
    return space


@kernel
def _taken(
    keys: UInt64, iz: Float64, cells: UInt64, start: Int64, low: Float64, high: Float64
) -> Bool:
    """Return which voxels a patch reaches into, bool (N,).

    Parameters
    ----------
    keys : uint64 (N,)
        Packed keys of their cells.
    iz : float64 (N,)
    cells : uint64 (C,)
        Packed keys of the occupied cells, ascending.
    start : int64 (C + 1,)
        Where the patches of each begin.
    low, high : float64 (P,)
        The lowest and the highest voxel that each patch reaches into.
    """
    taken = np.zeros(len(keys), dtype=np.bool_)
    for n in range(len(keys)):
        cell = place_of(cells, keys[n])
        if cell < len(cells) and cells[cell] == keys[n]:
            for patch in range(start[cell], start[cell + 1]):
                taken[n] |= low[patch] <= iz[n] <= high[patch]
    return taken
