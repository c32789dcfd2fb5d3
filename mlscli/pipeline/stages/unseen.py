"""Wide gaps that were seen through: what would close one of them is no surface.

`sights.py` tells through which patches sight lines pass. A closing, all patches of one gap, is none
if enough of them pass through one of its patches. To judge each patch for itself would leave halves
of closings: lines do not reach every cell of a gap. Gaps that a craft cannot pass are not looked
at. The rule is new.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mlscli.maps.cells import CellSet
from mlscli.maps.order import OccupiedCells
from mlscli.pipeline.stages.gaps import Gaps, between
from mlscli.pipeline.stages.sights import Sights
from mlscli.runtime.arrays import Bool, Float64, Int32, Int64
from mlscli.runtime.kernels import kernel


def unseen(
    gaps: Sequence[Gaps],
    cells: OccupiedCells,
    height: Float64,
    sights: Sights,
    cell_size: float,
    farthest: int,
) -> list[Bool]:
    """Return which gaps are narrow or were not seen through, bool (G,) for each direction.

    Parameters
    ----------
    gaps : sequence of Gaps
        Those along each direction.
    cells : OccupiedCells
        The occupied cells, and where their patches begin.
    height : float64 (P,)
        The heights of all patches.
    sights : Sights
        Nothing is asked about gaps without a cell in which it counts what was seen.
    cell_size : float
        Side of a cell, in the unit of the recording.
    farthest : int
        How many cells away, in x and in y, a point's sight line still counts.
    """
    patches = [_inside(each, cells, height, sights.cells) for each in gaps]
    ix, iy, z = (np.concatenate(column) for column in list(zip(*patches, strict=True))[1:])
    seen = sights.pass_through(ix, iy, z, cell_size, farthest)
    holds = []
    for each, (gap, *_) in zip(gaps, patches, strict=True):
        holds.append(np.ones(len(each.pairs), dtype=np.bool_))
        holds[-1][gap[seen[: len(gap)]]] = False
        seen = seen[len(gap) :]
    return holds


def _inside(
    gaps: Gaps, cells: OccupiedCells, height: Float64, counting: CellSet | None
) -> tuple[Int64, Int32, Int32, Float64]:
    """Return what would close the wide gaps: as `_closings`, of gaps with a cell that counts."""
    gap, ix, iy, z = _closings(
        gaps.pairs, gaps.lines.position, cells.ix, cells.iy, height, gaps.certain
    )
    if counting is None or not len(gap):
        return gap, ix, iy, z
    counts = np.zeros(gap[-1] + 1, dtype=np.bool_)
    counts[gap[counting.contains(ix, iy)]] = True
    which = counts[gap]
    return gap[which], ix[which], iy[which], z[which]


@kernel
def _closings(
    pairs: Int64, position: Int32, ix: Int32, iy: Int32, height: Float64, certain: int
) -> tuple[Int64, Int32, Int32, Float64]:
    """Return the patches that would close the wide gaps.

    Parameters
    ----------
    pairs, certain
        As in `Gaps`.
    position : int32 (C,)
        Position of each occupied cell along its line.
    ix, iy : int32 (C,)
        The occupied cells.
    height : float64 (P,)
        Heights of all patches.

    Returns
    -------
    gap : int64 (N,)
        The gap of each patch.
    x, y : int32 (N,)
        Its cell.
    z : float64 (N,)
        Its height.
    """
    size = 0
    for cell, _, there, _ in pairs:
        width = position[there] - position[cell] - 1
        size += width if width > certain else 0
    gap, z = np.empty(size, dtype=np.int64), np.empty(size)
    x, y = np.empty(size, dtype=np.int32), np.empty(size, dtype=np.int32)
    n = 0
    for g in range(len(pairs)):
        cell, near, there, far = pairs[g]
        d = position[there] - position[cell]
        if d - 1 <= certain:
            continue
        along_x = ix[there] != ix[cell]
        for k in range(1, d):
            gap[n], z[n] = g, between(height[near], height[far], k, d)
            x[n] = ix[cell] + (k if along_x else 0)
            y[n] = iy[cell] + (0 if along_x else k)
            n += 1
    return gap, x, y, z
