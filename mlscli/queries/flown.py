"""Where the craft itself was: space that is free, though no sight line passed through it.

Lines begin at the craft. Around each known position of the route, those voxels are free that lie
wholly within an upright cylinder as wide and high as the `vehicle` of the map's parameters, its
middle at the position; and, however small it is, the one in which the position lies. That is all
where the vehicle is not stated in the unit of the map: its default, in cells, is no craft's size.
Nothing is said of the way between two positions: that it was straight is not known.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mlscli.maps.cells import LEAST_INDEX, pack, unpack
from mlscli.maps.free_space import MOST_LINES, FreeSpace, voxels_at
from mlscli.maps.surface_map import SurfaceMap
from mlscli.runtime.arrays import Float64, Int64

# A vehicle of more cells is not taken for one: its voxels would be too many.
_MOST_CELLS = 50


def stated_vehicle(surface: SurfaceMap) -> tuple[float, float] | None:
    """Return width and height of the vehicle of a map, in its unit; None: they are not stated."""
    parameters = surface.meta.get("parameters")
    vehicle = parameters.get("vehicle") if isinstance(parameters, Mapping) else None
    if not isinstance(vehicle, Mapping):
        return None
    most = _MOST_CELLS * surface.cell_size
    sizes = []
    for name in ("width", "height"):
        size = vehicle.get(name)
        if not isinstance(size, (int, float)) or isinstance(size, bool) or not 0 < size <= most:
            return None
        sizes.append(float(size))
    return sizes[0], sizes[1]


def with_flown(surface: SurfaceMap) -> SurfaceMap:
    """Return a map whose free space holds where the craft was, as if many lines passed through.

    A map that does not say what was seen through is returned as it is.

    Parameters
    ----------
    surface : SurfaceMap
    """
    position = surface.route[np.isfinite(surface.route[:, 1:]).all(axis=1), 1:]
    if surface.free is None or not len(position):
        return surface
    own = np.column_stack(voxels_at(position, surface.cell_size))
    voxels = [own]
    if vehicle := stated_vehicle(surface):
        voxels.append(_within(position, own, surface.cell_size, *vehicle))
    return replace(surface, free=surface.free.union(_of(np.concatenate(voxels))))


def _within(position: Float64, own: Int64, side: float, width: float, height: float) -> Int64:
    """Return the voxels that lie wholly within cylinders around positions, int64 (N, 3).

    Parameters
    ----------
    position : float64 (K, 3)
    own : int64 (K, 3)
        The voxels in which they lie.
    side : float
        Side of a cell.
    width, height : float
        Of the cylinders.
    """
    across, up = math.ceil(width / 2 / side), math.ceil(height / side)
    steps = np.arange(-across, across + 1), np.arange(-up, up + 1)
    around = np.stack(np.meshgrid(steps[0], steps[0], steps[1], indexing="ij"), axis=-1)
    size = np.array([side, side, side / 2])
    found = []
    for step in around.reshape(-1, 3):
        voxel = own + step
        off = voxel * size - position
        # How far the voxel reaches from the position along each axis.
        far = np.maximum(np.abs(off), np.abs(off + size))
        inside = np.hypot(far[:, 0], far[:, 1]) <= width / 2
        found.append(voxel[inside & (far[:, 2] <= height / 2)])
    return np.concatenate(found)


def _of(voxels: Int64) -> FreeSpace:
    """Return voxels (N, 3), which may repeat, as free space; those beyond the grid are left out."""
    inside = (voxels >= LEAST_INDEX) & (voxels < -LEAST_INDEX)
    voxels = np.unique(voxels[inside.all(axis=1)], axis=0)
    if not len(voxels):
        return FreeSpace.of_none()
    ix, iy, iz = voxels.astype(np.int32).T
    keys, sizes = np.unique(pack(ix.copy(), iy.copy()), return_counts=True)
    start = np.concatenate(([0], np.cumsum(sizes)))
    lines = np.full(len(voxels), MOST_LINES, dtype=np.uint8)
    return FreeSpace(*unpack(keys), start, iz.copy(), lines)
