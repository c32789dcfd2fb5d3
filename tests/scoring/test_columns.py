"""The columns of a map against a scan's: walls of known ends, and slow rules.

How one could cheat, and what would pass without being right: a wall that is gone counted as one
that ends where it should, or left out unsaid; a roof above taken for the wall's top; an error
without its sign, or with the wrong one; levels that are the same in number only, or that hold all
of the scan's and more.
"""

from __future__ import annotations

import numpy as np
import pytest

from mlscli.maps.grid import Grid
from mlscli.pipeline.grouping import group
from mlscli.runtime.arrays import Float64
from mlscli.scoring import ColumnScore, Share, score_columns
from tests.helpers.maps import (
    CELL,
    GAP,
    THICKNESS,
    Patch,
    apart,
    map_of,
    patches_of,
    random_points,
)
from tests.helpers.point_references import measured
from tests.scoring.references import altered, on_a_surface

LENGTH = 12


def wall(low: float, high: float) -> list[Patch]:
    return [Patch(x, 0, high, high - low, 0, 9) for x in range(LENGTH)]


def floor(height: float = 0.0, y: int = 0) -> list[Patch]:
    return [Patch(x, y, height, 0.0, 0, 9) for x in range(LENGTH)]


def scanned(low: float, high: float) -> Float64:
    """Return points of a wall along x, a sixteenth apart."""
    along, up = np.meshgrid(
        np.arange(0, LENGTH * CELL, 1 / 16) + 1 / 32, np.arange(low, high + 1 / 32, 1 / 16)
    )
    return np.column_stack((along.ravel(), np.full(along.size, 0.1), up.ravel()))


def scored(patches: list[Patch], scan: Float64, within: float = CELL) -> ColumnScore:
    return score_columns(map_of(patches), scan, within)


def shares(count: int, of: int) -> Share:
    return Share(count, of, count / of if of else None)


@pytest.mark.parametrize(("top", "foot"), [(0, 0), (-0.75, 0), (-0.25, 0.625), (0.5, -1.25)])
def test_ends_are_off_by_what_the_wall_was_moved(top: float, foot: float) -> None:
    score = scored(wall(1 + foot, 4 + top), scanned(1, 4))
    for ends, error in ((score.upper_ends, top), (score.lower_ends, foot)):
        assert (ends.median, ends.p5, ends.p95) == (error, error, error)
        assert ends.too_low == shares(LENGTH * (error < -CELL), LENGTH)
        assert ends.too_high == shares(LENGTH * (error > CELL), LENGTH)
    assert score.uprights_missed == shares(0, LENGTH)


def test_percentiles_and_shares_are_those_of_all_uprights() -> None:
    patches = [Patch(x, 0, 4.0 - 0.125 * x, 3.0 - 0.125 * x, 0, 9) for x in range(LENGTH)]
    ends = scored(patches, scanned(1, 4)).upper_ends
    errors = -0.125 * np.arange(LENGTH)
    assert ends.median == np.median(errors)
    assert (ends.p5, ends.p95) == pytest.approx(tuple(np.quantile(errors, (0.05, 0.95))))
    # An error of a cell is not more than a cell.
    assert ends.too_low == shares(7, LENGTH)
    assert scored(patches, scanned(1, 4), 1.0).upper_ends.too_low == shares(3, LENGTH)


def test_a_wall_that_is_gone_is_missed_and_has_no_ends() -> None:
    score = scored(wall(1, 4)[:5] + floor(y=3), scanned(1, 4))
    assert score.uprights_missed == shares(LENGTH - 5, LENGTH)
    assert score.upper_ends.too_low == shares(0, 5)
    nothing = scored(floor(y=3), scanned(1, 4))
    assert nothing.uprights_missed == shares(LENGTH, LENGTH)
    assert (nothing.upper_ends.median, nothing.upper_ends.too_low) == (None, shares(0, 0))


def test_what_lies_more_than_half_a_cell_beyond_is_no_end_of_the_wall() -> None:
    for beyond, error in ((0.25, 0.25), (0.3125, 0.0)):
        ends = scored(wall(1, 4) + floor(4 + beyond) + floor(1 - beyond), scanned(1, 4))
        assert (ends.upper_ends.median, ends.lower_ends.median) == (error, -error)
        alone = scored(floor(4 + beyond), scanned(1, 4))
        assert alone.uprights_missed.count == LENGTH * (error == 0)


def test_a_wall_in_pieces_ends_with_the_last_of_them() -> None:
    pieces = [*wall(1, 2), *wall(2.5, 3), *floor(3.5)]
    score = scored(pieces, scanned(1, 4))
    assert (score.upper_ends.median, score.lower_ends.median) == (-0.5, 0)


def test_low_steps_and_levels_far_apart_are_no_uprights() -> None:
    # Lower than gap_size; and farther apart than it.
    low, apart = scanned(1, 1 + GAP - 0.0625), np.concatenate((scanned(1, 1), scanned(2, 2)))
    assert scored(wall(1, 2), low).uprights_missed.of == 0
    assert scored(wall(1, 2), apart).uprights_missed.of == 0
    assert scored(wall(1, 2), scanned(1, 1 + GAP)).uprights_missed.of == LENGTH


@pytest.mark.parametrize(
    ("patches", "agree"),
    [
        (wall(1, 4) + floor(6), True),
        # Within a cell.
        (wall(1.5, 3.5) + floor(6.5), True),
        (wall(1.5, 3.5) + floor(6.625), False),
        (wall(1, 3.375) + floor(6), False),
        (wall(1, 4), False),
        (wall(1, 4) + floor(6) + floor(8), False),
        (wall(1, 2.5) + wall(3.3125, 4) + floor(6), False),
        # As many, and covered by the scan's, but not covering them.
        (floor(4) + floor(6), False),
        ([], False),
    ],
)
def test_levels_agree_where_they_are_as_many_and_cover_each_other(
    patches: list[Patch], agree: bool
) -> None:
    scan = np.concatenate((scanned(1, 4), scanned(6, 6)))
    # Cells beside the scan do not count.
    score = scored(patches + floor(y=5), scan)
    assert score.levels_agree == shares(LENGTH * agree, LENGTH)


def test_a_map_agrees_with_the_points_it_was_made_of() -> None:
    points = random_points(np.random.default_rng(4), 400)
    surface = group(points, Grid(CELL, GAP, THICKNESS))
    score = score_columns(surface, points.xyz, 1e-6)
    assert score.levels_agree.share == 1 < score.levels_agree.of
    assert score.upper_ends.too_low.count == score.lower_ends.too_high.count == 0
    assert score.uprights_missed.count == 0 < score.uprights_missed.of


def slow_uprights(true: list[Patch], mine: list[Patch]) -> tuple[list[float], list[float], int]:
    """Return the errors of upper and of lower ends, and how many uprights are missed."""
    upper, lower, missed = [], [], 0
    for each in true:
        if each.depth < max(GAP, 1e-9):
            continue
        here = [p for p in mine if p.cell == each.cell and apart(p, each) <= CELL / 2]
        missed += not here
        if here:
            upper.append(max(p.height for p in here) - each.height)
            lower.append(min(p.low for p in here) - each.low)
    return upper, lower, missed


def slow_agreement(true: list[Patch], mine: list[Patch], within: float) -> list[bool]:
    """Return for each cell of the scan whether the levels agree."""
    result = []
    for cell in sorted({each.cell for each in true}):
        levels, others = ([p for p in all_ if p.cell == cell] for all_ in (true, mine))
        result.append(
            len(levels) == len(others)
            and all(on_a_surface(each, others, within) for each in levels)
            and all(on_a_surface(each, levels, within) for each in others)
        )
    return result


def test_the_slow_rules_find_the_same() -> None:
    uprights, agreed = np.zeros(3, dtype=int), np.zeros(2, dtype=int)
    for seed in range(40):
        rng = np.random.default_rng(seed)
        points = random_points(rng, 400)
        surface = altered(rng, group(points, Grid(CELL, GAP, THICKNESS)))
        within = float(rng.choice([CELL / 4, CELL, 2 * CELL]))
        rows = measured(points, CELL, GAP, THICKNESS)
        true = [Patch(int(r["ix"]), int(r["iy"]), r["height"], r["depth"], 0, 1) for r in rows]
        score = score_columns(surface, points.xyz, within)
        upper, lower, missed = slow_uprights(true, patches_of(surface))
        assert score.uprights_missed == shares(missed, len(upper) + missed)
        for ends, errors in ((score.upper_ends, upper), (score.lower_ends, lower)):
            assert ends.too_low == shares(sum(e < -within for e in errors), len(errors))
            assert ends.too_high == shares(sum(e > within for e in errors), len(errors))
            assert ends.median == (pytest.approx(np.median(errors)) if errors else None)
        agree = slow_agreement(true, patches_of(surface), within)
        assert score.levels_agree == shares(sum(agree), len(agree))
        uprights += (len(upper), missed, score.upper_ends.too_low.count)
        agreed += (sum(agree), len(agree) - sum(agree))
    assert min(*uprights, *agreed) > 20
