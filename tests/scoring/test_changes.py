"""What appeared and what went between two flights.

Ways to pass without being right: whatever is in one map only counts as gone, so a flight that did
not look is among them; scenes without noise; things apart that are counted as one.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mlscli.config import load
from mlscli.errors import UsageError
from mlscli.maps.free_space import FreeSpace
from mlscli.maps.surface_map import SurfaceMap
from mlscli.scenes.flight import fly
from mlscli.scenes.noise import Noise
from mlscli.scenes.surfaces import Scatter, Scene, add_horizontal, add_vertical
from mlscli.scoring.changes import Changes, changes
from mlscli.trials.staged import mapped
from tests.helpers.meshes import Column, a_map, plane

Voxel = tuple[int, int, int]

FLOOR = plane(9, 9)
# A block of 3 by 3 cells, 2 high, on the floor of cells of 1.
BLOCK: list[Column] = [(x, y, 2.0, 2.0) for x in (3, 4, 5) for y in (3, 4, 5)]
AIR = list(product(range(9), range(9), range(1, 8)))


def seen(columns: Iterable[Column], voxels: Iterable[Voxel], lines: int = 5) -> SurfaceMap:
    """Return a map in cells of 1 that saw through voxels of 1 x 1 x 0.5."""
    ordered = np.array(sorted(set(voxels)), dtype=np.int32).reshape(-1, 3)
    cells, start = np.unique(ordered[:, :2], axis=0, return_index=True)
    free = FreeSpace(
        cells[:, 0], cells[:, 1], np.append(start, len(ordered)).astype(np.int64), ordered[:, 2],
        np.full(len(ordered), lines, dtype=np.uint8),
    )  # fmt: skip
    return replace(a_map(*columns), free=free)


def without(columns: Iterable[Column], others: Iterable[Column]) -> list[Column]:
    cells = {column[:2] for column in others}
    return [column for column in columns if column[:2] not in cells]


EMPTY = seen(FLOOR, AIR)
FULL = seen([*without(FLOOR, BLOCK), *BLOCK], AIR)


def test_what_was_measured_and_is_seen_through_now_is_gone() -> None:
    found = changes(FULL, EMPTY, smallest=1)
    (thing,) = found.gone
    assert found.appeared == []
    # The lowest voxel touches the floor that is there now.
    assert thing.low == (3, 3, 1.0)
    assert thing.high == (6, 6, 2.5)
    assert thing.volume == 3 * 3 * 1.5
    assert (found.smaller, found.not_seen_again, found.not_seen_before) == ((0, 0), 0, 0)
    assert found.changed


def test_what_is_measured_where_it_was_seen_through_has_appeared() -> None:
    found = changes(EMPTY, FULL, smallest=1)
    assert found.gone == []
    assert found.appeared == changes(FULL, EMPTY, smallest=1).gone


def test_what_was_not_looked_at_again_is_not_gone() -> None:
    blind = seen(without(FLOOR, BLOCK), [voxel for voxel in AIR if voxel[2] > 4])
    found = changes(FULL, blind)
    assert not found.changed
    assert found.not_seen_again == len(BLOCK)
    assert changes(blind, FULL).not_seen_before == len(BLOCK)


def test_one_line_may_be_wrong() -> None:
    once = replace(EMPTY, free=seen(FLOOR, AIR, lines=1).free)
    assert not changes(FULL, once).changed
    assert changes(FULL, once, least=1, smallest=1).changed


def test_what_lies_a_cell_or_half_a_cell_elsewhere_is_the_same() -> None:
    moved = [(x + 1, y, z + 0.4, depth) for x, y, z, depth in BLOCK]
    other = seen([*without(FLOOR, moved), *moved], AIR)
    assert not changes(FULL, other).changed
    far = [(x + 3, y, z, depth) for x, y, z, depth in BLOCK]
    both = changes(FULL, seen([*without(FLOOR, far), *far], AIR), smallest=1)
    assert (len(both.gone), len(both.appeared)) == (1, 1)


def test_what_was_inserted_was_never_there() -> None:
    origin = np.where(FULL.height > 1, 2, 0).astype(np.uint8)
    guessed = replace(FULL, origin=origin)
    assert not changes(guessed, EMPTY).changed


def test_things_apart_are_told_apart_the_largest_first_and_small_ones_counted() -> None:
    small: list[Column] = [(0, 0, 2.0, 2.0)]
    pole: list[Column] = [(8, 8, 3.5, 3.5)]
    every = [*BLOCK, *small, *pole]
    full = seen([*without(FLOOR, every), *every], AIR)
    found = changes(full, EMPTY, smallest=2)
    assert [thing.low[:2] for thing in found.gone] == [(3, 3), (8, 8)]
    assert found.smaller == (0, 1)


@given(st.sets(st.sampled_from(AIR)), st.sets(st.sampled_from(AIR)), st.integers(0, 2**32 - 1))
def test_it_is_what_the_rule_says_voxel_by_voxel(
    looked: set[Voxel], looked_again: set[Voxel], seed: int
) -> None:
    rng = np.random.default_rng(seed)
    towers = [
        [(x, y, h, h) for x in range(9) for y in range(9) if (h := float(rng.integers(0, 4))) > 1]
        for _ in range(2)
    ]
    one, other = (
        seen([*without(FLOOR, tower), *tower], voxels)
        for tower, voxels in zip(towers, (looked, looked_again), strict=True)
    )
    found = changes(one, other, smallest=0)

    def taken(surface: SurfaceMap, voxel: Voxel) -> bool:
        x, y, z = voxel
        there = (surface.ix == x) & (surface.iy == y)
        low, high = np.floor(surface.low_end[there] * 2), np.floor(surface.height[there] * 2)
        return bool(((low <= z) & (z <= high)).any())

    def beside(voxel: Voxel) -> list[Voxel]:
        x, y, z = voxel
        return [(x + i, y + j, z + k) for i, j, k in product((-1, 0, 1), repeat=3)]

    gone = [
        voxel
        for voxel in looked_again
        if taken(one, voxel) and not any(taken(other, near) for near in beside(voxel))
    ]
    assert sum(thing.volume for thing in found.gone) == len(gone) / 2
    for voxel in gone:
        middle = np.array(voxel) * (1, 1, 0.5) + (0.5, 0.5, 0.25)
        assert any(
            (thing.low < middle).all() and (middle < thing.high).all() for thing in found.gone
        )


def test_maps_that_cannot_tell_are_refused() -> None:
    with pytest.raises(UsageError, match="the second map does not say what was seen through"):
        changes(FULL, a_map(*FLOOR))
    with pytest.raises(UsageError, match="the first map does not say"):
        changes(a_map(*FLOOR), FULL)
    with pytest.raises(UsageError, match="different frames: 'map' and 'odom'"):
        changes(FULL, replace(EMPTY, frame_id="odom"))
    with pytest.raises(UsageError, match="cell_size"):
        changes(FULL, a_map(*FLOOR, cell_size=0.5))


def yard(car: bool) -> Scene:
    """Return a yard with a shed, and perhaps a box of 2 by 1.2 by 1 in it."""
    scene = add_horizontal(Scene("yard"), position=(0, 0, 0), size=(10, 8))
    scene = add_horizontal(scene, position=(-3, -2, 1.6), size=(2.4, 2.4))
    scene = add_vertical(scene, position=(-3, -0.8, 0.8), size=(2.4, 1.6))
    if car:
        scene = add_horizontal(scene, position=(2, 2, 1.0), size=(2, 1.2))
        for y in (1.4, 2.6):
            scene = add_vertical(scene, position=(2, y, 0.5), size=(2, 1))
    return scene


def flown(car: bool, seed: int) -> SurfaceMap:
    flight = fly(yard(car), 0.12, Noise(sigma=Scatter(0.03, 0.03), salt_pepper=0.1), seed=seed)
    return mapped(flight, load("default", ["map.cell_size=0.25", "map.free_space=true"]))


def test_a_car_that_drove_off_is_gone_and_nothing_else() -> None:
    found = changes(flown(True, 1), flown(False, 2))
    (car,) = found.gone
    assert found.appeared == []
    assert car.low == pytest.approx((1, 1.4, 0.3), abs=0.3)
    assert car.high == pytest.approx((3, 2.6, 1.0), abs=0.3)


def test_two_flights_over_the_same_place_tell_of_no_change() -> None:
    assert not changes(flown(True, 3), flown(True, 4)).changed


def test_as_json_it_has_all_fields() -> None:
    told = changes(FULL, EMPTY, smallest=1).to_dict()
    assert set(told) == {"changed", *Changes.__dataclass_fields__}
    assert told["gone"] == [{"low": (3, 3, 1.0), "high": (6, 6, 2.5), "volume": 13.5}]
