"""Hole plastering (thesis, section 3.5).

From each patch the search goes along +x, and likewise +y, at distances d = 1, 2, ... cells. A patch
there is a candidate if its height differs by at most
``height_thresh * d * cell_size + height_clearance``. The first d with a candidate decides, and of
several the one nearest in height (equal: the higher). The gap, d - 1 cells wide, is closed if it
is narrow enough and the far patch, looking back, finds the near one. Horizontal patches on the
straight line between the two close it.

Pass one closes gaps up to `max_gap`; pass two reads its result and closes gaps up to
`max_gap_enhanced`. The thesis closed what it met first, along y before x; here both directions
read the same input and the higher patch stays, as its section 6.3 proposes.

The thesis trusts a slope over the whole gap, so that a wide one joins surfaces of different levels.
With `slope_reach` the height difference allowed grows over that distance only. With `support`, a
gap wider than `max_gap` is closed only where it is level and both its ends are edges of surfaces, a
narrower one where both are edges or nothing lies in it. Without `over_lower` a wide gap is closed
only where no lower level was seen through it; `evidence.py` has the rules.
With `sight`, such a gap stays open where it was seen through, from where the craft is known to have
been; `unseen.py` has the rule.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from mlscli.maps.surface_map import SurfaceMap
from mlscli.parameters.fields import parameter
from mlscli.parameters.lengths import Cells, Length, in_units, whole_cells
from mlscli.pipeline.stages.evidence import Support, are_surfaces
from mlscli.pipeline.stages.gaps import (
    Gaps,
    GapStage,
    Intervals,
    Judge,
    Tolerance,
    Witness,
    close_gaps,
)
from mlscli.pipeline.stages.inserted import Inserted, settle
from mlscli.pipeline.stages.sights import Sights
from mlscli.pipeline.stages.unseen import unseen
from mlscli.runtime.arrays import Bool, Int64


@dataclass(frozen=True)
class Plaster(GapStage):
    """Close gaps between patches along x and y."""

    name: ClassVar[str] = "plaster"

    height_thresh: float = parameter(
        0.5, "steepest slope along which a gap is closed (rise over run)", low=0
    )
    height_clearance: Length = parameter(
        Cells(0.5), "height difference that is allowed besides the slope", low=0
    )
    slope_reach: Length = parameter(
        0,
        "distance beyond which the slope allows no more height; 0: it counts over the whole gap",
        low=0,
    )

    support: int = parameter(
        0,
        "gaps wider than max_gap are closed only where they are level, and so many of the five "
        "cells behind and beside each end hold a patch level with it, within height_clearance; "
        "others, where patches of other heights lie in them, if so many hold one within "
        "height_thresh besides",
        low=0,
        high=5,
    )
    over_lower: bool = parameter(
        True,
        "whether gaps wider than max_gap are closed above patches that lie deeper than gap_size",
    )

    sight: Length = parameter(
        0,
        "gaps wider than max_gap stay open where points were seen through them, from where the "
        "craft is known to have been; points count up to so far beside a gap; 0: none",
        low=0,
    )

    def sight_reach(self, cell_size: float) -> int:
        """Return how far beside a gap points count, in whole cells; 0 without a second pass."""
        return whole_cells(self.sight, cell_size) if len(list(self.passes(cell_size))) > 1 else 0

    def reach(self, cell_size: float) -> int:
        """Return the widths of both passes in whole cells, and one for each if ends need support.

        Pass two can need what pass one has inserted, and so what supports that.
        """
        return super().reach(cell_size) + len(list(self.passes(cell_size))) * (self.support > 0)

    def transform(self, surface: SurfaceMap) -> SurfaceMap:
        """Return the map with its gaps closed."""
        return self._closed(surface, None)

    def transform_seen(self, surface: SurfaceMap, sights: Sights) -> SurfaceMap:
        """Return the map with its gaps closed, but for wide ones that were seen through."""
        return self._closed(surface, sights)

    def _closed(self, surface: SurfaceMap, sights: Sights | None) -> SurfaceMap:
        cell_size = surface.cell_size
        tolerance = Tolerance(
            cell_size,
            self.height_thresh,
            in_units(self.height_clearance, cell_size),
            in_units(self.slope_reach, cell_size) / cell_size or np.inf,
        )
        for widths in self.passes(cell_size):
            heights = Intervals(surface.cells, surface.height, surface.height)
            judge = self._judge(surface, tolerance)
            witness = self._witness(surface, sights)
            closing = close_gaps(heights, widths, tolerance, judge, witness)
            surface = surface.with_inserted(*settle(closing, surface))
        return surface

    def _witness(self, surface: SurfaceMap, sights: Sights | None) -> Witness | None:
        """Return what tells through which wide gaps nothing was seen; None: nobody asks."""
        farthest = self.sight_reach(surface.cell_size)
        if sights is None or not farthest:
            return None

        def witness(gap: Int64, closing: Inserted) -> Bool:
            return unseen(gap, closing, sights, surface.cell_size, farthest)

        return witness

    def _judge(self, surface: SurfaceMap, tolerance: Tolerance) -> Judge | None:
        """Return what tells which gaps are in a surface; None: nobody asks."""
        if not self.support and self.over_lower:
            return None
        beside = tolerance.clearance + tolerance.slope * tolerance.cell_size
        narrow = Support(beside, self.support)
        wide = Support(tolerance.clearance if self.support else np.inf, self.support)
        deepest = np.inf if self.over_lower else surface.gap_size

        def judge(gaps: Gaps) -> Bool:
            holds: Bool = are_surfaces(*gaps, surface.cells, surface.height, narrow, wide, deepest)
            return holds

        return judge
