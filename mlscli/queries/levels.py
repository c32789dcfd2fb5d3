"""The levels of a map at places of the plane."""

from __future__ import annotations

from numbers import Real
from typing import NamedTuple

import numpy as np

from mlscli.errors import UsageError, expect
from mlscli.maps.cells import GREATEST_INDEX, LEAST_INDEX, cell_indices, pack
from mlscli.maps.surface_map import SurfaceMap
from mlscli.runtime.arrays import Float64, Int64, repeated
from mlscli.runtime.kernels import kernel


class Levels(NamedTuple):
    """The patches at each of several places.

    Attributes
    ----------
    start : int64 (N + 1,)
        Those at place n lie at ``patch[start[n]:start[n + 1]]``.
    patch : int64 (M,)
        Indices of patches of the map; those of a place ascend by height.
    """

    start: Int64
    patch: Int64


def levels_at(surface: SurfaceMap, xy: Float64) -> Levels:
    """Return the patches in the cells in which places lie.

    Parameters
    ----------
    surface : SurfaceMap
    xy : float64 (N, 2)
        The places, in the frame and the unit of the map. At one that is not finite, or beyond all
        cells, there are none.

    Returns
    -------
    Levels

    Raises
    ------
    TypeError, UsageError
        `surface` is no map, or `xy` no such array.

    Examples
    --------
    >>> import numpy as np
    >>> import mlscli
    >>> bridge = mlscli.SurfaceMap.of(mlscli.Grid(0.5, 1.0, 0.1))
    >>> mlscli.levels_at(bridge, np.array([[0.2, 0.3]])).patch
    array([], dtype=int64)
    """
    begin, end = _patches_at(surface, xy)
    place, level = repeated(end - begin)
    return Levels(np.concatenate(([0], np.cumsum(end - begin))), begin[place] + level)


def height_at(surface: SurfaceMap, xy: Float64, below: float | Float64 = np.inf) -> Float64:
    """Return the height of the highest patch at places, or of the highest one below a height.

    That a patch is inserted (plastered, artificial) makes no difference; to leave these out, take
    them out of the map: ``surface.take(surface.origin == 0)``.

    Parameters
    ----------
    surface : SurfaceMap
    xy : float64 (N, 2)
        The places, in the frame and the unit of the map.
    below : float or float64 (N,)
        Patches whose upper end lies higher do not count: ``height_at(surface, xy, z)`` is the
        height of what lies under a craft at (x, y, z).

    Returns
    -------
    float64 (N,)
        In the unit of the map; NaN where there is no such patch.

    Raises
    ------
    TypeError, UsageError
        As `levels_at`; `below` is neither a number nor an array of N.
    """
    begin, end = _patches_at(surface, xy)
    expect(below, (Real, np.ndarray), "below", "a number, or an array of one for each place")
    limits = np.asarray(below, dtype=np.float64)
    if limits.shape not in ((), (len(xy),)):
        raise UsageError(f"below: is an array {limits.shape}, expected a number, or ({len(xy)},)")
    limits = np.full(len(xy), limits)
    return _highest(begin, end, limits, surface.height)


def _patches_at(surface: SurfaceMap, xy: Float64) -> tuple[Int64, Int64]:
    """Return the first patch in the cell of each place, and the one after the last, int64 (N,)."""
    expect(surface, SurfaceMap, "surface", "a map (SurfaceMap)")
    expect(xy, np.ndarray, "xy", "places as an array (N, 2)")
    if xy.ndim != 2 or xy.shape[1] != 2 or xy.dtype.kind not in "fiu":
        raise UsageError(f"xy: is an array {xy.shape} of {xy.dtype}, expected numbers (N, 2)")
    cells = surface.cells
    index = cell_indices(xy.astype(np.float64), surface.cell_size)
    inside = ((index >= LEAST_INDEX) & (index <= GREATEST_INDEX)).all(axis=1)
    # No cell is that of a place beyond all cells.
    # Each in one piece: kernels are compiled for such arrays, and for others when they first come.
    ix, iy = np.where(inside, index.T, 0).astype(np.int32, order="C")
    keys, sought = pack(cells.ix, cells.iy), pack(ix, iy)
    cell = np.searchsorted(keys, sought)
    found = np.flatnonzero(inside)
    found = found[cell[found] < len(keys)]
    found = found[keys[cell[found]] == sought[found]]
    begin, end = np.zeros((2, len(xy)), dtype=np.int64)
    begin[found], end[found] = cells.start[cell[found]], cells.start[cell[found] + 1]
    return begin, end


@kernel
def _highest(begin: Int64, end: Int64, below: Float64, height: Float64) -> Float64:
    """Return the greatest height up to a limit, of patches ``begin:end`` that ascend, or NaN."""
    found = np.full(len(begin), np.nan)
    for n in range(len(begin)):
        patch = end[n] - 1
        while patch >= begin[n] and height[patch] > below[n]:
            patch -= 1
        if patch >= begin[n]:
            found[n] = height[patch]
    return found
