"""A map against the truth, which is a map as well.

Half a cell in height is near enough: each patch is widened by that up and down, and then

- a true patch is **found** if the map's patches of its cell cover it;
- a map's patch is **correct** if the true patches of its cell and the eight around cover it.

So a horizontal patch, a height, must lie within half a cell of one of the others, or within half a
cell of a vertical one's interval; a vertical patch must be covered from its lower end to its
height. Everything else is counted from these two.
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

# How many cells beside a true surface a correct patch may lie.
SIDEWAYS = 1


@dataclass(frozen=True)
class Share:
    """How many of how many.

    Attributes
    ----------
    count, of : int
        ``count`` of ``of``.
    share : float or None
        Their quotient; None of nothing.
    """

    count: int
    of: int
    share: float | None

    @classmethod
    def among(cls, chosen: Bool) -> Share:
        """Count those that a mask (N,) chooses."""
        count, of = int(np.count_nonzero(chosen)), len(chosen)
        return cls(count, of, count / of if of else None)

    @property
    def rest(self) -> int:
        """How many are not counted."""
        return self.of - self.count


@dataclass(frozen=True)
class HeightErrors:
    """Heights against true heights.

    Attributes
    ----------
    patches : int
        How many were compared.
    rmse, bias, p95 : float or None
        Root of the mean square, mean (above 0: too high) and 95th percentile of the absolute
        errors; None where none was compared. In the unit of the map.
    """

    patches: int
    rmse: float | None
    bias: float | None
    p95: float | None

    @classmethod
    def of(cls, errors: Float64) -> HeightErrors:
        """Measure errors (N,), each a height less the true one."""
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
    """What patches are worth against the truth.

    Attributes
    ----------
    completeness : Share
        True patches that are found.
    completeness_horizontal, completeness_vertical : Share
        True horizontal patches that are found, and true vertical ones.
    correctness : Share
        Patches that are correct.
    heights : HeightErrors
        Of the nearest horizontal patch in the cell of each true horizontal one, where it is
        within half a cell.
    flat_called_vertical : Share
        True horizontal patches of which the nearest patch in their cell, within half a cell, is
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
    """What a map is worth against the truth.

    Attributes
    ----------
    true_cells : int
        Cells that hold a true patch.
    false_levels : int
        Map patches that are not correct.
    false_levels_per_cell : float or None
        Of these, how many for each true cell.
    levels_missed : int
        True patches that are not found.
    phantom_closings : Share
        Inserted map patches (plastered or artificial) that are not correct: what the map closed
        where the truth is open.
    phantom_places : mapping
        How many of them are in each of `mlscli.scoring.places.PLACES`, by origin.
    honest_red : Share
        Artificial map patches that are correct.
    total : Measures
        Of the whole map.
    by_origin : mapping
        Of the measured, the plastered and the artificial patches, each as if they were the map.
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
        """Return all of it, ready for JSON."""
        return asdict(self)


def score(surface: SurfaceMap, truth: SurfaceMap) -> Score:
    """Measure a map against the truth.

    Parameters
    ----------
    surface
        The map.
    truth
        The true surfaces as a map of the same grid; the origin of its patches does not matter.

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
    by_origin = {
        name: _measure(mine.take(surface.origin == origin), true, half)
        for origin, name in enumerate(ORIGINS)
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
    found, correct = _found(true, mine, half), _correct(mine, true, half)
    flat, level = true.take(~true.vertical), mine.take(~mine.vertical)
    at_level, at_any = _nearest(flat, level, half), _nearest(flat, mine, half)
    compared = at_level >= 0
    # The one more, for flat patches without any near them, is not vertical.
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
    """Tell which true patches the map's patches of their cell cover."""
    return _covered(true, mine, half, reach=0)


def _correct(mine: Patches, true: Patches, half: float) -> Bool:
    """Tell which map patches the true patches in and around their cell cover."""
    return _covered(mine, true, half, reach=SIDEWAYS)


def _covered(patches: Patches, others: Patches, half: float, reach: int) -> Bool:
    near = nearby(patches.ix, patches.iy, others.ix, others.iy, reach)
    return covered(patches.low, patches.high, near, others.low, others.high, half)


def _nearest(flat: Patches, others: Patches, half: float) -> Int64:
    """Return for each flat patch the nearest of its cell within half a cell; -1: none."""
    near = nearby(flat.ix, flat.iy, others.ix, others.iy, 0)
    return nearest(flat.high, near, others.low, others.high, half)
