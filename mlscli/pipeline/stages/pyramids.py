"""Pyramid artefacts (thesis, section 3.4): lone patches that stand out above all neighbours.

A neighbour is, in each of the four direct cells, the patch nearest in height (equal: the higher),
if it is at most `max_height` away in height. For a patch with all four, let `high` and `low` be
the highest and the lowest of their heights. If
``height - high > height_factor_thresh * (high - low)``, the height becomes `high`; the lower end
stays where it is, unless it lies above `high`. Where that brings the patch within `gap_size` of
another of its cell, it doubles that surface and is removed instead. A patch within `gap_size` of
another of its cell is no pyramid.

Noise makes as many pits as pyramids. With `pits`, a horizontal patch with
``low - height > height_factor_thresh * (high - low)`` is raised to `low` likewise.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from mlscli.maps.neighbours import is_at, sought
from mlscli.maps.patches import distance
from mlscli.maps.surface_map import SurfaceMap
from mlscli.parameters.fields import parameter
from mlscli.parameters.lengths import Length, exceeds, in_units
from mlscli.pipeline.stages.stage import Fault, MapStage
from mlscli.runtime.arrays import Bool, Float64, Int32, Int64
from mlscli.runtime.kernels import inner, kernel
from mlscli.runtime.threads import LIGHT, in_ranges


@dataclass(frozen=True)
class Pyramids(MapStage):
    """Lower patches that stand out above all four neighbours."""

    name: ClassVar[str] = "pyramids"

    height_factor_thresh: float = parameter(
        1.5,
        "a patch is lowered that rises above its highest neighbour by more than so many times "
        "the neighbours' height difference",
        low=0,
    )
    max_height: Length | None = parameter(
        None,
        "greatest height difference of a patch and its neighbour; at most gap_size",
        low=0,
        default_from="map.gap_size",
    )

    pits: bool = parameter(
        False, "raise horizontal patches that lie as far below all four neighbours"
    )

    def faults(self, cell_size: float | None, gap_size: Length | None) -> Iterator[Fault]:
        """Yield a fault where a neighbour could be a patch of another level."""
        yield from super().faults(cell_size, gap_size)
        if self.max_height is None or gap_size is None:
            return
        if exceeds(self.max_height, gap_size, cell_size):
            yield Fault("max_height", f"{self.max_height} exceeds gap_size; at most {gap_size}")

    def reach(self, cell_size: float) -> int:  # noqa: ARG002
        """Return 1: only direct neighbours count."""
        return 1

    def transform(self, surface: SurfaceMap) -> SurfaceMap:
        """Return the map without its pyramids."""
        limit = surface.gap_size
        if self.max_height is not None:
            limit = min(limit, in_units(self.max_height, surface.cell_size))
        height, depth = surface.height.copy(), surface.depth.copy()
        stays = np.ones(surface.size, dtype=np.bool_)

        def lower(begin: int, end: int) -> bool:
            return _lower(
                begin, end, *surface.cells, surface.height, surface.depth,
                surface.gap_size, self.height_factor_thresh, limit, self.pits,
                height, depth, stays,
            )  # fmt: skip

        if not any(in_ranges(len(surface.cells.ix), lower, weight=LIGHT)):
            return surface
        return surface.with_columns(height=height, depth=depth).take(stays)


@kernel
def _lower(
    begin: int,
    end: int,
    ix: Int32,
    iy: Int32,
    start: Int64,
    height: Float64,
    depth: Float64,
    gap_size: float,
    factor: float,
    max_height: float,
    pits: bool,
    new_height: Float64,
    new_depth: Float64,
    stays: Bool,
) -> bool:
    """Find new heights and depths in cells `begin` to `end`; return whether there are any.

    Parameters
    ----------
    begin, end : int
        Range of cells.
    ix, iy : int32 (C,)
        The occupied cells, ascending.
    start : int64 (C + 1,)
        Where the patches of each cell begin.
    height, depth : float64 (P,)
        Of the patches as they are.
    gap_size : float
        In the unit of the recording.
    factor : float
        The parameter `height_factor_thresh`.
    max_height : float
        Greatest height difference of a patch and its neighbour, in the unit of the recording.
    pits : bool
        Whether pits are raised.
    new_height, new_depth : float64 (P,)
        Copies of `height` and `depth`, which are changed where a patch is moved.
    stays : bool (P,)
        Receives False for patches that are removed.
    """
    moved = False
    left = right = -1
    for cell in range(begin, end):
        x, y = np.int64(ix[cell]), np.int64(iy[cell])
        left, right = sought(ix, iy, left, x - 1, y), sought(ix, iy, right, x + 1, y)
        if not (
            is_at(ix, iy, left, x - 1, y)
            and is_at(ix, iy, right, x + 1, y)
            and is_at(ix, iy, cell - 1, x, y - 1)
            and is_at(ix, iy, cell + 1, x, y + 1)
        ):
            continue
        bottom, top = start[cell], start[cell + 1]
        for i in range(bottom, top):
            low_end = height[i] - depth[i]
            if top - bottom > 1 and _meets_another(
                i, bottom, top, low_end, height[i], height, depth, gap_size
            ):
                continue
            neighbours = 0
            high, low = -np.inf, np.inf
            for there in (left, right, cell - 1, cell + 1):
                nearest, least = height[i], np.inf
                for j in range(start[there], start[there + 1]):
                    apart = abs(height[j] - height[i])
                    # Heights ascend in a cell: of two equally near ones the later is the higher.
                    if apart <= least:
                        nearest, least = height[j], apart
                neighbours += least <= max_height
                high, low = max(high, nearest), min(low, nearest)
            if neighbours < 4:
                continue
            if height[i] - high > factor * (high - low):
                new_height[i], new_depth[i] = high, max(0.0, high - low_end)
            elif pits and depth[i] == 0 and low - height[i] > factor * (high - low):
                new_height[i] = low
            else:
                continue
            low_end = new_height[i] - new_depth[i]
            stays[i] = not _meets_another(
                i, bottom, top, low_end, new_height[i], height, depth, gap_size
            )
            moved = True
    return moved


@inner
def _meets_another(
    i: int,
    begin: int,
    end: int,
    low_end: float,
    high_end: float,
    height: Float64,
    depth: Float64,
    gap_size: float,
) -> bool:
    """Return whether [low_end, high_end] is within `gap_size` of a patch other than i.

    Parameters
    ----------
    i : int
        A patch.
    begin, end : int
        Range of the patches of its cell.
    low_end, high_end : float
        An interval in height.
    height, depth : float64 (P,)
        Of all patches.
    gap_size : float
        In the unit of the recording.
    """
    for j in range(begin, end):
        apart = distance(low_end, high_end, height[j] - depth[j], height[j])
        if j != i and apart <= gap_size:
            return True
    return False
