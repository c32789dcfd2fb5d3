"""Hole plastering (thesis, section 3.5).

From each patch one looks along +x, and likewise +y, at distances d = 1, 2, ... cells. A patch
there is a candidate if its height differs by at most
``height_thresh * d * cell_size + height_clearance``. The first d with a candidate decides, and of
several the one nearest in height (equal: the higher). The gap, d - 1 cells wide, is closed if it
is narrow enough and the far patch, looking back, finds the near one. Horizontal patches on the
straight line between the two close it.

Pass one closes gaps up to `max_gap`; pass two reads its result and closes gaps up to
`max_gap_enhanced`. The thesis closed what it met first, along y before x; here both directions
read the same input and the higher patch stays, as its section 6.3 proposes.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

from mlscli.parameters import Cells, Length, in_units, parameter, whole_cells
from mlscli.pipeline.gaps import Intervals, close_gaps, gap_faults, passes, settle
from mlscli.pipeline.stage import Fault, MapStage
from mlscli.surface_map import SurfaceMap


@dataclass(frozen=True)
class Plaster(MapStage):
    """Close gaps between patches along x and y."""

    name: ClassVar[str] = "plaster"

    height_thresh: float = parameter(
        0.5, "steepest slope along which a gap is closed (rise over run)", low=0
    )
    height_clearance: Length = parameter(
        Cells(0.5), "height difference that is allowed besides the slope", low=0
    )
    max_gap: Length = parameter(
        Cells(1),
        "widest gap that is surely closed; its patches are plastered",
        low=0,
        default_from="vehicle.width",
    )
    max_gap_enhanced: Length = parameter(
        Cells(5),
        "widest gap that is closed at all; patches in gaps wider than max_gap are artificial; "
        "0: no second pass",
        low=0,
    )

    def faults(self, cell_size: float | None, gap_size: Length | None) -> Iterator[Fault]:
        """Yield a fault where the second pass would close less than the first."""
        yield from super().faults(cell_size, gap_size)
        yield from gap_faults(self.max_gap, self.max_gap_enhanced, cell_size)

    def reach(self, cell_size: float) -> int:
        """Return the widths of both passes in whole cells."""
        return whole_cells(self.max_gap, cell_size) + whole_cells(self.max_gap_enhanced, cell_size)

    def transform(self, surface: SurfaceMap) -> SurfaceMap:
        """Return the map with its gaps closed."""
        cell_size = surface.cell_size
        clearance = in_units(self.height_clearance, cell_size)
        for widths in passes(self.max_gap, self.max_gap_enhanced):
            heights = Intervals(surface.ix, surface.iy, surface.height, surface.height)
            closing = close_gaps(heights, widths, cell_size, self.height_thresh, clearance)
            surface = surface.with_inserted(*settle(closing, surface))
        return surface
