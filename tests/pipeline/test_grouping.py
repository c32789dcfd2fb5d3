"""From points to measured patches, and maps merged, by single linkage.

How one could cheat: clouds with one group a cell, no equal heights, no negative cells.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mlscli.errors import UsageError
from mlscli.keyframes.batches import Points
from mlscli.maps.columns import COLUMNS
from mlscli.maps.grid import Grid
from mlscli.maps.merging import merge_maps
from mlscli.maps.recorded import TURN
from mlscli.maps.surface_map import SurfaceMap
from mlscli.pipeline.grouping import group
from mlscli.runtime.arrays import Bool
from tests.helpers import point_references as references
from tests.helpers.maps import (
    CELL,
    GAP,
    KEYFRAMES,
    THICKNESS,
    Patch,
    add_measured,
    map_of,
    patches_of,
    random_points,
    symmetries,
    turned_map,
    turned_points,
)

ROUTE = np.full((KEYFRAMES, 4), np.nan)


def measured(points: Points) -> SurfaceMap:
    return replace(group(points, Grid(CELL, GAP, THICKNESS)), route=ROUTE)


def noisy_points(rng: np.random.Generator) -> Points:
    """Return a cloud; of most the noise of the heights is known, in steps of a 1024th."""
    points = random_points(rng)
    if rng.random() < 0.8:
        points.noise[:] = rng.integers(0, 99, points.size) / 1024
    return points


def split(points: Points, first: Bool) -> tuple[Points, Points]:
    one = points.take(first)
    return one, points.take(~first)


def test_patches_agree_with_the_model_read_plainly() -> None:
    rng = np.random.default_rng(1)
    vertical = several = 0
    for _ in range(300):
        points = noisy_points(rng)
        surface = measured(points)
        surface.check()
        rows = references.measured(points, CELL, GAP, THICKNESS)
        for name in COLUMNS:
            expected = np.array([row[name] for row in rows], dtype=COLUMNS[name])
            np.testing.assert_array_equal(getattr(surface, name), expected)
        vertical += int((surface.depth > 0).sum())
        several += int((np.diff(surface.cells.start) > 1).sum())
    assert vertical > 100
    assert several > 100


def test_a_noisy_floor_stays_a_floor_with_more_points() -> None:
    rng = np.random.default_rng(2)
    for size in (4, 36, 1000):
        xyz = np.c_[rng.uniform(0, CELL, (size, 2)), rng.normal(0, 0.07, size)]
        surface = measured(Points.of(xyz, np.zeros(size, dtype=np.int32)))
        assert surface.depth.tolist() == [0.0]
    assert float(surface.top[0] - surface.bottom[0]) > THICKNESS


def test_shuffling_and_turning_the_points_turns_the_map() -> None:
    rng = np.random.default_rng(3)
    for _ in range(100):
        points = noisy_points(rng)
        surface = measured(points)
        order = rng.permutation(points.size)
        assert measured(points.take(order)) == surface
        for symmetry in symmetries():
            assert measured(turned_points(points, symmetry)) == turned_map(surface, symmetry)


def test_merging_two_maps_gives_the_map_of_all_points() -> None:
    rng = np.random.default_rng(4)
    joined = 0
    for _ in range(300):
        points = noisy_points(rng)
        one, other = split(points, rng.random(points.size) < rng.random())
        expected = measured(points)
        # Both number keyframes from the same route.
        for merged in (
            add_measured(measured(one), measured(other)),
            add_measured(measured(other), measured(one)),
        ):
            merged.check()
            for name in COLUMNS:
                mine, right = getattr(merged, name), getattr(expected, name)
                if name in ("mean", "variance", "noise", "height"):
                    rounding = 1e-6 if name == "noise" else 1e-12
                    np.testing.assert_allclose(mine, right, rtol=rounding, atol=1e-12)
                elif name == "depth":
                    # A spread within rounding of the thickness may fall either way.
                    np.testing.assert_array_equal(mine, right)
                else:
                    np.testing.assert_array_equal(mine, right)
        joined += measured(one).size + measured(other).size > expected.size
    assert joined > 100


def test_merged_maps_number_the_second_flight_after_the_first() -> None:
    points = random_points(np.random.default_rng(5), 60)
    one, other = split(points, np.arange(60) < 30)
    merged = merge_maps(measured(one), measured(other))
    merged.check()
    assert len(merged.route) == 2 * KEYFRAMES
    second = Points.of(other.xyz, other.keyframe + KEYFRAMES)
    both = Points.of(
        np.concatenate((one.xyz, second.xyz)), np.concatenate((one.keyframe, second.keyframe))
    )
    expected = measured(both)
    assert merged.count.tolist() == expected.count.tolist()
    assert merged.first_keyframe.tolist() == expected.first_keyframe.tolist()
    assert merged.last_keyframe.tolist() == expected.last_keyframe.tolist()


def test_new_points_undo_corrections_and_delete_what_was_inserted_near_them() -> None:
    lowered = map_of([Patch(0, 0, 1.0, 0.0, 0, 5), Patch(0, 0, 3.0, 0.0, 2, 0)])
    lowered = lowered.with_columns(height=np.array([0.9, 3.0]))
    elsewhere = replace(map_of([Patch(0, 0, 9.0, 0.0, 0, 5)]), route=ROUTE)
    assert add_measured(lowered, elsewhere).moved.tolist() == [1, 0, 0]
    assert merge_maps(lowered, elsewhere).moved.tolist() == [1, 0, 0]
    assert add_measured(lowered, elsewhere).height.tolist() == [0.9, 3.0, 9.0]
    near_the_inserted = map_of([Patch(0, 0, 3.0 - GAP, 0.0, 0, 5)])
    assert add_measured(lowered, near_the_inserted).origin.tolist() == [0, 0]
    on_the_lowered = map_of([Patch(0, 0, 1.0, 0.0, 0, 5)])
    merged = add_measured(lowered, on_the_lowered)
    assert merged.height.tolist() == [1.0, 3.0]
    assert merged.count.tolist() == [10, 0]
    assert merged.moved.tolist() == merge_maps(lowered, on_the_lowered).moved.tolist() == [0, 0]


@pytest.mark.parametrize(("height", "goes_back"), [(3.0 + GAP, True), (3.001 + GAP, False)])
def test_what_was_drawn_out_gives_way_to_what_is_measured_near_its_end(
    height: float, goes_back: bool
) -> None:
    wall = map_of([Patch(0, 0, 2.0, 1.0, 0, 5), Patch(1, 0, 2.0, 1.0, 0, 5)])
    drawn = wall.with_columns(height=np.full(2, 3.0), depth=np.full(2, 2.0))
    floor = map_of([Patch(0, 0, height, 0.0, 0, 5)])

    for grown in (add_measured(drawn, floor), merge_maps(drawn, floor), merge_maps(floor, drawn)):
        assert grown.height.tolist() == [2.0 if goes_back else 3.0, height, 3.0]
        assert grown.depth.tolist() == [1.0 if goes_back else 2.0, 0.0, 2.0]
        assert grown.moved.tolist() == [0 if goes_back else 1, 0, 1]


def test_of_inserted_patches_of_two_maps_the_higher_stays() -> None:
    one = map_of([Patch(0, 0, 1.0, 0.0, 1, 0), Patch(1, 0, 1.0, 0.0, 2, 0)])
    other = map_of([Patch(0, 0, 1.5, 0.0, 2, 0), Patch(1, 0, 1.0, 0.0, 1, 0)])
    for merged in (merge_maps(one, other), merge_maps(other, one)):
        assert [(p.height, p.origin) for p in patches_of(merged)] == [(1.5, 2), (1.0, 1)]
    assert merge_maps(one, one) == one


def test_maps_of_different_grids_are_not_merged() -> None:
    with pytest.raises(UsageError, match="cell_size"):
        merge_maps(map_of([]), map_of([], cell_size=1.0))


def test_a_group_within_another_does_not_hide_what_reaches_on() -> None:
    def of(*heights: float) -> SurfaceMap:
        xyz = np.array([[0.1, 0.1, z] for z in heights])
        return measured(Points.of(xyz, np.zeros(len(heights), dtype=np.int32)))

    tall, inside, above = of(*np.arange(0, 5, 0.5)), of(1.0), of(4.5 + GAP)
    merged = add_measured(add_measured(tall, inside), above)
    assert merged.count.tolist() == [12]
    assert add_measured(add_measured(above, inside), tall).count.tolist() == [12]


def test_what_was_inserted_stays_beside_measurements_that_did_not_change() -> None:
    wall = [Patch(0, 0, 1.0, 1.0, 0, 5), Patch(0, 0, 3.0, 1.0, 0, 5)]
    filled = map_of([*wall, Patch(0, 0, 2.0, 1.0, 1, 0)])
    assert add_measured(filled, map_of([Patch(0, 0, 9.0, 0.0, 0, 5)])).origin.tolist() == [
        0,
        1,
        0,
        0,
    ]
    # The heights measured decide, not the mean that a floor is drawn at.
    xyz = np.array([[0.1, 0.1, z] for z in (4.2, 4.3)])
    below = measured(Points.of(xyz, np.zeros(2, dtype=np.int32)))
    inserted = map_of([Patch(0, 0, 4.2 - GAP, 0.0, 1, 0)])
    assert add_measured(inserted, below).origin.tolist() == [0]


def test_of_two_maps_each_deletes_what_the_other_inserted_near_its_measurements() -> None:
    found = replace(map_of([Patch(0, 0, 1.0, 0.0, 0, 5)]), region=np.array([7], dtype=np.int32))
    guessed = map_of([Patch(0, 0, 1.0 + GAP, 0.0, 2, 0)])
    for merged in (merge_maps(found, guessed), merge_maps(guessed, found)):
        assert merged.origin.tolist() == [0]
        assert merged.region.tolist() == [-1]


def test_maps_of_different_frames_are_not_merged() -> None:
    one = map_of([Patch(0, 0, 1.0, 0.0, 0, 5)])
    other = replace(one, frame_id="odom")
    with pytest.raises(UsageError, match="different frames do not go together: 'map' and 'odom'"):
        merge_maps(one, other)
    merged = merge_maps(other, other)
    assert (merged.frame_id, merged.count.tolist()) == ("odom", [10])


def test_maps_turned_in_different_ways_are_not_merged() -> None:
    one = map_of([Patch(0, 0, 1.0, 0.0, 0, 5)])

    def turned(degrees: float, east: float) -> SurfaceMap:
        turn = np.eye(4)
        turn[:3, :3] = Rotation.from_euler("x", degrees, degrees=True).as_matrix()
        turn[0, 3] = east
        return replace(one, meta={TURN: turn.tolist()})

    for other in (one, turned(0, 0), turned(1e-6, 0)):
        assert merge_maps(turned(0, 0), other).count.tolist() == [10]
    # A shift is rounded in proportion to its length.
    assert merge_maps(turned(90, 5e5), turned(90, 5e5 + 1e-2)).meta == turned(90, 5e5).meta
    for mine, other in ((one, turned(90, 0)), (turned(90, 5e5), turned(90, 5e5 + 1))):
        for pair in ((mine, other), (other, mine)):
            with pytest.raises(UsageError, match="map_from_recording differ by 1; build both with"):
                merge_maps(*pair)
