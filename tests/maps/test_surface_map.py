"""The map as columns: parts, equality, invariants.

How one could cheat `check`: tests that break several invariants at once, or none.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mlscli.errors import InputError
from mlscli.maps.cells import GREATEST_INDEX, LEAST_INDEX, CellSet, pack, unpack
from mlscli.maps.columns import COLUMNS
from mlscli.maps.grid import Grid
from mlscli.maps.strips import STRIP_BITS
from mlscli.maps.surface_map import SurfaceMap
from tests.helpers.cells import cells_in
from tests.helpers.maps import Patch, map_of, patches_of, random_map

INDEX = st.integers(LEAST_INDEX, GREATEST_INDEX)
CELLS = st.lists(st.tuples(INDEX, INDEX), max_size=20)


def a_map() -> SurfaceMap:
    return map_of(
        [Patch(0, 0, 1.0, 0.0, 0, 3), Patch(0, 0, 3.0, 0.5, 0, 4), Patch(0, 1, 1.0, 0.0, 2, 0)]
    )


def test_columns_that_lie_scattered_in_memory_are_taken_and_merged_like_others() -> None:
    surface = random_map(np.random.default_rng(4))
    some = np.arange(0, surface.size, 3)
    ix, height = np.repeat(surface.ix, 2), np.repeat(surface.height, 2)
    scattered = replace(surface, ix=ix[::2], height=height[::2])
    assert not scattered.height.flags.c_contiguous
    assert scattered.take(some) == surface.take(some)
    assert scattered.union(surface.take(some)) == surface.union(scattered.take(some))


def test_the_union_of_two_maps_is_sorted_and_of_equals_those_of_the_first_come_first() -> None:
    rng = np.random.default_rng(3)
    shared = 0
    for _ in range(100):
        one, other = random_map(rng), random_map(rng)
        # Part of the other map is the one's, told from it by its region, which is no key.
        again = one.take(rng.random(one.size) < 0.5)
        again = replace(again, region=np.full(again.size, 9, dtype=np.int32))
        shared += again.size
        other = other.union(again)
        both = one.union(other)
        rows = [
            tuple(row) for part in (one, other) for row in zip(*part.keys, part.region, strict=True)
        ]
        expected = sorted(rows, key=lambda row: row[:-1])
        assert [tuple(row) for row in zip(*both.keys, both.region, strict=True)] == expected
    assert shared > 100


@given(CELLS)
def test_packed_keys_sort_as_cells_and_unpack_to_them(cells: list[tuple[int, int]]) -> None:
    ix, iy = np.array(cells, dtype=np.int32).reshape(-1, 2).T
    keys = pack(ix, iy)
    assert [tuple(cell) for cell in np.transpose(unpack(np.sort(keys))).tolist()] == sorted(cells)


@given(CELLS, st.integers(0, 3))
def test_a_widened_set_holds_the_cells_within_reach(
    cells: list[tuple[int, int]], reach: int
) -> None:
    ix, iy = np.array(cells, dtype=np.int64).reshape(-1, 2).T
    steps = range(-reach, reach + 1)
    expected = {(x + dx, y + dy) for x, y in cells for dx in steps for dy in steps}
    expected = {
        (x, y)
        for x, y in expected
        if LEAST_INDEX <= x <= GREATEST_INDEX and LEAST_INDEX <= y <= GREATEST_INDEX
    }
    widened = CellSet.of(ix, iy).widened(reach)
    assert widened.contains(ix, iy).all()
    # One cell farther out, and in any order, the set says the same of itself.
    asked = np.array(sorted(_around(expected), key=hash), dtype=np.int64).reshape(-1, 2)
    told = widened.contains(*asked.T)
    assert {tuple(cell) for cell in asked[told].tolist()} == expected


def _around(cells: set[tuple[int, int]]) -> set[tuple[int, int]]:
    steps = (-1, 0, 1)
    around = {(x + dx, y + dy) for x, y in cells for dx in steps for dy in steps}
    return {
        (x, y)
        for x, y in around
        if LEAST_INDEX <= x <= GREATEST_INDEX and LEAST_INDEX <= y <= GREATEST_INDEX
    }


def test_a_set_that_reaches_over_the_whole_grid_is_told_at_once() -> None:
    cells = CellSet.of(np.array([0, LEAST_INDEX]), np.array([0, GREATEST_INDEX]))
    widened = cells.widened(GREATEST_INDEX)
    ends = np.array([LEAST_INDEX, 0, 7, GREATEST_INDEX])
    x, y = (axis.ravel() for axis in np.meshgrid(ends, ends))
    expected = [
        any(
            max(abs(int(a) - c), abs(int(b) - d)) <= GREATEST_INDEX
            for c, d in ((0, 0), (LEAST_INDEX, GREATEST_INDEX))
        )
        for a, b in zip(x, y, strict=True)
    ]
    assert widened.contains(x, y).tolist() == expected
    assert widened.strips(10**6) is None
    keys = pack(x, y)
    strips = widened.strips_among(np.unique(keys >> np.uint64(STRIP_BITS)))
    inside = cells_in(strips)
    assert [int(key) in inside for key in keys] == expected


def test_cells_list_the_patches_of_each_cell() -> None:
    surface = random_map(np.random.default_rng(4), fill=0.8)
    cells = surface.cells
    listed = [
        (int(x), int(y), surface.height[begin:end].tolist())
        for x, y, begin, end in zip(
            cells.ix, cells.iy, cells.start[:-1], cells.start[1:], strict=True
        )
    ]
    patches = patches_of(surface)
    assert listed == [
        (*cell, [p.height for p in patches if p.cell == cell])
        for cell in sorted({p.cell for p in patches})
    ]


def test_a_crop_and_what_is_left_make_the_map_again() -> None:
    surface = random_map(np.random.default_rng(2), fill=0.9)
    crop = surface.crop(min_x=int(np.median(surface.ix)))
    cells = CellSet.of(crop.ix, crop.iy)
    assert 0 < crop.size < surface.size
    assert surface.replace(cells, SurfaceMap.of(Grid(0.5, 0.75, 0.25))).union(crop) == surface
    assert surface.replace(cells, surface) == surface


def test_maps_are_equal_where_all_but_route_and_meta_is() -> None:
    surface = a_map()
    assert surface == replace(surface, meta={"sources": ["another"]}, route=surface.route + 1)
    assert surface != replace(surface, frame_id="odom")
    assert surface != replace(surface, gap_size=0.5)
    for name in COLUMNS:
        column = getattr(surface, name).copy()
        column[0] += 1
        assert surface != replace(surface, **{name: column})
    assert surface != surface.take(np.array([0, 1]))
    assert replace(surface, height=surface.height * 0.0) != replace(
        surface, height=surface.height * -0.0
    )


def test_a_sound_map_passes_its_check() -> None:
    a_map().check()
    SurfaceMap.of(Grid(1.0, 1.0, 0.0)).check()


NAN = np.nan
FAULTS: dict[str, dict[str, Any]] = {
    "cell_size": {"cell_size": 0.0},
    "gap_size": {"gap_size": NAN},
    "thickness": {"thickness": -1.0},
    "ix": {"ix": np.array([0, 0, -1], dtype=np.int32)},
    "iy": {"iy": np.array([0, 0, 1], dtype=np.int64)},
    "height": {"height": np.array([1.0, NAN, 1.0])},
    "depth": {"depth": np.array([0.0, -0.5, 0.0])},
    "top": {"top": np.array([NAN, 3.0, NAN])},
    "bottom": {"bottom": np.array([1.0, 2.5, 1.0])},
    "mean": {"mean": np.array([1.5, 2.75, NAN])},
    "variance": {"variance": np.array([0.0, -1.0, NAN])},
    "noise": {"noise": np.array([0.0, -1.0, NAN], dtype=np.float32)},
    "count": {"count": np.array([3, 0, 0], dtype=np.uint32)},
    "origin": {"origin": np.array([0, 0, 3], dtype=np.uint8)},
    "region": {"region": np.array([-1, -2, 0], dtype=np.int32)},
    "first_keyframe": {"first_keyframe": np.array([0, 5, -1], dtype=np.int32)},
    "last_keyframe": {"last_keyframe": np.array([3, 99, -1], dtype=np.int32)},
    "route": {"route": np.zeros((7, 3))},
}
FAULTS_BY_WORDS: dict[str, dict[str, Any]] = {
    r"height: holds values beyond 2e\+08": {"height": np.array([1.0, 3.0, 1e300])},
    r"depth: holds values beyond 2e\+08": {"depth": np.array([0.0, 1e300, 0.0])},
    r"depth: holds -0\.5; it must": FAULTS["depth"],
    r"route: holds infinite values": {"route": np.full((7, 4), -np.inf)},
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_check_names_the_array_at_fault(name: str) -> None:
    with pytest.raises(InputError, match=rf"^{name}\b"):
        replace(a_map(), **FAULTS[name]).check()


@pytest.mark.parametrize("words", FAULTS_BY_WORDS)
def test_a_check_says_what_is_wrong(words: str) -> None:
    with pytest.raises(InputError, match=f"^{words}"):
        replace(a_map(), **FAULTS_BY_WORDS[words]).check()


def test_no_patch_may_be_there_twice() -> None:
    inserted = [Patch(0, 0, 1.0, 0.0, origin, 0) for origin in (1, 2, 2)]

    map_of(inserted[:2]).check()
    with pytest.raises(InputError, match="a patch is there twice"):
        map_of(inserted).check()


def test_measured_patches_of_a_cell_may_not_overlap() -> None:
    twice = [Patch(0, 0, 1.0, 0.0, 0, 3), Patch(0, 0, 1.0, 0.0, 0, 3)]
    within = [Patch(0, 0, 1.0, 0.0, 0, 3), Patch(0, 0, 2.0, 1.5, 0, 3)]
    for patches in (twice, within):
        with pytest.raises(InputError, match=r"^bottom, top: .* of one cell overlap"):
            map_of(patches).check()
        apart = [patches[0], patches[1]._replace(ix=1)]
        map_of(apart).check()
        inserted = [patches[0], patches[1]._replace(origin=1, count=0)]
        map_of(inserted).check()


BEYOND: list[dict[str, Any]] = [
    {"height": np.array([1.5, 3.0, 1.0])},
    {"height": np.array([0.5, 3.0, 1.0])},
    {"height": np.array([1.0, 3.25, 1.0])},
    {"depth": np.array([0.0, 0.75, 0.0])},
    {"depth": np.array([0.25, 0.5, 0.0])},
]


@pytest.mark.parametrize("ends", BEYOND)
def test_a_measured_patch_lies_within_its_points_or_is_marked(ends: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=r"^height: lies beyond bottom and top"):
        replace(a_map(), **ends).check()
    moved = a_map().with_columns(**ends)
    moved.check()
    assert moved.moved.sum() == 1


@pytest.mark.parametrize("marked", [0, 1, 2])
def test_no_other_patch_is_marked_as_moved(marked: int) -> None:
    moved = (np.arange(3) == marked).astype(np.uint8)
    with pytest.raises(InputError, match=r"^moved: must be 1 for measured patches"):
        replace(a_map(), moved=moved).check()
    # The wall, shortened at both ends, lies within its points still.
    shorter = replace(a_map(), height=np.array([1.0, 2.9, 1.0]), depth=np.array([0.0, 0.25, 0.0]))
    shorter.check()
    with pytest.raises(InputError, match=r"^moved: "):
        replace(shorter, moved=moved).check()


def test_the_rounding_of_a_lower_end_moves_nothing() -> None:
    rng = np.random.default_rng(5)
    for scale in (1e-3, 1.0, 1e8):
        ends = rng.uniform(0.1, 1, (300, 2)) * scale
        surface = map_of([Patch(x, 0, z, depth, 0, 3) for x, (z, depth) in enumerate(ends)])
        # As stages compute them: from the lower end up to a height within the patch.
        height = surface.height - rng.uniform(0, 1, 300) * surface.depth
        lowered = surface.with_columns(height=height, depth=height - surface.low_end)
        assert not lowered.moved.any()
        lowered.check()
        assert surface.with_columns(depth=surface.depth * (1 + 1e-12)).moved.all()


def test_a_check_finds_patches_out_of_order() -> None:
    surface = a_map()
    with pytest.raises(InputError, match="sorted"):
        surface.take(np.array([1, 0, 2])).check()


def test_patches_are_sorted_by_every_key_in_turn() -> None:
    rows = [Patch(0, 5, 2.0, 0.0, 0, 3), Patch(1, 0, 1.0, 0.0, 1, 0), Patch(1, 0, 1.0, 0.5, 0, 3)]
    map_of(rows).check()
    for order in ([1, 0, 2], [0, 2, 1], [1, 2, 0]):
        with pytest.raises(InputError, match="sorted"):
            map_of(rows).take(np.array(order)).check()
    same_but_origin = map_of([Patch(0, 0, 1.0, 0.0, 0, 3), Patch(0, 0, 1.0, 0.0, 1, 0)])
    same_but_origin.check()
    with pytest.raises(InputError, match="sorted"):
        same_but_origin.take(np.array([1, 0])).check()


def test_a_keyframe_must_be_a_row_of_the_route() -> None:
    surface = a_map()
    last = int(surface.last_keyframe.max())
    replace(surface, route=surface.route[: last + 1]).check()
    with pytest.raises(InputError, match="last_keyframe"):
        replace(surface, route=surface.route[:last]).check()
