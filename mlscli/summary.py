"""What a map holds, in numbers."""

from __future__ import annotations

from typing import Any

import numpy as np

from mlscli.surface_map import ORIGINS, SurfaceMap


def describe(surface: SurfaceMap) -> dict[str, Any]:
    """Return patches by origin, levels, extents and area of a map, ready for JSON.

    Returns
    -------
    dict
        ``patches``: the total, by origin, and how many are vertical; ``cells``: how many are
        occupied; ``levels``: how many cells hold 1, 2, ... patches; ``extent``: lower and upper
        bounds of x, y (edges of cells) and z, None for an empty map; ``area``: of the occupied
        cells, in the square of the unit.
    """
    levels = np.bincount(np.diff(surface.cells.start), minlength=1)
    counted = np.bincount(surface.origin, minlength=len(ORIGINS))
    cells = len(surface.cells.ix)
    return {
        "patches": {
            "total": surface.size,
            **{name: int(count) for name, count in zip(ORIGINS, counted, strict=True)},
            "vertical": int(np.count_nonzero(surface.depth > 0)),
        },
        "cells": cells,
        "levels": {str(n): int(count) for n, count in enumerate(levels) if n and count},
        "extent": _extent(surface),
        "area": cells * surface.cell_size**2,
        "regions": int(surface.region.max(initial=-1)) + 1,
        "cell_size": surface.cell_size,
        "gap_size": surface.gap_size,
        "thickness": surface.thickness,
        "frame_id": surface.frame_id,
        "keyframes": len(surface.route),
    }


def _extent(surface: SurfaceMap) -> dict[str, list[float]] | None:
    if not surface.size:
        return None
    size = surface.cell_size
    return {
        "x": [float(surface.ix.min() * size), float((surface.ix.max() + 1.0) * size)],
        "y": [float(surface.iy.min() * size), float((surface.iy.max() + 1.0) * size)],
        "z": [float(surface.low_end.min()), float(surface.height.max())],
    }
