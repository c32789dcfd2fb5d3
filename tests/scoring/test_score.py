"""A map scored against the truth: each measure by a case that reads as its definition.

Ways to pass without being right: shares that are always 1 or of the wrong whole; limits that are
never met exactly; a wall judged by its ends alone; a sign lost in the bias; false patches counted
as found, or inserted ones that are right counted as phantoms; places of phantoms that are told by
the lower end alone, or that let a wall through a passage pass.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from mlscli.errors import UsageError
from mlscli.maps.cells import GREATEST_INDEX, LEAST_INDEX
from mlscli.maps.surface_map import ORIGINS, SurfaceMap
from mlscli.scoring import HeightErrors, Measures, Score, Share, score
from mlscli.scoring.places import PLACES
from tests.helpers.maps import CELL, Patch, map_of, patches_of, random_map, symmetries, turned_map
from tests.scoring import references as slow

HALF = CELL / 2


def flat(height: float, x: int = 0, y: int = 0, origin: int = 0) -> Patch:
    return Patch(x, y, height, 0.0, origin, int(origin == 0))


def wall(low: float, high: float, x: int = 0, y: int = 0, origin: int = 0) -> Patch:
    return Patch(x, y, high, high - low, origin, int(origin == 0))


def floor(size: int) -> list[Patch]:
    return [flat(0.0, x, y) for x in range(size) for y in range(size)]


def scored(patches: list[Patch], truth: list[Patch]) -> Score:
    return score(map_of(patches), map_of(truth))


def is_found(true: Patch, *patches: Patch) -> bool:
    return scored(list(patches), [true]).total.completeness.share == 1


def is_correct(patch: Patch, *truth: Patch) -> bool:
    return scored([patch], list(truth)).total.correctness.share == 1


def the_share(count: int, of: int) -> Share:
    return Share(count, of, count / of if of else None)


# --- against the slow rules ---


def random_pairs(count: int) -> Iterator[tuple[SurfaceMap, SurfaceMap]]:
    for seed in range(count):
        rng = np.random.default_rng(seed)
        truth = random_map(rng)
        yield slow.altered(rng, truth), truth


def slowly(patches: list[Patch], truth: list[Patch]) -> Measures:
    upright = [true for true in truth if true.depth > 0]
    level = [true for true in truth if true.depth == 0]

    def found(true: Patch) -> bool:
        return slow.found(true, patches, HALF)

    errors = slow.height_errors(truth, patches, HALF)
    return Measures(
        completeness=the_share(*slow.share(found, truth)),
        completeness_horizontal=the_share(*slow.share(found, level)),
        completeness_vertical=the_share(*slow.share(found, upright)),
        correctness=the_share(*slow.share(lambda p: slow.correct(p, truth, HALF), patches)),
        heights=HeightErrors(
            len(errors),
            slow.root_mean_square(errors),
            sum(errors) / len(errors) if errors else None,
            slow.percentile_95(errors),
        ),
        flat_called_vertical=the_share(
            *slow.share(lambda true: slow.called_vertical(true, patches, HALF), level)
        ),
    )


def agree(measures: Measures, expected: Measures) -> bool:
    one, other = measures.heights, expected.heights
    return replace(measures, heights=other) == expected and (
        [one.patches, one.rmse, one.bias, one.p95]
        == [
            other.patches,
            *(pytest.approx(e, abs=1e-12) for e in (other.rmse, other.bias, other.p95)),
        ]
    )


def test_every_measure_is_what_the_slow_rules_say_in_total_and_by_origin() -> None:
    seen, places = np.zeros(5, dtype=int), Counter[str]()
    for surface, truth in random_pairs(300):
        result = score(surface, truth)
        patches, true = patches_of(surface), patches_of(truth)
        assert agree(result.total, slowly(patches, true))
        for origin, name in enumerate(ORIGINS):
            alone = [patch for patch in patches if patch.origin == origin]
            assert agree(result.by_origin[name], slowly(alone, true))
        wrong = [patch for patch in patches if not slow.correct(patch, true, HALF)]
        inserted = [patch for patch in patches if patch.origin > 0]
        assert result.false_levels == len(wrong)
        assert result.true_cells == len({p.cell for p in true})
        assert result.false_levels_per_cell == the_share(len(wrong), result.true_cells).share
        assert result.levels_missed == sum(not slow.found(t, patches, HALF) for t in true)
        assert result.phantom_closings == the_share(
            sum(p in inserted for p in wrong), len(inserted)
        )
        expected = Counter(
            (slow.place(patch, true, CELL), ORIGINS[patch.origin])
            for patch in wrong
            if patch in inserted
        )
        assert result.phantom_places == {
            place: {name: expected[place, name] for name in ORIGINS[1:]} for place in PLACES
        }
        places.update(place for place, _ in expected.elements())
        red = [patch for patch in patches if patch.origin == 2]
        assert result.honest_red == the_share(sum(p not in wrong for p in red), len(red))
        parts = result.total
        seen += [
            parts.completeness_vertical.count,
            parts.completeness_vertical.rest,
            parts.correctness.rest,
            result.phantom_closings.count,
            parts.flat_called_vertical.count,
        ]
    assert seen.min() > 50
    assert min(places[place] for place in PLACES) > 10, places


# --- properties ---


def test_the_truth_itself_scores_one_in_everything() -> None:
    for _, truth in random_pairs(100):
        result = score(truth, truth)
        assert result.total.completeness.rest == result.total.correctness.rest == 0
        assert result.total.heights.patches == result.total.completeness_horizontal.of
        assert not any((result.total.heights.rmse, result.total.heights.bias))
        assert result.false_levels == result.levels_missed == 0
        assert result.phantom_closings.count == 0
        assert result.honest_red.rest == 0
        assert result.total.flat_called_vertical.count == 0


def test_turning_map_and_truth_changes_no_score() -> None:
    for surface, truth in random_pairs(30):
        straight = score(surface, truth)
        for symmetry in symmetries():
            turned = score(turned_map(surface, symmetry), turned_map(truth, symmetry))
            assert agree(turned.total, straight.total)
            assert turned.false_levels == straight.false_levels


def test_one_patch_more_never_makes_a_map_less_complete_nor_the_others_less_correct() -> None:
    for surface, truth in random_pairs(50):
        patches, true = patches_of(surface), patches_of(truth)
        for extra in true[:3]:
            before, after = scored(patches, true).total, scored([*patches, extra], true).total
            assert after.completeness.count >= before.completeness.count
            assert after.correctness.count == before.correctness.count + 1


# --- completeness ---


def test_a_flat_true_patch_is_found_by_a_patch_within_half_a_cell() -> None:
    for step in (HALF, -HALF):
        assert is_found(flat(1.0), flat(1.0 + step))
        assert not is_found(flat(1.0), flat(1.0 + step * 1.001))


def test_a_flat_true_patch_is_found_by_a_wall_that_holds_its_height() -> None:
    assert is_found(flat(1.0), wall(0.0, 3.0))
    assert is_found(flat(1.0), wall(1.0 + HALF, 3.0))
    assert not is_found(flat(1.0), wall(1.001 + HALF, 3.0))


def test_a_true_patch_is_found_in_its_own_cell_only() -> None:
    for x in (-1, 0, 1):
        for y in (-1, 0, 1):
            assert is_found(flat(1.0), flat(1.0, x, y)) == (x == y == 0)


def test_a_true_wall_is_found_where_it_is_covered_from_bottom_to_top() -> None:
    assert is_found(wall(0.0, 4.0), wall(HALF, 4.0 - HALF))
    assert not is_found(wall(0.0, 4.0), wall(HALF + 0.001, 4.0))
    assert not is_found(wall(0.0, 4.0), wall(0.0, 3.999 - HALF))
    assert is_found(wall(0.0, 4.0), wall(-3.0, 9.0))


def test_a_true_wall_with_a_hole_is_found_where_widening_closes_the_hole() -> None:
    assert is_found(wall(0.0, 4.0), wall(0.0, 1.0), wall(1.0 + CELL, 4.0))
    assert not is_found(wall(0.0, 4.0), wall(0.0, 1.0), wall(1.001 + CELL, 4.0))


def test_a_true_wall_can_be_found_by_flat_patches() -> None:
    rungs = [flat(k * CELL) for k in range(9)]
    assert is_found(wall(0.0, 4.0), *rungs)
    for k in range(9):
        assert not is_found(wall(0.0, 4.0), *rungs[:k], *rungs[k + 1 :])


def test_completeness_is_told_of_flat_patches_and_walls_apart() -> None:
    truth = [flat(0.0, 0), flat(0.0, 1), flat(0.0, 2), wall(0.0, 3.0, 3), wall(0.0, 3.0, 4)]
    total = scored([flat(0.1, 0), flat(0.1, 1), wall(0.0, 3.0, 3)], truth).total
    assert total.completeness == Share(3, 5, 3 / 5)
    assert total.completeness_horizontal == Share(2, 3, 2 / 3)
    assert total.completeness_vertical == Share(1, 2, 1 / 2)


# --- correctness ---


def test_a_patch_is_correct_one_cell_beside_a_true_surface_and_not_two() -> None:
    for x in (-2, -1, 0, 1, 2):
        for y in (-2, -1, 0, 1, 2):
            assert is_correct(flat(1.0), flat(1.0, x, y)) == (abs(x) <= 1 and abs(y) <= 1)


def test_a_patch_is_correct_within_half_a_cell_in_height() -> None:
    assert is_correct(flat(1.0), flat(1.0 + HALF))
    assert not is_correct(flat(1.0), flat(1.001 + HALF))
    assert is_correct(flat(1.0), wall(1.0 + HALF, 5.0))
    assert not is_correct(flat(1.0), wall(1.001 + HALF, 5.0))


def test_a_wall_is_correct_only_where_all_of_it_is_true() -> None:
    assert is_correct(wall(0.0, 4.0), wall(HALF, 4.0 - HALF))
    assert not is_correct(wall(0.0, 4.0), wall(0.0, 3.999 - HALF))
    # Its ends alone are not enough: the window between is true.
    assert not is_correct(wall(0.0, 4.0), wall(0.0, 1.0), wall(2.0, 4.0))


def test_a_wall_may_lie_on_the_true_surfaces_of_several_cells() -> None:
    assert is_correct(wall(0.0, 4.0), wall(0.0, 1.5, -1, 1), wall(1.5 + CELL, 4.0, 1, 0))
    assert not is_correct(wall(0.0, 4.0), wall(0.0, 1.5, -2, 1), wall(1.5 + CELL, 4.0, 1, 0))


def test_cells_at_the_ends_of_the_grid_have_no_neighbours_beyond() -> None:
    ends = LEAST_INDEX, GREATEST_INDEX
    corners = [flat(1.0, x, y) for x in ends for y in ends]
    for patch in corners:
        for true in corners:
            assert is_correct(patch, true) == (patch == true)


# --- heights ---


def test_errors_of_height_keep_their_sign_in_the_bias_alone() -> None:
    errors = [0.2, -0.1, -0.1, -0.2]
    patches = [flat(1.0 + error, x) for x, error in enumerate(errors)]
    heights = scored(patches, [flat(1.0, x) for x in range(4)]).total.heights
    assert heights.patches == 4
    assert heights.bias == pytest.approx(-0.05)
    assert heights.rmse == pytest.approx(np.sqrt(0.1 / 4))
    assert heights.p95 == pytest.approx(0.2)


def test_95_of_100_errors_are_no_greater_than_the_95_percent_error() -> None:
    patches = [flat(0.002 * x, x) for x in range(101)]
    heights = scored(patches, [flat(0.0, x) for x in range(101)]).total.heights
    assert heights.p95 == pytest.approx(0.19)


def test_heights_are_compared_with_the_nearest_flat_patch_within_half_a_cell() -> None:
    truth = [flat(1.0)]
    assert scored([flat(0.8), flat(1.1)], truth).total.heights.bias == pytest.approx(0.1)
    assert scored([flat(0.875), flat(1.125)], truth).total.heights.bias == 0.125
    assert scored([flat(1.001 + HALF)], truth).total.heights.patches == 0
    assert scored([wall(0.0, 1.1)], truth).total.heights.patches == 0
    assert scored([flat(1.0, 1)], truth).total.heights.patches == 0
    assert scored([flat(1.0)], [wall(0.0, 1.0)]).total.heights.patches == 0


# --- levels ---


def test_a_false_level_is_a_patch_on_no_true_surface() -> None:
    ghosts = [flat(2.0, 1, 1), flat(4.0, 1, 1), flat(0.0, 9, 9)]
    result = scored([*floor(4), *ghosts], floor(4))
    assert result.false_levels == 3
    assert result.false_levels_per_cell == 3 / 16
    assert result.total.correctness == Share(16, 19, 16 / 19)
    assert result.levels_missed == 0


def test_a_level_missed_is_a_true_patch_that_is_not_found() -> None:
    bridge = [*floor(4), flat(2.0, 1, 1), flat(2.0, 2, 1)]
    result = scored(floor(4), bridge)
    assert result.levels_missed == 2
    assert result.total.completeness == Share(16, 18, 16 / 18)
    assert result.false_levels == 0
    assert result.true_cells == 16


# --- inserted patches ---


def test_a_phantom_closing_is_an_inserted_patch_where_the_truth_is_open() -> None:
    truth = floor(4)
    under_the_bridge = [flat(1.0, 1, 1, origin=1), wall(0.5, 2.0, 2, 2, origin=2)]
    in_the_floor = [flat(0.1, 0, 0, origin=1), flat(-0.1, 0, 1, origin=2)]
    result = scored([*truth[2:], *in_the_floor, *under_the_bridge], truth)
    assert result.phantom_closings == Share(2, 4, 1 / 2)


def the_places(patch: Patch, *truth: Patch) -> dict[str, int]:
    """Return in which places a patch is a phantom closing."""
    places = scored([patch], list(truth)).phantom_places
    return {place: sum(by.values()) for place, by in places.items() if any(by.values())}


def test_a_phantom_closing_between_floor_and_deck_is_under_a_deck() -> None:
    bridge = [flat(0.0), flat(4.0)]
    for z in (1.001 * CELL, 2.0, 3.999 - CELL):
        assert the_places(flat(z, origin=2), *bridge) == {"under_deck": 1}
    for z in (CELL, 4.0 - CELL):
        assert the_places(flat(z, origin=2), *bridge) == {"off_level": 1}
    for z in (-1.001 * CELL, 4.001 + CELL):
        assert the_places(flat(z, origin=2), *bridge) == {"elsewhere": 1}


def test_a_wall_that_fills_the_passage_under_a_deck_is_under_it() -> None:
    bridge = [flat(0.0), flat(4.0)]
    for low, high in ((0.0, 4.0), (-1.0, 9.0), (0.0, 0.6), (3.4, 4.0), (1.0, 2.0)):
        assert the_places(wall(low, high, origin=1), *bridge) == {"under_deck": 1}
    assert the_places(wall(0.0, CELL, origin=1), *bridge) == {"off_level": 1}
    assert the_places(wall(4.0, 9.0, origin=1), *bridge) == {"off_level": 1}
    assert the_places(wall(5.0, 9.0, origin=1), *bridge) == {"elsewhere": 1}


def test_between_sill_and_lintel_is_a_window_and_between_floor_and_lintel_a_gate() -> None:
    sill, lintel, ground = wall(0.0, 1.0), wall(3.0, 4.0), flat(0.0)
    for patch in (flat(2.0, origin=2), wall(1.0, 3.0, origin=2)):
        assert the_places(patch, sill, lintel) == {"in_window": 1}
        assert the_places(patch, ground, lintel) == {"under_deck": 1}
        assert the_places(patch, sill, flat(3.5)) == {"under_deck": 1}


def test_a_phantom_closing_in_a_hole_of_the_ground_has_ground_on_all_four_sides() -> None:
    ring = [patch for patch in floor(7) if not (1 < patch.ix < 5 and 1 < patch.iy < 5)]
    middle = flat(0.0, 3, 3, origin=2)
    assert the_places(middle, *ring) == {"in_hole": 1}
    assert the_places(wall(-2.0, 1.0, 3, 3, origin=2), *ring) == {"in_hole": 1}
    # One cell sideways from a true surface a patch is still correct.
    assert the_places(flat(0.0, 2, 3, origin=2), *ring) == {}
    for open_side in ("ix", "iy"):
        for sign in (1, -1):
            bay = [patch for patch in ring if sign * (getattr(patch, open_side) - 3) < 2]
            assert the_places(middle, *bay) == {"elsewhere": 1}


def test_what_is_right_or_measured_is_in_no_place() -> None:
    bridge = [flat(0.0), flat(4.0)]
    assert the_places(flat(2.0, origin=0), *bridge) == {}
    assert the_places(flat(0.0, origin=2), *bridge) == {}
    # A wall beside the passage excuses what is inserted into the cell beside it.
    assert the_places(wall(0.0, 4.0, origin=2), *bridge, wall(0.0, 4.0, 1)) == {}


def test_phantom_closings_in_a_place_are_told_by_origin() -> None:
    bridge = [flat(z, x) for x in range(3) for z in (0.0, 4.0)]
    phantoms = [flat(2.0, 0, origin=1), flat(2.0, 1, origin=2), flat(2.0, 2, origin=2)]
    places = scored(phantoms, bridge).phantom_places
    assert places["under_deck"] == {"plastered": 1, "artificial": 2}
    assert set(places) == set(PLACES)


def test_a_measured_patch_is_no_phantom() -> None:
    result = scored([*floor(2), flat(5.0)], floor(2))
    assert result.phantom_closings == Share(0, 0, None)
    assert result.false_levels == 1


def test_red_is_honest_where_an_artificial_patch_lies_on_a_true_surface() -> None:
    red = [flat(0.0, 0, 0, origin=2), flat(0.0, 0, 1, origin=2), flat(3.0, 1, 1, origin=2)]
    plastered = [flat(3.0, 1, 0, origin=1)]
    assert scored(red + plastered, floor(2)).honest_red == Share(2, 3, 2 / 3)


def test_by_origin_each_is_scored_as_if_it_were_the_map() -> None:
    patches = [flat(0.1, 0), flat(0.2, 1), flat(-0.1, 2, origin=1), flat(5.0, 3, origin=2)]
    result = scored(patches, [flat(0.0, x) for x in range(4)])
    found = {name: part.completeness.count for name, part in result.by_origin.items()}
    right = {name: part.correctness.share for name, part in result.by_origin.items()}
    bias = {name: part.heights.bias for name, part in result.by_origin.items()}
    assert found == {"measured": 2, "plastered": 1, "artificial": 0}
    assert right == {"measured": 1, "plastered": 1, "artificial": 0}
    assert bias == {"measured": pytest.approx(0.15), "plastered": -0.1, "artificial": None}
    assert result.total.completeness == Share(3, 4, 3 / 4)


# --- floors called walls ---


def test_a_flat_floor_is_called_vertical_where_its_nearest_patch_is_a_wall() -> None:
    truth = [flat(0.0, x) for x in range(5)]
    patches = [flat(0.0, 0), wall(-0.3, 0.3, 1), wall(1.0, 2.0, 2)]
    patches += [flat(0.1, 3), wall(0.2, 1.0, 3), flat(0.2, 4), wall(-1.0, -0.1, 4)]
    assert scored(patches, truth).total.flat_called_vertical == Share(2, 5, 2 / 5)


def test_a_true_wall_called_vertical_is_no_fault() -> None:
    result = scored([wall(0.0, 3.0)], [wall(0.0, 3.0)])
    assert result.total.flat_called_vertical == Share(0, 0, None)


# --- what goes in and out ---


def test_of_nothing_there_is_no_share() -> None:
    against_nothing, of_nothing = scored(floor(2), []), scored([], floor(2))
    assert against_nothing.total.completeness == Share(0, 0, None)
    assert against_nothing.total.correctness == Share(0, 4, 0.0)
    assert against_nothing.false_levels_per_cell is None
    assert of_nothing.total.completeness == Share(0, 4, 0.0)
    assert of_nothing.total.correctness == Share(0, 0, None)
    assert scored([], []).total.heights == HeightErrors(0, None, None, None)


def test_a_score_goes_into_json_and_comes_back() -> None:
    for result in (scored(floor(2), floor(3)), scored([], [])):
        told = result.to_dict()
        assert json.loads(json.dumps(told, allow_nan=False)) == told
        assert set(told["by_origin"]) == set(ORIGINS)
    assert told["total"]["completeness"] == {"count": 0, "of": 0, "share": None}


@pytest.mark.parametrize("name", ["cell_size", "gap_size"])
def test_a_truth_on_another_grid_is_refused(name: str) -> None:
    change: dict[str, Any] = {name: 0.7}
    with pytest.raises(UsageError, match=rf"{name}: is 0\.\d+ in one map and 0\.7 in the other"):
        score(map_of(floor(2)), replace(map_of(floor(2)), **change))
