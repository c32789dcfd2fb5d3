"""What a craft meets that flies at one height: each cell free, occupied or unknown."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mlscli.errors import UsageError
from mlscli.maps.space import FREE, OCCUPIED, UNKNOWN
from mlscli.maps.surface_map import ARTIFICIAL, SurfaceMap
from mlscli.rasters.extent import Extent
from mlscli.rasters.robot import Robot
from mlscli.runtime.arrays import UInt8


class Flight(NamedTuple):
    """What is known at a flying height.

    Attributes
    ----------
    extent : Extent
        The cells that the raster covers.
    low, high : float
        From where to where the craft reaches, in the unit of the map.
    space : uint8 (H, W)
        `UNKNOWN`, `FREE` or `OCCUPIED` for each cell, row by row along x, from low y up.
    """

    extent: Extent
    low: float
    high: float
    space: UInt8


def at_height(surface: SurfaceMap, z: float, robot: Robot | None = None, least: int = 2) -> Flight:
    """Return what a craft meets whose middle flies at a height.

    Space is known by voxels, half a cell high. A cell is occupied where a patch reaches into one
    that the craft is in; free where enough sight lines passed through each of them; else unknown,
    also where an artificial patch is. A map that was built without free space has no free cell.

    Parameters
    ----------
    surface : SurfaceMap
    z : float
        The height of the craft's middle, in the unit of the map.
    robot : Robot, optional
        Its `headroom` is the height of the craft.
    least : int
        How many sight lines make a voxel free.

    Raises
    ------
    UsageError
        Where `z` is no number, the map is empty, or too wide for a raster.
    """
    if not math.isfinite(z):
        raise UsageError(f"`flying_height`: is {z}; it must be a number")
    size = (Robot() if robot is None else robot).limits(surface).headroom
    low, high = z - size / 2, z + size / 2
    extent = Extent.of_map(surface, with_free=True)
    half = surface.cell_size / 2
    first, last = math.floor(low / half), math.ceil(high / half) - 1
    space = np.full((extent.height, extent.width), UNKNOWN, dtype=np.uint8)
    if surface.free is not None:
        free = surface.free
        inside = (free.iz >= first) & (free.iz <= last) & (free.lines >= least)
        through = np.add.reduceat(inside, free.start[:-1], dtype=np.int64) if free.size else 0
        seen = through == last - first + 1
        space[(free.iy - extent.min_y)[seen], (free.ix - extent.min_x)[seen]] = FREE
    reaches = (np.floor(surface.height / half) >= first) & (
        np.floor(surface.low_end / half) <= last
    )
    doubtful = surface.origin == ARTIFICIAL
    for which, state in ((reaches & doubtful, UNKNOWN), (reaches & ~doubtful, OCCUPIED)):
        space[surface.iy[which] - extent.min_y, surface.ix[which] - extent.min_x] = state
    return Flight(extent, low, high, space)
