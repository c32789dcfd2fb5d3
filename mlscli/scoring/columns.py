"""The columns of a map against those of a dense scan: where upright things end, and the levels.

The points of the scan are grouped in each cell as a map's are, by its `gap_size` and `thickness`,
with no stage before. An *upright* is a group that is vertical and at least `gap_size` high: it has
an upper and a lower end. In the map it ends where the patches end that come within half a cell of
it, in its cell.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mlscli.errors import expect
from mlscli.keyframes.batches import Points
from mlscli.maps.cells import on_grid
from mlscli.maps.surface_map import SurfaceMap
from mlscli.pipeline.grouping import group
from mlscli.runtime.arrays import Array, Bool, Float64, Int64
from mlscli.runtime.kernels import kernel
from mlscli.scoring.kernels import Patches, covered, nearby
from mlscli.scoring.near import checked_scan
from mlscli.scoring.truth import Share


@dataclass(frozen=True)
class EndErrors:
    """How far ends in the map lie above those of the scan; below 0: under them.

    Attributes
    ----------
    median, p5, p95 : float or None
        Median, 5th and 95th percentile, in the unit of the map; None where there are no ends.
    too_low, too_high : Share
        Ends that are off by more than the distance.
    """

    median: float | None
    p5: float | None
    p95: float | None
    too_low: Share
    too_high: Share

    @classmethod
    def of(cls, errors: Float64, within: float) -> EndErrors:
        """Return the statistics of errors, float64 (N,)."""
        shares = Share.among(errors < -within), Share.among(errors > within)
        if not len(errors):
            return cls(None, None, None, *shares)
        p5, median, p95 = np.quantile(errors, (0.05, 0.5, 0.95)).tolist()
        return cls(median, p5, p95, *shares)


@dataclass(frozen=True)
class ColumnScore:
    """How well the columns of a map and of a scan agree.

    Attributes
    ----------
    levels_agree : Share
        Cells with points of the scan in which the map has as many levels as the scan, and each
        covers one of the other, as in `mlscli.scoring.score`, to within the distance.
    uprights_missed : Share
        Uprights of the scan where the map has no patch.
    upper_ends, lower_ends : EndErrors
        Of the uprights that are not missed.
    """

    levels_agree: Share
    uprights_missed: Share
    upper_ends: EndErrors
    lower_ends: EndErrors


def score_columns(surface: SurfaceMap, scan: Array, within: float) -> ColumnScore:
    """Compare the columns of a map with those of a scan.

    Parameters
    ----------
    surface : SurfaceMap
    scan : (N, 3), of any numbers
        The points of the scan that count, in the map frame.
    within : float
        Ends, and levels, that are no farther off pass for right; in the unit of the map.

    Returns
    -------
    ColumnScore

    Raises
    ------
    TypeError, UsageError, InputError
        As for `score_mesh`.
    """
    expect(surface, SurfaceMap, "surface", "a map (SurfaceMap)")
    xyz = checked_scan(scan, within)
    # No map has patches in cells beyond.
    xyz = xyz[on_grid(xyz, surface.cell_size)]
    points = Points.of(xyz, np.zeros(len(xyz), dtype=np.int32))
    scanned = group(points, surface.grid)
    mine, true = Patches.of(surface), Patches.of(scanned)
    tall = true.take(true.vertical & (scanned.depth >= surface.gap_size))
    near = nearby(tall.ix, tall.iy, mine.ix, mine.iy, 0)
    lower, upper = _ends(tall, near, mine, surface.cell_size / 2)
    met = lower <= upper
    return ColumnScore(
        levels_agree=Share.among(_agree(mine, true, within)),
        uprights_missed=Share.among(~met),
        upper_ends=EndErrors.of(upper[met] - tall.high[met], within),
        lower_ends=EndErrors.of(lower[met] - tall.low[met], within),
    )


@kernel
def _ends(tall: Patches, near: Int64, mine: Patches, margin: float) -> tuple[Float64, Float64]:
    """Return the lowest and the highest end of the patches that each upright meets.

    Parameters
    ----------
    tall : Patches
        The uprights.
    near : int64 (U, 1, 2)
        The map's patches in the cell of each, as `nearby` returns them.
    mine : Patches
        Those of the map.
    margin : float
        How far apart they may be to meet.

    Returns
    -------
    lower, upper : float64 (U,)
        Infinity and its negative where an upright meets none.
    """
    lower, upper = np.full(len(tall.high), np.inf), np.full(len(tall.high), -np.inf)
    for i in range(len(tall.high)):
        for j in range(near[i, 0, 0], near[i, 0, 1]):
            if mine.low[j] - tall.high[i] <= margin and tall.low[i] - mine.high[j] <= margin:
                lower[i], upper[i] = min(lower[i], mine.low[j]), max(upper[i], mine.high[j])
    return lower, upper


def _agree(mine: Patches, true: Patches, within: float) -> Bool:
    """Return in which cells of the true patches the levels of the map agree with them, bool (C,).

    The cells ascend by (ix, iy).
    """
    new = np.ones(len(true.ix), dtype=np.bool_)
    new[1:] = (true.ix[1:] != true.ix[:-1]) | (true.iy[1:] != true.iy[:-1])
    first = np.flatnonzero(new)
    theirs = nearby(true.ix, true.iy, mine.ix, mine.iy, 0)
    number = np.diff(np.append(first, len(true.ix)))
    same: Bool = np.diff(theirs[first, 0], axis=1)[:, 0] == number
    is_found = covered(true.low, true.high, theirs, mine.low, mine.high, within)
    others = nearby(mine.ix, mine.iy, true.ix, true.iy, 0)
    is_right = covered(mine.low, mine.high, others, true.low, true.high, within)
    wrong = np.append(0, np.cumsum(~is_right))
    begin, end = theirs[first, 0].T
    agree: Bool = same & np.logical_and.reduceat(is_found, first) & (wrong[end] == wrong[begin])
    return agree
