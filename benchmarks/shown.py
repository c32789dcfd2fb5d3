"""Maps of figures, numbers for what one sees in them, claims about them, and tables of both."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from mlscli.maps.surface_map import MEASURED, SurfaceMap
from mlscli.runtime.arrays import Bool, Float64
from mlscli.scenes.flight import Flight
from mlscli.scenes.truth import truth
from mlscli.scoring import Score, compare_maps, score
from mlscli.scoring.kernels import Patches, covered, nearby

Range = tuple[float, float]
Extent = tuple[int, int]


@dataclass(frozen=True, eq=False)
class Shown:
    """A map of one or more figures.

    Attributes
    ----------
    figures : str
        Numbers of the figures.
    what : str
        What was done, in words.
    flight : Flight
        The flight that the map was made of.
    surface : SurfaceMap
        The map.
    """

    figures: str
    what: str
    flight: Flight
    surface: SurfaceMap

    @cached_property
    def true(self) -> SurfaceMap:
        """The truth on the map's grid."""
        surface = self.surface
        return truth(self.flight.scene, surface.cell_size, surface.gap_size, surface.thickness)

    @cached_property
    def score(self) -> Score:
        """The score of the map against the truth."""
        return score(self.surface, self.true)

    @property
    def rmse(self) -> float:
        """Root mean square error of the heights of horizontal patches; 0 where none is compared."""
        return self.score.total.heights.rmse or 0.0

    @property
    def inserted(self) -> Bool:
        """Which patches are inserted, bool (P,)."""
        return np.asarray(self.surface.origin != MEASURED)

    @property
    def depths(self) -> Float64:
        """The depths of the vertical patches, float64 (V,)."""
        return self.surface.depth[self.surface.depth > 0]

    def off(self, cells: float = 0.5) -> Bool:
        """Return which patches are farther than `cells` cells from the truth in height, bool (P,).

        As in the score, true patches up to one cell sideways count.
        """
        mine, true = Patches.of(self.surface), Patches.of(self.true)
        near = nearby(mine.ix, mine.iy, true.ix, true.iy, 1)
        margin = cells * self.surface.cell_size
        return ~covered(mine.low, mine.high, near, true.low, true.high, margin)

    @cached_property
    def peaks(self) -> int:
        """How many patches are peaks, as `count_peaks` counts them."""
        return count_peaks(self.surface)

    def closing(self, x: Extent, y: Extent, z: Range) -> SurfaceMap:
        """Return the patches inserted into a box.

        Parameters
        ----------
        x, y : tuple of int
            Cell indices, the upper ends excluded.
        z : tuple of float
            Heights: patches that reach into this range.
        """
        part = self.surface.take(self.inserted).crop(x[0], x[1] - 1, y[0], y[1] - 1)
        return part.take((part.height >= z[0]) & (part.low_end <= z[1]))

    def closed(self, x: Extent, y: Extent, z: Range) -> int:
        """Count the cells of a box with an inserted patch, as `closing` takes the box."""
        return len(self.closing(x, y, z).cells.ix)


def count_peaks(surface: SurfaceMap) -> int:
    """Count patches that rise above all four neighbours (thesis, section 3.4).

    They rise above the highest neighbour by more than 1.5 times the height difference of the
    highest and the lowest one. Neighbours are the patches nearest in height in the four cells
    beside, all within `gap_size`.
    """
    columns = (surface.ix, surface.iy, surface.height)
    rows = list(zip(*(column.tolist() for column in columns), strict=True))
    heights = defaultdict[tuple[int, int], list[float]](list)
    for x, y, height in rows:
        heights[x, y].append(height)
    count = 0
    for x, y, height in rows:
        around = [
            min(heights.get(cell, [np.inf]), key=lambda other: abs(other - height))
            for cell in ((x - 1, y), (x + 1, y), (x, y - 1), (x, y + 1))
        ]
        if all(abs(other - height) <= surface.gap_size for other in around):
            count += height - max(around) > 1.5 * (max(around) - min(around))
    return count


class Claim(NamedTuple):
    """A claim about figures, and whether it holds.

    Attributes
    ----------
    figures : str
        Numbers of the figures.
    claim : str
        What they are to show, in words.
    numbers : sequence of float
        The two numbers that the verdict is based on.
    holds : bool
        The verdict.
    """

    figures: str
    claim: str
    numbers: Sequence[float]
    holds: bool


def less(figures: str, claim: str, numbers: Sequence[float]) -> Claim:
    """Return the claim that the second number is less than the first."""
    return Claim(figures, claim, numbers, numbers[1] < numbers[0])


def differing(one: Shown, other: Shown) -> int:
    """Count patches that only one of two maps has, or whose heights differ."""
    total = compare_maps(one.surface, other.surface).total
    return total.only_a + total.only_b + total.heights.beyond


def tables(rows: Iterable[Shown | Claim]) -> Iterator[str]:
    """Yield the lines of a table of the maps and of one of the claims."""
    rows = list(rows)
    yield f"| {' | '.join(_COLUMNS)} |"
    yield f"|{'|'.join([':--', ':--', *['--:'] * (len(_COLUMNS) - 2)])}|"
    yield from (_map_row(row) for row in rows if isinstance(row, Shown))
    yield ""
    yield "| figure | claim | first | second | |"
    yield "|:--|:--|--:|--:|:--|"
    for row in rows:
        if isinstance(row, Claim):
            verdict = "holds" if row.holds else "DOES NOT HOLD"
            numbers = " | ".join(map(_number, row.numbers))
            yield f"| {row.figures} | {row.claim} | {numbers} | {verdict} |"


_COLUMNS = (
    *("figure", "map", "points", "patches", "inserted", "false", "rmse", "complete", "correct"),
    *("depths", "their mean", "phantom", "peaks"),
)


def _map_row(shown: Shown) -> str:
    total = shown.score.total
    cells = (
        shown.figures,
        shown.what,
        f"{shown.flight.points:,}",
        f"{shown.surface.size:,}",
        f"{np.count_nonzero(shown.inserted):,}",
        f"{shown.score.false_levels:,}",
        f"{shown.rmse:.4f}",
        f"{total.completeness.share or 0.0:.1%}",
        f"{total.correctness.share or 0.0:.1%}",
        f"{len(shown.depths):,}",
        f"{shown.depths.mean():.2f}" if len(shown.depths) else "",
        f"{shown.score.phantom_closings.count:,}",
        f"{shown.peaks:,}",
    )
    return f"| {' | '.join(cells)} |"


def _number(value: float) -> str:
    return f"{value:.4f}" if isinstance(value, float) else f"{value:,}"
