"""Patches to be inserted into a map, and which of them find room there."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from mlscli.maps.order import OccupiedCells
from mlscli.maps.patches import within_gap
from mlscli.maps.surface_map import SurfaceMap
from mlscli.pipeline.stages.ordering import order_by_cell
from mlscli.runtime.arrays import Bool, Float64, Int32, Int64, UInt8
from mlscli.runtime.kernels import kernel


class Inserted(NamedTuple):
    """Patches to be inserted into a map.

    Attributes
    ----------
    ix, iy : int32 (N,)
        Cell indices.
    height, depth : float64 (N,)
        Upper end of a patch and its extent below, in the unit of the recording.
    origin : uint8 (N,)
        1 plastered, 2 artificial.
    """

    ix: Int32
    iy: Int32
    height: Float64
    depth: Float64
    origin: UInt8

    @property
    def low_end(self) -> Float64:
        """Lower end of each patch."""
        return self.height - self.depth

    def take(self, which: Bool | Int64) -> Inserted:
        """Return the patches that a mask or indices select."""
        columns: list[Any] = [column[which] for column in self]
        return Inserted(*columns)

    def union(self, other: Inserted) -> Inserted:
        """Return the patches of both."""
        if not len(other.ix):
            return self
        pairs: list[Any] = list(zip(self, other, strict=True))
        return Inserted(*map(np.concatenate, pairs))


def settle(inserted: Inserted, surface: SurfaceMap, holes: Inserted | None = None) -> Inserted:
    """Return the inserted patches that find room, ascending by cell and height.

    None may be within `gap_size` of a patch that its cell has, or of a patch that fills a hole in
    that cell. Where several meet, the highest stays (equal: the lower origin, then the greater
    depth), then going down the next that is more than `gap_size` below the last that stayed: the
    highest is the nearest obstacle to a craft above.

    Parameters
    ----------
    inserted : Inserted
        Candidates, in any order.
    surface : SurfaceMap
        The map into which they are to be inserted.
    holes : Inserted, optional
        Patches that fill holes in cells, ascending by cell.
    """
    if not len(inserted.ix):
        return inserted
    gap_size = surface.gap_size
    order, cells, high = order_by_cell(inserted.ix, inserted.iy, inserted.height)
    inserted = inserted.take(order)
    low = inserted.low_end
    mine = cells, low, high
    near = within_gap(*mine, surface.cells, surface.low_end, surface.height, gap_size)
    if holes is not None and len(holes.ix):
        there = OccupiedCells.of(holes.ix, holes.iy)
        near |= within_gap(*mine, there, holes.low_end, holes.height, gap_size)
    stays = ~near
    _choose_from_above(cells.start, low, *inserted[2:], gap_size, stays)
    return inserted.take(stays)


@kernel
def _choose_from_above(
    start: Int64,
    low: Float64,
    high: Float64,
    depth: Float64,
    origin: UInt8,
    gap_size: float,
    stays: Bool,
) -> None:
    """Let the highest of each cell stay, and those more than `gap_size` below the last that stayed.

    Parameters
    ----------
    start : int64 (C + 1,)
        Where the patches of each cell begin.
    low, high : float64 (N,)
        Lower and upper end of each patch; upper ends ascend in each cell.
    depth : float64 (N,)
        Extent of each patch.
    origin : uint8 (N,)
        Origin of each patch.
    gap_size : float
        In the unit of the recording.
    stays : bool (N,)
        Which patches find room beside those of the map; set to False where one does not stay.
    """
    for cell in range(len(start) - 1):
        last = -1
        for i in range(start[cell + 1] - 1, start[cell] - 1, -1):
            if not stays[i]:
                continue
            if last < 0 or low[last] - high[i] > gap_size:
                last = i
            elif high[i] == high[last] and (
                origin[i] < origin[last] or (origin[i] == origin[last] and depth[i] > depth[last])
            ):
                stays[last] = False
                last = i
            else:
                stays[i] = False
