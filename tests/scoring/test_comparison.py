"""Two maps compared: what matches, what is told of it, and what "they differ" means.

Ways to pass without being right: to match each patch with its nearest, however often that is
taken, or one map's patches from its own side only; to look at heights and overlook a patch in one
map only, another origin, another depth; to take what `==` sees for what the tolerance allows.
"""

from __future__ import annotations

import json
import statistics
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mlscli.errors import UsageError
from mlscli.maps.cells import GREATEST_INDEX, LEAST_INDEX
from mlscli.maps.surface_map import ORIGINS, SurfaceMap
from mlscli.scoring import Comparison, Differences, Spread, compare_maps
from mlscli.scoring.comparison import matches, root_mean_square
from tests.helpers.maps import GAP, Patch, map_of, patches_of, random_map, symmetries, turned_map
from tests.scoring import references as slow

FLOOR = [Patch(x, y, 0.0, 0.0, 0, 3) for x in range(4) for y in range(3)]
DECK = [Patch(x, 1, 2.0, 0.0, 2, 0) for x in range(4)]
BRIDGE = FLOOR + DECK


def map_pairs(count: int) -> Iterator[tuple[SurfaceMap, SurfaceMap]]:
    for seed in range(count):
        rng = np.random.default_rng(seed)
        surface = random_map(rng)
        yield surface, slow.altered(rng, surface)


def names_swapped(comparison: Comparison) -> Comparison:
    def swapped(part: Differences) -> Differences:
        return replace(part, only_a=part.only_b, only_b=part.only_a)

    return replace(
        comparison,
        grid={name: (two, one) for name, (one, two) in comparison.grid.items()},
        total=swapped(comparison.total),
        by_origin={name: swapped(part) for name, part in comparison.by_origin.items()},
    )


def matched(a: list[Patch], b: list[Patch]) -> list[tuple[float, float]]:
    one, two = map_of(a), map_of(b)
    in_a, in_b = matches(one, two)
    return list(zip(one.height[in_a].tolist(), two.height[in_b].tolist(), strict=True))


def column(*heights: float) -> list[Patch]:
    return [Patch(0, 0, height, 0.0, 0, 1) for height in heights]


# --- which patches match ---


def test_patches_match_as_the_slow_rule_says() -> None:
    several = 0
    for a, b in map_pairs(400):
        in_a, in_b = matches(a, b)
        expected = slow.pairs(patches_of(a), patches_of(b))
        assert list(zip(in_a.tolist(), in_b.tolist(), strict=True)) == expected
        several += len(expected) > 5
    assert several > 100


def test_each_patch_matches_once_and_the_nearest_first() -> None:
    assert matched(column(0.0), column(-0.5, 0.25)) == [(0.0, 0.25)]
    assert matched(column(0.0, 0.75), column(0.5)) == [(0.75, 0.5)]
    assert matched(column(0.0, 0.75), column(0.5, 1.25)) == [(0.75, 0.5)]


def test_of_two_equally_near_ones_the_higher_matches() -> None:
    assert matched(column(0.0), column(-0.5, 0.5)) == [(0.0, 0.5)]
    assert matched(column(-0.5, 0.5), column(0.0)) == [(0.5, 0.0)]


def test_what_the_nearest_leaves_matches_too() -> None:
    # 0.75 and 0.5 are the nearest two; 0.0, to which 0.5 is nearer too, then has -0.75.
    assert matched(column(0.0, 0.75), column(-0.75, 0.5)) == [(0.0, -0.75), (0.75, 0.5)]


def test_patches_match_up_to_the_gap_and_no_farther() -> None:
    assert matched(column(0.0), column(GAP)) == [(0.0, GAP)]
    assert matched(column(0.0), column(np.nextafter(GAP, 1))) == []


def test_patches_of_different_cells_never_match() -> None:
    for x, y in (
        (1, 0),
        (0, 1),
        (-1, 0),
        (LEAST_INDEX, LEAST_INDEX),
        (GREATEST_INDEX, GREATEST_INDEX),
    ):
        moved = [patch._replace(ix=x, iy=y) for patch in column(0.0)]
        assert matched(column(0.0), moved) == []
        assert matched(moved, moved) == [(0.0, 0.0)]


# --- what is told ---


def test_a_map_is_identical_to_itself() -> None:
    for a, b in map_pairs(50):
        for surface in (a, b):
            same = compare_maps(surface, replace(surface, meta={"other": 1}))
            assert same.identical
            assert not same.differ
            assert not same.columns
            assert same.total.matched == surface.size
            assert same.total.only_a == same.total.only_b == 0
            assert same.total.heights.beyond == 0
            assert not same.total.heights.maximum


def test_exchanging_the_maps_exchanges_the_names_and_nothing_else() -> None:
    for a, b in map_pairs(100):
        for tolerance in (0.0, 0.25):
            assert compare_maps(b, a, tolerance) == names_swapped(compare_maps(a, b, tolerance))


def test_turning_both_maps_changes_no_count() -> None:
    def counts(comparison: Comparison) -> list[object]:
        parts = [comparison.total, *comparison.by_origin.values()]
        return [(p.matched, p.only_a, p.only_b, p.heights.maximum, p.depths.beyond) for p in parts]

    for a, b in map_pairs(30):
        for symmetry in symmetries():
            turned = compare_maps(turned_map(a, symmetry), turned_map(b, symmetry))
            assert counts(turned) == counts(compare_maps(a, b))


def test_differences_are_those_of_the_slow_rule_in_total_and_by_origin() -> None:
    seen = dict.fromkeys((*ORIGINS, "changed"), 0)
    for a, b in map_pairs(100):
        comparison = compare_maps(a, b, 0.2)
        one, two = patches_of(a), patches_of(b)
        pairs = [(one[i], two[j]) for i, j in slow.pairs(one, two)]
        only_a = [p for i, p in enumerate(one) if i not in {i for i, _ in slow.pairs(one, two)}]
        only_b = [p for j, p in enumerate(two) if j not in {j for _, j in slow.pairs(one, two)}]
        check(comparison.total, pairs, only_a, only_b)
        for origin, name in enumerate(ORIGINS):
            check(
                comparison.by_origin[name],
                [(p, q) for p, q in pairs if p.origin == q.origin == origin],
                [p for p in only_a if p.origin == origin],
                [p for p in only_b if p.origin == origin],
            )
        changed = [(p, q) for p, q in pairs if p.origin != q.origin]
        check(comparison.by_origin["changed"], changed, [], [])
        for name, part in comparison.by_origin.items():
            seen[name] += part.matched
    assert min(seen.values()) > 50


def check(
    part: Differences, pairs: list[tuple[Patch, Patch]], only_a: list[Patch], only_b: list[Patch]
) -> None:
    assert (part.matched, part.only_a, part.only_b) == (len(pairs), len(only_a), len(only_b))
    for spread, values in (
        (part.heights, [abs(p.height - q.height) for p, q in pairs]),
        (part.depths, [abs(p.depth - q.depth) for p, q in pairs]),
    ):
        assert spread.rmse == pytest.approx(slow.root_mean_square(values))
        assert spread.p95 == pytest.approx(slow.percentile_95(values))
        assert spread.median == (pytest.approx(statistics.median(values)) if values else None)
        assert spread.maximum == max(values, default=None)
        assert spread.beyond == sum(value > 0.2 for value in values)


def test_a_patch_that_moved_is_the_one_that_differs() -> None:
    moved = [patch._replace(height=0.5) if patch.cell == (2, 2) else patch for patch in BRIDGE]
    comparison = compare_maps(map_of(BRIDGE), map_of(moved))
    spread = comparison.total.heights
    assert comparison.total.matched == 16
    assert (comparison.total.only_a, comparison.total.only_b) == (0, 0)
    assert (spread.maximum, spread.median, spread.beyond) == (0.5, 0.0, 1)
    assert spread.rmse == pytest.approx(0.5 / 4)
    assert comparison.by_origin["measured"].heights.beyond == 1
    assert comparison.by_origin["artificial"].heights.beyond == 0
    assert comparison.differ


def test_a_patch_removed_is_in_the_first_only_and_one_added_in_the_second() -> None:
    for less, origin in ((BRIDGE[1:], "measured"), (BRIDGE[:-1], "artificial")):
        comparison = compare_maps(map_of(BRIDGE), map_of(less))
        assert comparison.total == Differences(15, 1, 0, *nothing(15))
        assert [n for n, part in comparison.by_origin.items() if part.only_a] == [origin]
        comparison = compare_maps(map_of(less), map_of(BRIDGE))
        assert comparison.total == Differences(15, 0, 1, *nothing(15))
        assert [n for n, part in comparison.by_origin.items() if part.only_b] == [origin]


def test_no_tolerance_makes_up_for_a_patch_that_one_map_lacks() -> None:
    bridge, less = map_of(BRIDGE), map_of(BRIDGE[1:])
    assert compare_maps(bridge, less, 9.0).differ
    assert compare_maps(less, bridge, 9.0).differ


def nothing(count: int) -> tuple[Spread, Spread]:
    spread = Spread(0.0, 0.0, 0.0, 0.0, 0) if count else Spread(None, None, None, None, 0)
    return spread, spread


def test_a_patch_of_another_origin_is_told_as_changed() -> None:
    plastered = FLOOR + [patch._replace(origin=1) for patch in DECK]
    comparison = compare_maps(map_of(BRIDGE), map_of(plastered), 0.1)
    assert comparison.by_origin["changed"].matched == 4
    assert comparison.by_origin["artificial"].matched == 0
    assert comparison.columns == {"origin": 4}
    assert comparison.differ


def test_a_wall_of_another_depth_is_told() -> None:
    shallow, deep = ([Patch(0, 0, 3.0, depth, 0, 3)] for depth in (1.0, 2.5))
    comparison = compare_maps(map_of(shallow), map_of(deep), 0.5)
    assert comparison.total.heights.maximum == 0
    assert comparison.total.depths.maximum == 1.5
    assert comparison.total.depths.beyond == 1
    assert comparison.differ


def test_what_differs_besides_patches_is_told_by_name() -> None:
    a = map_of(BRIDGE)
    b = replace(a, thickness=0.5, frame_id="odom", count=a.count + (a.origin == 0).astype("u4"))
    comparison = compare_maps(a, b)
    assert comparison.grid == {"thickness": (0.25, 0.5), "frame_id": ("map", "odom")}
    assert comparison.columns == {"count": 12}
    assert not comparison.identical


@pytest.mark.parametrize("name", ["thickness", "frame_id", "variance", "last_keyframe", "region"])
def test_without_a_tolerance_whatever_is_not_identical_differs(name: str) -> None:
    a = map_of(BRIDGE)
    other: dict[str, Any] = {
        "thickness": 1.0,
        "frame_id": "odom",
        "variance": a.variance + 1,
        "last_keyframe": np.where(a.origin == 0, 5, -1).astype(np.int32),
        "region": a.region + 1,
    }
    b = replace(a, **{name: other[name]})
    assert compare_maps(a, b).differ
    assert not compare_maps(a, b).identical
    assert not compare_maps(a, b, 1e-12).differ
    assert not compare_maps(a, b, 1e-12).identical


def test_heights_differ_beyond_the_tolerance_and_not_at_it() -> None:
    a, b = map_of(column(0.0)), map_of(column(0.25))
    assert not compare_maps(a, b, 0.25).differ
    assert compare_maps(a, b, 0.2499).differ
    assert compare_maps(a, b, 0.2499).total.heights.beyond == 1


def test_maps_without_patches_compare() -> None:
    empty = map_of([])
    assert not compare_maps(empty, empty).differ
    assert compare_maps(empty, map_of(BRIDGE), 9.0).total == Differences(0, 0, 16, *nothing(0))


def test_identical_is_what_has_no_difference_anywhere() -> None:
    for a, b in map_pairs(100):
        for other in (b, replace(a, region=a.region + 1), a):
            comparison = compare_maps(a, other)
            part = comparison.total
            none = not (comparison.grid or comparison.columns or part.only_a or part.only_b)
            assert comparison.identical == none


def test_a_comparison_goes_into_json_and_comes_back() -> None:
    for surface in (map_of(BRIDGE), map_of([])):
        told = compare_maps(surface, replace(map_of(FLOOR), frame_id="odom")).to_dict()
        assert json.loads(json.dumps(told, allow_nan=False)) == {
            **told,
            "grid": {"frame_id": ["map", "odom"]},
        }
        assert told["differ"]


@pytest.mark.parametrize("name", ["cell_size", "gap_size"])
def test_maps_of_different_grids_are_refused(name: str) -> None:
    change: dict[str, Any] = {name: 0.7}
    with pytest.raises(UsageError, match=rf"{name}: is 0\.\d+ in one map and 0\.7 in the other"):
        compare_maps(map_of(BRIDGE), replace(map_of(BRIDGE), **change))


def test_maps_whose_lengths_differ_by_a_rounding_are_compared() -> None:
    one = map_of(BRIDGE, 3 * 0.15, 0.15)
    other = map_of(BRIDGE, 0.45, 0.15)
    assert one != other
    comparison = compare_maps(one, other)
    assert comparison.identical
    assert (comparison.differ, comparison.grid) == (False, {})
    thick = replace(other, thickness=0.4)
    assert compare_maps(one, thick).grid == {"thickness": (one.thickness, 0.4)}
    assert not compare_maps(one, thick).identical


@pytest.mark.parametrize("tolerance", [-1e-9, float("nan"), float("inf")])
def test_a_tolerance_that_is_no_length_is_refused(tolerance: float) -> None:
    with pytest.raises(UsageError, match=r"tolerance: is .*; it must be a number, 0 or more"):
        compare_maps(map_of(BRIDGE), map_of(BRIDGE), tolerance)


@given(st.lists(st.floats(-1e308, 1e308), min_size=1, max_size=20))
def test_the_root_of_the_mean_square_is_finite_and_no_more_than_the_largest(
    values: list[float],
) -> None:
    root = root_mean_square(np.array(values))
    largest = max(map(abs, values))
    assert largest / 5 <= root <= largest * (1 + 1e-12)
