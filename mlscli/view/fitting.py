"""What a page needs to tell whether a craft fits: obstacles, and space that was seen through.

Both are those of `mlscli.queries.clearance`; the page's own computation stands in web/clearance.js.
What obstacles reach beyond the ends of their patches is rounded up, so that the page never tells of
more room than there is.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mlscli.io.writing.way import CLEAR, DOUBTFUL_ORANGE, TOUCHING, UNSEEN_GREY
from mlscli.maps.patches import runs
from mlscli.maps.surface_map import SurfaceMap
from mlscli.mesh.colours import ARTIFICIAL_RED
from mlscli.queries.flown import stated_vehicle, with_flown
from mlscli.queries.obstacles import bounds
from mlscli.runtime.arrays import Array, Float64, Int64

LEAST = 2
"""So many sight lines show that a voxel is free, as by default for a clearance."""

STEPS = 1024
"""Steps that lengths beyond the ends of patches are rounded up to, of a cell."""

COLOURS = {
    "blocked": ARTIFICIAL_RED,
    "doubtful": DOUBTFUL_ORANGE,
    "unseen": UNSEEN_GREY,
    "touching": TOUCHING,
    "clear": CLEAR,
}


class Beyond(NamedTuple):
    """How far obstacles reach beyond the ends of their patches, in steps, int64 (P,) each.

    Attributes
    ----------
    below, over : int64 (P,)
        The points of the patch, below its lower end and over its upper one.
    bound : int64 (P,)
        How far its ends may be off.
    """

    below: Int64
    over: Int64
    bound: Int64

    @classmethod
    def of(cls, surface: SurfaceMap, rounded: float) -> Beyond:
        """Return those of a map whose ends are rounded by up to so much."""
        step = surface.cell_size / STEPS

        def up(lengths: Float64) -> Int64:
            # A step more or less is far less than what a map can tell.
            return np.ceil(np.minimum(lengths / step, 2.0**30)).astype(np.int64)

        low, high = surface.low_end, surface.height
        below = low - np.fmin(low, surface.bottom)
        over = np.fmax(high, surface.top) - high
        return cls(up(below), up(over), up(bounds(surface) + rounded))


def seen_runs(surface: SurfaceMap) -> dict[str, Array] | None:
    """Return the voxels that are free, those above one another as one; None: it is not known.

    Returns
    -------
    dict
        ``ix`` and ``iy``, int32 (C,), of cells; ``count``, how many runs each has; and of these
        runs, ``low``, int32 (R,), the lowest voxel, and ``length``, how many there are.
    """
    free = with_flown(surface).free
    if free is None:
        return None
    kept = np.flatnonzero(free.lines >= LEAST)
    cell = np.searchsorted(free.start, kept, side="right") - 1
    iz = free.iz[kept].astype(np.int64)
    # A new run begins where the cell changes, or a voxel is left out.
    key = cell * 2**33 + iz - np.arange(len(kept))
    begin = runs(key)[:-1] if len(kept) else np.empty(0, dtype=np.int64)
    length = np.diff(np.append(begin, len(kept)))
    cells, count = np.unique(cell[begin], return_counts=True)
    return {
        "ix": free.ix[cells],
        "iy": free.iy[cells],
        "count": count,
        "low": iz[begin],
        "length": length,
    }


def first_craft(surface: SurfaceMap) -> tuple[float, float]:
    """Return width and height of the craft to begin with: the stated vehicle, or a cell."""
    return stated_vehicle(surface) or (surface.cell_size, surface.cell_size)
