"""What is known of places: occupied, free, never seen, or too little to say."""

from __future__ import annotations

import numpy as np

from mlscli.errors import UsageError, expect
from mlscli.maps.cells import pack
from mlscli.maps.free_space import FreeSpace, voxels_at
from mlscli.maps.surface_map import SurfaceMap
from mlscli.runtime.arrays import Bool, Float64, Int64, UInt8, UInt64, repeated
from mlscli.runtime.kernels import kernel
from mlscli.runtime.sorting import place_of

UNKNOWN, FREE, OCCUPIED, NEVER_SEEN = 0, 1, 2, 3
SPACES = ("unknown", "free", "occupied", "never seen")

MOST_VOXELS = 2**27
"""So many voxels are listed at most: they take 25 bytes each."""


def space_at(surface: SurfaceMap, xyz: Float64, least: int = 2) -> UInt8:
    """Return what is known of places, uint8 (N,).

    A place is `OCCUPIED` (2) if a patch, whatever its origin, reaches into its voxel; else it is
    `FREE` (1) if enough sight lines passed through the voxel, and was `NEVER_SEEN` (3) if none did.
    In between it is `UNKNOWN` (0).

    Parameters
    ----------
    surface : SurfaceMap
        With free space.
    xyz : float64 (N, 3)
        The places, in the frame of the map; one that is not finite was never seen.
    least : int
        How many lines are enough. One may be wrong.

    Raises
    ------
    UsageError
        Where the map has no free space.
    """
    expect(surface, SurfaceMap, "surface", "a map (SurfaceMap)")
    expect(xyz, np.ndarray, "xyz", "places as an array (N, 3)")
    expect(least, (int, np.integer), "least", "a whole number")
    if surface.free is None:
        raise UsageError("the map does not say what was seen through; build it with `free_space`")
    ix, iy, iz = voxels_at(xyz, surface.cell_size)
    known = surface.free.lines_through(ix, iy, iz)
    space = np.where(known >= least, FREE, UNKNOWN).astype(np.uint8)
    space[known == 0] = NEVER_SEEN
    space[occupied(surface, ix, iy, iz)] = OCCUPIED
    return space


def occupied(surface: SurfaceMap, ix: Int64, iy: Int64, iz: Int64) -> Bool:
    """Return which voxels a patch reaches into, bool (N,).

    Parameters
    ----------
    surface : SurfaceMap
    ix, iy, iz : int64 (N,)
        Their indices, see `voxels_at`.
    """
    inside = (np.abs(ix + 0.5) < 2.0**31) & (np.abs(iy + 0.5) < 2.0**31)
    cells, half = surface.cells, surface.cell_size / 2
    low, high = (np.floor(end / half) for end in (surface.low_end, surface.height))
    keys = pack(ix[inside].astype(np.int32), iy[inside].astype(np.int32))
    heights = iz[inside].astype(np.float64)
    found = np.zeros(len(ix), dtype=np.bool_)
    found[inside] = _taken(keys, heights, pack(cells.ix, cells.iy), cells.start, low, high)
    return found


def known_voxels(surface: SurfaceMap, least: int = 2) -> tuple[Int64, UInt8]:
    """Return all voxels that are occupied or free, as `space_at` has it, in no certain order.

    Parameters
    ----------
    surface : SurfaceMap
        Without free space, no voxel is free.
    least : int
        How many lines are enough.

    Returns
    -------
    voxels : int64 (N, 3)
        Their indices ix, iy, iz. One that several patches reach into is listed for each, and one
        that is occupied may be listed as free, too.
    space : uint8 (N,)
        `FREE` or `OCCUPIED`.

    Raises
    ------
    UsageError
        Where they are more than `MOST_VOXELS`.
    """
    half = surface.cell_size / 2
    low, high = (np.floor(end / half).astype(np.int64) for end in (surface.low_end, surface.height))
    sizes = high - low + 1
    free = FreeSpace.of_none() if surface.free is None else surface.free
    enough = free.lines >= least
    count = int(sizes.sum()) + int(np.count_nonzero(enough))
    if count > MOST_VOXELS:
        raise UsageError(f"the map holds {count:,} voxels; at most {MOST_VOXELS:,} can be listed")
    patch, above = repeated(sizes)
    taken = np.column_stack((surface.ix[patch], surface.iy[patch], low[patch] + above))
    voxels = np.concatenate((taken, free.voxels[enough].astype(np.int64)))
    space = np.full(len(voxels), FREE, dtype=np.uint8)
    space[: len(taken)] = OCCUPIED
    return voxels, space


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
