"""A map against the truth, which is a map as well.

Errors in height of up to half a cell are allowed: patches that cover others are widened by half a
cell up and down.

- A true patch is **found** if the map's patches in its cell cover it.
- A map's patch is **correct** if the true patches in its cell and the eight around it cover it.

So the height of a horizontal patch must lie within half a cell of another patch; a vertical patch
must be covered from its lower end to its height.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from mlscli.errors import expect
from mlscli.maps.surface_map import MEASURED, ORIGINS, SurfaceMap
from mlscli.runtime.arrays import Bool, Float64, Int64
from mlscli.scoring.comparison import require_same_cells, root_mean_square
from mlscli.scoring.kernels import Patches, covered, nearby, nearest
from mlscli.scoring.places import count_by_place

# A correct patch may lie up to this many cells beside a true surface.
SIDEWAYS = 1


@dataclass(frozen=True)
class Share:
    """A count, as a share of a total.

    Attributes
    ----------
    count, of : int
        The count and the total.
    share : float or None
        Their quotient, 0 to 1; None where the total is 0.
    """

    count: int
    of: int
    share: float | None

    @classmethod
    def among(cls, chosen: Bool) -> Share:
        """Return the share that a mask, bool (N,), chooses."""
        count, of = int(np.count_nonzero(chosen)), len(chosen)
        return cls(count, of, count / of if of else None)

    @property
    def rest(self) -> int:
        """The total less the count."""
        return self.of - self.count


@dataclass(frozen=True)
class HeightErrors:
    """Errors of heights against true heights, in the unit of the map.

    Attributes
    ----------
    patches : int
        How many patches were compared.
    rmse : float or None
        Root mean square of the errors; None where no patch was compared, as below.
    bias : float or None
        Their mean; above 0: the map is too high.
    p95 : float or None
        95th percentile of their absolute values.
    """

    patches: int
    rmse: float | None
    bias: float | None
    p95: float | None

    @classmethod
    def of(cls, errors: Float64) -> HeightErrors:
        """Return the statistics of errors, float64 (N,): heights less the true ones."""
        if not len(errors):
            return cls(0, None, None, None)
        return cls(
            len(errors),
            root_mean_square(errors),
            float(errors.mean()),
            float(np.quantile(np.abs(errors), 0.95)),
        )


@dataclass(frozen=True)
class Measures:
    """Measures of a set of patches against the truth.

    Attributes
    ----------
    completeness : Share
        True patches that are found.
    completeness_horizontal, completeness_vertical : Share
        True horizontal patches that are found, and true vertical ones.
    correctness : Share
        Patches that are correct.
    heights : HeightErrors
        For each true horizontal patch, of the nearest horizontal patch in its cell, where that is
        within half a cell in height.
    flat_called_vertical : Share
        True horizontal patches whose nearest patch in their cell, within half a cell in height, is
        vertical.
    """

    completeness: Share
    completeness_horizontal: Share
    completeness_vertical: Share
    correctness: Share
    heights: HeightErrors
    flat_called_vertical: Share


@dataclass(frozen=True)
class Score:
    """The quality of a map against the truth.

    Attributes
    ----------
    true_cells : int
        How many cells hold a true patch.
    false_levels : int
        How many of the map's patches are not correct.
    false_levels_per_cell : float or None
        ``false_levels / true_cells``; None where there are no true cells.
    levels_missed : int
        How many true patches are not found.
    phantom_closings : Share
        Inserted patches (plastered or artificial) that are not correct: the map closes what is
        open in the truth.
    phantom_places : mapping of str to mapping
        How many phantom closings are in each of `mlscli.scoring.places.PLACES`, by origin.
    honest_red : Share
        Artificial patches that are correct.
    total : Measures
        Of the whole map.
    by_origin : mapping of str to Measures
        Of the measured, the plastered and the artificial patches, each as if they were the map; of
        measured ones what lies within their points.
    """

    true_cells: int
    false_levels: int
    false_levels_per_cell: float | None
    levels_missed: int
    phantom_closings: Share
    phantom_places: Mapping[str, Mapping[str, int]]
    honest_red: Share
    total: Measures
    by_origin: Mapping[str, Measures]

    def to_dict(self) -> dict[str, Any]:
        """Return all fields, ready for JSON."""
        return asdict(self)


def score(surface: SurfaceMap, truth: SurfaceMap) -> Score:
    """Measure a map against the truth.

    Parameters
    ----------
    surface : SurfaceMap
        The map.
    truth : SurfaceMap
        The true surfaces as a map of the same cell size and gap size; the origin of its patches
        does not matter.

    Returns
    -------
    Score

    Raises
    ------
    UsageError
        Where cell size or gap size differ.
    """
    expect(surface, SurfaceMap, "surface", "a map (SurfaceMap)")
    expect(truth, SurfaceMap, "truth", "a map (SurfaceMap)")
    require_same_cells(surface, truth)
    mine, true, half = Patches.of(surface), Patches.of(truth), surface.cell_size / 2
    total = _measure(mine, true, half)
    of_origin = [mine.take(surface.origin == origin) for origin in range(len(ORIGINS))]
    of_origin[MEASURED] = Patches.measured(surface)
    by_origin = {
        name: _measure(patches, true, half)
        for name, patches in zip(ORIGINS, of_origin, strict=True)
    }
    is_inserted = surface.origin != MEASURED
    inserted, origin = mine.take(is_inserted), surface.origin[is_inserted]
    phantom = ~_correct(inserted, true, half)
    true_cells, false_levels = len(truth.cells.ix), total.correctness.rest
    return Score(
        true_cells=true_cells,
        false_levels=false_levels,
        false_levels_per_cell=false_levels / true_cells if true_cells else None,
        levels_missed=total.completeness.rest,
        phantom_closings=Share.among(phantom),
        phantom_places=count_by_place(
            inserted.take(phantom), origin[phantom], true, surface.cell_size
        ),
        honest_red=by_origin["artificial"].correctness,
        total=total,
        by_origin=by_origin,
    )


def _measure(mine: Patches, true: Patches, half: float) -> Measures:
    """Measure patches against the true ones; `half` is half a cell."""
    found, correct = _found(true, mine, half), _correct(mine, true, half)
    flat, level = true.take(~true.vertical), mine.take(~mine.vertical)
    at_level, at_any = _nearest(flat, level, half), _nearest(flat, mine, half)
    compared = at_level >= 0
    # True patches without a near patch have the index -1: the last entry, which is False.
    vertical = np.append(mine.vertical, False)
    return Measures(
        completeness=Share.among(found),
        completeness_horizontal=Share.among(found[~true.vertical]),
        completeness_vertical=Share.among(found[true.vertical]),
        correctness=Share.among(correct),
        heights=HeightErrors.of(level.high[at_level[compared]] - flat.high[compared]),
        flat_called_vertical=Share.among(vertical[at_any]),
    )


def _found(true: Patches, mine: Patches, half: float) -> Bool:
    """Return which true patches are found."""
    return _covered(true, mine, half, reach=0)


def _correct(mine: Patches, true: Patches, half: float) -> Bool:
    """Return which patches of the map are correct."""
    return _covered(mine, true, half, reach=SIDEWAYS)


def _covered(patches: Patches, others: Patches, half: float, reach: int) -> Bool:
    """Return which patches the others in cells within `reach`, widened by `half`, cover."""
    near = nearby(patches.ix, patches.iy, others.ix, others.iy, reach)
    return covered(patches.low, patches.high, near, others.low, others.high, half)


def _nearest(flat: Patches, others: Patches, half: float) -> Int64:
    """Return for each flat patch the nearest in its cell, at most `half` away; -1: none."""
    near = nearby(flat.ix, flat.iy, others.ix, others.iy, 0)
    return nearest(flat.high, near, others.low, others.high, half)
