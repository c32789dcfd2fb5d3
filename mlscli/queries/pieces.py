"""A polyline cut into pieces that are at most a cell long."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mlscli.errors import UsageError, expect
from mlscli.maps.cells import on_grid
from mlscli.runtime.arrays import Float64, repeated

# More pieces than this would take gigabytes.
MOST_PIECES = 10_000_000


class Pieces(NamedTuple):
    """Pieces of a polyline, each straight, one after another.

    Attributes
    ----------
    place : float64 (N + 1, 3)
        Piece n runs from ``place[n]`` to ``place[n + 1]``.
    along : float64 (N + 1,)
        How far along the polyline these places are, in the unit of the map.
    """

    place: Float64
    along: Float64


def pieces_of(polyline: Float64, cell_size: float) -> Pieces:
    """Return the pieces of a polyline; a corner is an end of two of them.

    Parameters
    ----------
    polyline : float64 (K, 3)
        Its corners, in the frame of the map; a single one is a place at which a craft hovers.
    cell_size : float
        Side of a cell, in the unit of the map: no piece is longer.

    Raises
    ------
    TypeError, UsageError
        Where it is no such array, leaves the grid, or is too long.
    """
    expect(polyline, np.ndarray, "polyline", "its corners as an array (K, 3)")
    form = polyline.ndim == 2 and polyline.shape[1:] == (3,) and polyline.dtype.kind in "fiu"
    if not form or not len(polyline):
        raise UsageError(
            f"polyline: is an array {polyline.shape} of {polyline.dtype}, expected numbers (K, 3)"
        )
    corner = np.ascontiguousarray(polyline, dtype=np.float64)
    # The limits of x and y are those of z, too: nothing of a map lies farther away.
    inside = on_grid(corner, cell_size) & on_grid(np.repeat(corner[:, 2:], 2, axis=1), cell_size)
    if not inside.all():
        wrong = int(np.flatnonzero(~inside)[0])
        x, y, z = corner[wrong].tolist()
        raise UsageError(f"polyline: corner {wrong} is {x:g},{y:g},{z:g}, beyond all cells")
    step = np.diff(corner, axis=0)
    length = np.sqrt((step * step).sum(axis=1))
    moved = np.flatnonzero(length > 0)
    step, length, first = step[moved], length[moved], corner[moved]
    counts = np.maximum(np.ceil(length / cell_size - 1e-9), 1.0)
    if counts.sum() > MOST_PIECES:
        raise UsageError(
            f"polyline: is {length.sum():.3g} long, {counts.sum():.3g} cells; expected at most "
            f"{MOST_PIECES:,} cells"
        )
    if not len(moved):
        return Pieces(np.repeat(corner[:1], 2, axis=0), np.zeros(2))
    number = counts.astype(np.int64)
    segment, place = repeated(number)
    share = place / number[segment]
    before = np.concatenate(([0.0], np.cumsum(length)[:-1]))
    places = first[segment] + share[:, None] * step[segment]
    along = before[segment] + share * length[segment]
    end = math.fsum(length.tolist())
    return Pieces(np.vstack((places, corner[-1:])), np.append(along, end))
