"""Region growing (thesis, section 3.2): which patches make one surface.

Patches in cells that share an edge and whose heights differ by at most `height_thresh` belong to
one region, transitively. Regions of fewer than `min_size` patches are removed, the rest numbered
from 0 in the order of their first patch.

With `snap`, the thesis's purpose for regions, a patch of a region that is too small is moved to
the nearest height (equal: the higher) that a kept region has in a cell that shares an edge, if
this is within `gap_size`; its depth is kept. It is removed where there is no such height, and where
moving brings it within `gap_size` of another patch of its cell, at that one's old or new height.
Regions are then found anew.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from mlscli.maps.neighbours import beside
from mlscli.maps.patches import distance
from mlscli.maps.surface_map import SurfaceMap
from mlscli.parameters.fields import parameter
from mlscli.parameters.lengths import Cells, Length, in_units
from mlscli.pipeline.stages.stage import MapStage
from mlscli.runtime.arrays import Bool, Float64, Int32, Int64
from mlscli.runtime.kernels import inner, kernel


@dataclass(frozen=True)
class Regions(MapStage):
    """Number connected surfaces, and remove or move those that are too small."""

    name: ClassVar[str] = "regions"

    height_thresh: Length = parameter(
        Cells(1), "greatest height difference of neighbouring patches of one region", low=0
    )
    min_size: int = parameter(1, "regions of fewer patches are removed", low=1)
    snap: bool = parameter(
        False, "move patches of too small regions to the nearest surface, where there is one"
    )

    def reach(self, cell_size: float) -> None:  # noqa: ARG002
        """Return None: a region can span the whole map."""
        return

    def transform(self, surface: SurfaceMap) -> SurfaceMap:
        """Return the map with its regions numbered."""
        thresh = in_units(self.height_thresh, surface.cell_size)
        region = _grow(*surface.cells, surface.height, thresh)
        kept = np.bincount(region, minlength=1)[region] >= self.min_size
        if self.snap:
            height, found = _snapped(
                *surface.cells, surface.height, surface.depth, kept, surface.gap_size
            )
            surface = surface.with_columns(height=height, region=found.astype(np.int32))
            surface = surface.take(surface.region == 1)
            region = _grow(*surface.cells, surface.height, thresh)
        else:
            surface, region = surface.take(kept), region[kept]
        return surface.with_columns(region=_numbered(region))


@inner
def _root(parent: Int64, i: int) -> int:
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@kernel
def _grow(ix: Int32, iy: Int32, start: Int64, height: Float64, thresh: float) -> Int64:
    """Return for each patch the first patch of its region."""
    parent = np.arange(len(height))
    four = beside(ix, iy)
    for cell in range(len(ix)):
        for there in (four[cell, 1], four[cell, 3]):
            if there < 0:
                continue
            for i in range(start[cell], start[cell + 1]):
                for j in range(start[there], start[there + 1]):
                    if abs(height[i] - height[j]) <= thresh:
                        one, other = _root(parent, i), _root(parent, j)
                        parent[max(one, other)] = min(one, other)
    for i in range(len(height)):
        parent[i] = _root(parent, i)
    return parent


def _numbered(first: Int64) -> Int32:
    """Return region numbers from 0, in the order of the regions' first patches."""
    is_first = np.zeros(first.max(initial=-1) + 1, dtype=np.bool_)
    is_first[first] = True
    number = np.cumsum(is_first) - 1
    return number[first].astype(np.int32)


@kernel
def _snapped(
    ix: Int32,
    iy: Int32,
    start: Int64,
    height: Float64,
    depth: Float64,
    kept: Bool,
    gap_size: float,
) -> tuple[Float64, Bool]:
    """Move patches that are not kept to kept ones beside them.

    Parameters
    ----------
    ix, iy : int32 (C,)
        The occupied cells, ascending.
    start : int64 (C + 1,)
        Where the patches of each cell begin.
    height, depth : float64 (P,)
        Of the patches as they are.
    kept : bool (P,)
        Whether a patch belongs to a region that is large enough.
    gap_size : float
        In the unit of the recording.

    Returns
    -------
    new : float64 (P,)
        The new heights.
    stays : bool (P,)
        Whether a patch stays.
    """
    new, stays = height.copy(), kept.copy()
    four = beside(ix, iy)
    for cell in range(len(ix)):
        for i in range(start[cell], start[cell + 1]):
            if kept[i]:
                continue
            least = np.inf
            for there in four[cell]:
                if there < 0:
                    continue
                for j in range(start[there], start[there + 1]):
                    apart = abs(height[j] - height[i])
                    if not kept[j] or apart > gap_size:
                        continue
                    if apart < least or (apart == least and height[j] > new[i]):
                        new[i], least, stays[i] = height[j], apart, True
    moved = stays & ~kept
    for cell in range(len(ix)):
        for i in range(start[cell], start[cell + 1]):
            if not moved[i]:
                continue
            for j in range(start[cell], start[cell + 1]):
                was = distance(new[i] - depth[i], new[i], height[j] - depth[j], height[j])
                now = distance(new[i] - depth[i], new[i], new[j] - depth[j], new[j])
                if j != i and (was <= gap_size or (moved[j] and now <= gap_size)):
                    stays[i] = False
    return new, stays
