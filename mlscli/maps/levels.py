"""Which level of its cell each patch is."""

from __future__ import annotations

import numpy as np

from mlscli.maps.surface_map import SurfaceMap
from mlscli.runtime.arrays import Int64


def level_of(surface: SurfaceMap) -> Int64:
    """Return the level of each patch, int64 (P,): 0 is the lowest of its cell, 1 the next."""
    start = surface.cells.start
    levels: Int64 = np.arange(surface.size) - np.repeat(start[:-1], np.diff(start))
    return levels
