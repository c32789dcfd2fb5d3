"""Wide gaps that were seen through: what would close one of them is no surface.

`sights.py` tells through which patches sight lines pass. A closing, all patches of one gap, is none
if enough of them pass through one of its patches. To judge each patch for itself would leave halves
of closings: lines do not reach every cell of a gap. Gaps that a craft cannot pass are not looked
at. The rule is new.
"""

from __future__ import annotations

import numpy as np

from mlscli.maps.surface_map import ARTIFICIAL
from mlscli.pipeline.stages.inserted import Inserted
from mlscli.pipeline.stages.sights import Sights
from mlscli.runtime.arrays import Bool, Int64


def unseen(gap: Int64, closing: Inserted, sights: Sights, cell_size: float, farthest: int) -> Bool:
    """Return which patches close gaps that are narrow or were not seen through, bool (N,).

    Parameters
    ----------
    gap : int64 (N,)
        The number of the gap that each patch would close, ascending.
    closing : Inserted
        The patches (N,); those of wide gaps are artificial.
    sights : Sights
        Nothing is asked about gaps without a cell in which it counts what was seen.
    cell_size : float
        Side of a cell, in the unit of the recording.
    farthest : int
        How many cells away, in x and in y, a point's sight line still counts.
    """
    wide = np.flatnonzero(closing.origin == ARTIFICIAL)
    if sights.cells is not None and len(wide):
        counts = sights.cells.contains(closing.ix[wide], closing.iy[wide])
        wide = wide[_any_of(gap, gap[wide[counts]])[wide]]
    asked = closing.ix[wide], closing.iy[wide], closing.height[wide]
    seen = sights.pass_through(*asked, cell_size, farthest)
    return ~_any_of(gap, gap[wide[seen]])


def _any_of(gap: Int64, chosen: Int64) -> Bool:
    """Return which patches belong to one of the gaps chosen, given the gap of each, ascending."""
    which = np.zeros(gap[-1] + 1 if len(gap) else 0, dtype=np.bool_)
    which[chosen] = True
    belongs: Bool = which[gap]
    return belongs
