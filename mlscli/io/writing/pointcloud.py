"""Patches as points with fields, for the writers of clouds."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from mlscli.errors import UsageError, expect
from mlscli.maps.levels import level_of
from mlscli.maps.recorded import as_recorded as turned_back
from mlscli.maps.surface_map import ARTIFICIAL, SurfaceMap
from mlscli.maps.uncovering import patch_places
from mlscli.runtime.arrays import Array, Float64, Int64, repeated

MOST_POINTS = 2**28

FIELDS: dict[str, tuple[np.dtype[Any], str]] = {
    "level": (np.dtype(np.uint16), "level of its cell, 0 is the lowest"),
    "origin": (np.dtype(np.uint8), "0 measured, 1 plastered, 2 artificial"),
    "count": (np.dtype(np.uint32), "measured points"),
    "depth": (np.dtype(np.float32), "extent below, above 0 a wall"),
    "variance": (np.dtype(np.float32), "of the measured heights"),
    "uncertainty": (np.dtype(np.float32), "sigma of the height"),
}
"""The fields of each point: how they are stored, and what they are."""


class Cloud(NamedTuple):
    """Patches as points.

    Attributes
    ----------
    xyz : float64 (N, 3)
    fields : dict of str to array (N,)
        As `FIELDS` has it; variance and uncertainty are NaN where they are not known.
    cell_size : float
        Of the map, in its unit.
    """

    xyz: Float64
    fields: dict[str, Array]
    cell_size: float


def cloud_of(
    surface: SurfaceMap,
    *,
    filled: bool = False,
    artificial: bool = True,
    as_recorded: bool = False,
) -> Cloud:
    """Return the patches of a map as points: the upper end of each, above the middle of its cell.

    Parameters
    ----------
    surface : SurfaceMap
    filled : bool
        Whether vertical patches have further points below, at most half a cell apart, down to their
        lower end, with the same fields.
    artificial : bool
        Whether artificial patches have any.
    as_recorded : bool
        Whether points are in the frame of the recording: the turn that made z up is undone.

    Raises
    ------
    InputError
        Where the turn that the map's meta holds is none.
    UsageError
        Where they would be more than `MOST_POINTS`.
    """
    expect(surface, SurfaceMap, "surface", "a map (SurfaceMap)")
    levels, sigma = level_of(surface), np.sqrt(surface.height_variance)
    columns: dict[str, Array] = {
        "level": np.minimum(levels, np.iinfo(np.uint16).max),
        "origin": surface.origin,
        "count": surface.count,
        "depth": surface.depth,
        "variance": surface.variance,
        "uncertainty": sigma,
    }
    patch, below = _points(surface, filled)
    xyz = patch_places(surface)[patch]
    xyz[:, 2] -= below
    if not artificial:
        kept = surface.origin[patch] != ARTIFICIAL
        patch, xyz = patch[kept], xyz[kept]
    if as_recorded:
        xyz = turned_back(xyz, surface.meta)
    fields = {name: columns[name].astype(dtype)[patch] for name, (dtype, _) in FIELDS.items()}
    return Cloud(xyz, fields, surface.cell_size)


def _points(surface: SurfaceMap, filled: bool) -> tuple[Int64, Float64]:
    """Return the patch of each point, int64 (N,), and how far below its upper end the point is."""
    if not filled:
        return np.arange(surface.size), np.zeros(surface.size)
    spaces = np.ceil(surface.depth / (surface.cell_size / 2))
    count = float(spaces.sum()) + surface.size
    if count > MOST_POINTS:
        raise UsageError(f"`filled`: would be {count:,.0f} points; at most {MOST_POINTS:,}")
    numbers = spaces.astype(np.int64) + 1
    patch, place = repeated(numbers)
    share = place / np.maximum(numbers[patch] - 1, 1)
    return patch, share * surface.depth[patch]
