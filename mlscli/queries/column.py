"""All that a map says of one place: its levels, and the free space between them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mlscli.maps.cells import cell_indices
from mlscli.maps.space import FREE, space_at
from mlscli.maps.surface_map import SurfaceMap
from mlscli.queries.levels import levels_at
from mlscli.runtime.arrays import Float64, Int64


class Column(NamedTuple):
    """What a map says of the cell of a place.

    Attributes
    ----------
    ix, iy : int
        Indices of the cell.
    patch : int64 (L,)
        Its patches, indices of the map's, ascending by height.
    free : float64 (F, 2) or None
        The intervals of z that are free, ascending, each from its lower to its upper end; None
        where the map does not say what was seen through.
    """

    ix: int
    iy: int
    patch: Int64
    free: Float64 | None


def column_at(surface: SurfaceMap, x: float, y: float, least: int = 2) -> Column:
    """Return what a map says of the cell in which a place lies.

    Parameters
    ----------
    surface : SurfaceMap
    x, y : float
        In the frame and the unit of the map.
    least : int
        How many sight lines make a voxel free, see `space_at`.
    """
    ix, iy = map(int, cell_indices(np.array([x, y], dtype=np.float64), surface.cell_size))
    patch = levels_at(surface, np.array([[x, y]], dtype=np.float64)).patch
    return Column(ix, iy, patch, _free(surface, ix, iy, least))


def _free(surface: SurfaceMap, ix: int, iy: int, least: int) -> Float64 | None:
    """Return the free intervals of a column: voxels that follow one another are one."""
    space = surface.free
    if space is None:
        return None
    column = np.flatnonzero((space.ix == ix) & (space.iy == iy))
    if not len(column):
        return np.empty((0, 2))
    iz = space.iz[space.start[column[0]] : space.start[column[0] + 1]].astype(np.float64)
    half = surface.cell_size / 2
    middle = np.column_stack(
        (np.full((len(iz), 2), (np.array([ix, iy]) + 0.5) * surface.cell_size), (iz + 0.5) * half)
    )
    iz = iz[space_at(surface, middle, least) == FREE]
    breaks = np.flatnonzero(np.diff(iz) > 1)
    first = np.concatenate((iz[:1], iz[breaks + 1]))
    last = np.concatenate((iz[breaks], iz[-1:]))
    return np.column_stack((first * half, (last + 1) * half))
