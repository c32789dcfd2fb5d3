"""What a map holds, in numbers."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np

from mlscli.maps.free_space import FreeSpace
from mlscli.maps.georeference import georeference_of, is_turned
from mlscli.maps.stored_map import StoredMap, parts_of
from mlscli.maps.surface_map import ORIGINS, SurfaceMap


def describe(surface: SurfaceMap | StoredMap) -> dict[str, Any]:
    """Return patches by origin, levels, extents and area of a map, ready for JSON.

    Returns
    -------
    dict
        ``patches``: the total, by origin, how many are vertical, and how many measured ones a
        stage has moved beyond their points; ``uncertainty``: of how many measured patches the
        height's error is ``known``, the root mean square ``rms`` of what it is expected to be, None
        where of none, and how many are ``within`` a quarter of a cell by one standard deviation;
        ``cells``: how many are
        occupied; ``levels``: how many cells hold 1, 2, ... patches; ``extent``: lower and upper
        bounds of x, y (edges of cells) and z, None for an empty map; ``area``: of the occupied
        cells, in the square of the unit; ``regions``: the greatest region number plus 1;
        ``keyframes``: rows of the route; ``free_space``: how many ``voxels`` were seen through,
        how many of them ``twice`` or more, and the ``volume`` of all in the cube of the unit, None
        where the map does not say; ``georeference``: ``crs``, ``offset`` and ``source`` (see
        `Georeference`), ``name`` and ``of``, the frame that it is of, ``map`` or ``recording``, if
        the map was turned, None where not known; and the map's ``cell_size``, ``gap_size``,
        ``thickness`` and ``frame_id``.
    """
    grid = surface.grid
    counted = dict.fromkeys(("total", *ORIGINS, "vertical", "moved"), 0)
    levels: Counter[int] = Counter()
    extents = []
    regions, uncertain = 0, _Uncertainty()
    for part in parts_of(surface):
        counted["total"] += part.size
        for origin, name in enumerate(ORIGINS):
            counted[name] += int(np.count_nonzero(part.origin == origin))
        counted["vertical"] += int(np.count_nonzero(part.depth > 0))
        counted["moved"] += int(np.count_nonzero(part.moved))
        for level, count in enumerate(np.bincount(np.diff(part.cells.start)).tolist()):
            levels[level] += count
        extents += _extent(part)
        uncertain.add(part)
        regions = max(regions, int(part.region.max(initial=-1)) + 1)
    cells = sum(levels.values())
    return {
        "patches": counted,
        "uncertainty": uncertain.told(),
        "cells": cells,
        "levels": {str(n): count for n, count in sorted(levels.items()) if n and count},
        "extent": _hull(extents),
        "area": cells * grid.cell_size**2,
        "regions": regions,
        "cell_size": grid.cell_size,
        "gap_size": grid.gap_size,
        "thickness": grid.thickness,
        "frame_id": grid.frame_id,
        "keyframes": len(surface.route),
        "georeference": _placed(surface.meta),
        "free_space": None if surface.free is None else _seen_through(surface.free, grid.cell_size),
    }


def _placed(meta: Mapping[str, Any]) -> dict[str, Any] | None:
    found = georeference_of(meta)
    if found is None:
        return None
    frame = "recording" if is_turned(meta) else "map"
    return found.to_dict() | {"name": found.name, "of": frame}


class _Uncertainty:
    """How uncertain heights are, from part to part of a map."""

    def __init__(self) -> None:
        self._known, self._within, self._total = 0, 0, 0.0

    def add(self, part: SurfaceMap) -> None:
        known = part.height_variance
        known = known[~np.isnan(known)]
        self._known += len(known)
        self._within += int(np.count_nonzero(known <= (part.cell_size / 4) ** 2))
        self._total += float(known.sum())

    def told(self) -> dict[str, Any]:
        rms = math.sqrt(self._total / self._known) if self._known else None
        return {"known": self._known, "rms": rms, "within": self._within}


def _seen_through(free: FreeSpace, cell_size: float) -> dict[str, Any]:
    return {
        "voxels": free.size,
        "twice": int(np.count_nonzero(free.lines > 1)),
        "volume": free.size * cell_size**3 / 2,
    }


def _extent(surface: SurfaceMap) -> list[tuple[list[float], list[float]]]:
    """Return a pair of the least and the greatest x, y and z; no pair for an empty map."""
    if not surface.size:
        return []
    size = surface.cell_size
    low = [surface.ix.min() * size, surface.iy.min() * size, surface.low_end.min()]
    high = [
        (surface.ix.max() + 1.0) * size,
        (surface.iy.max() + 1.0) * size,
        surface.height.max(),
    ]
    return [([float(end) for end in low], [float(end) for end in high])]


def _hull(extents: list[tuple[list[float], list[float]]]) -> dict[str, list[float]] | None:
    if not extents:
        return None
    lows, highs = zip(*extents, strict=True)
    ends = zip(zip(*lows, strict=True), zip(*highs, strict=True), strict=True)
    return {axis: [min(low), max(high)] for axis, (low, high) in zip("xyz", ends, strict=True)}
