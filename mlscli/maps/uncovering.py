"""A finished map uncovered keyframe by keyframe.

A measured patch appears with its first keyframe. An inserted one appears with the last of the
measured patches nearest to it, as it was derived from patches around it. Nothing is recorded for
this: what shows is a part of the finished map, not the map as it was at the time.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mlscli.maps.change import Change
from mlscli.maps.surface_map import MEASURED, SurfaceMap
from mlscli.runtime.arrays import Float64, Int32
from mlscli.runtime.tree import Tree

# An inserted patch lies between patches along x, along y, or both.
NEAREST_PATCHES = 4


def patch_places(surface: SurfaceMap) -> Float64:
    """Return the centre of each patch's cell at the patch's height, float64 (P, 3)."""
    centre = (np.column_stack((surface.ix, surface.iy)) + 0.5) * surface.cell_size
    return np.column_stack((centre, surface.height))


def appearing(surface: SurfaceMap) -> Int32:
    """Return the keyframe with which each patch appears, int32 (P,), a row of the route."""
    when = surface.first_keyframe.copy()
    measured = surface.origin == MEASURED
    inserted = np.flatnonzero(~measured)
    if not len(inserted) or not measured.any():
        return np.maximum(when, 0)

    place = patch_places(surface)
    count = min(NEAREST_PATCHES, int(measured.sum()))
    _, near = Tree(place[measured]).nearest(place[inserted], count)
    when[inserted] = when[measured][near].max(axis=1)
    return when


def growth(surface: SurfaceMap) -> Iterator[Change]:
    """Yield a change for each keyframe with which patches appear.

    It adds these patches, and the rows of the route from the change before up to this keyframe.
    """
    when = appearing(surface)
    nothing = surface.take(np.zeros(surface.size, dtype=np.bool_))
    begin = 0
    for keyframe in np.unique(when).tolist():
        route = surface.route[begin : keyframe + 1]
        yield Change.of(nothing, surface.take(when == keyframe), route)
        begin = keyframe + 1
