"""Lines counted in the voxels that they pass through, against fractions.

How one could cheat: lines that meet no edge or corner, or none that is shared; lines from one side
only; clouds that fit into the first room for blocks; a limit that is checked after the work.
"""

from __future__ import annotations

import time
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mlscli.keyframes.batches import Points
from mlscli.pipeline.line_counts import LONGEST, LineCounts, NoRoomError
from mlscli.runtime.arrays import Float64
from tests.helpers.lines import counted, counts_of, free_space_of
from tests.helpers.maps import CELL, symmetries

NAN = float("nan")
Flight = tuple[Points, Float64]


@st.composite
def flights(draw: st.DrawFn) -> Flight:
    """Draw points and a route; some on a lattice, so that lines meet edges, corners and borders."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    keyframes, size = int(rng.integers(1, 6)), int(rng.integers(1, 40))
    craft = rng.uniform((-4, -4, -2), (4, 4, 4), (keyframes, 3))
    xyz = rng.uniform((-4, -4, -2), (4, 4, 4), (size, 3))
    steps = draw(st.sampled_from([None, 1, 2, 8]))
    if steps:
        # Voxels are 0.5 wide and 0.25 high.
        craft, xyz = np.round(craft * steps) / steps, np.round(xyz * steps) / steps
        craft += rng.choice([0, 0.03, 0.25], 3)
    keyframe = rng.integers(0, keyframes, size).astype(np.int32)
    # Some go along an axis or a diagonal.
    along = rng.choice([0, 1], (size, 3), p=(0.2, 0.8))
    xyz = np.where(along == 0, craft[keyframe], xyz)
    route = np.column_stack((np.arange(float(keyframes)), craft))
    route[rng.random(keyframes) < 0.1, rng.integers(1, 4)] = NAN
    return Points.of(xyz + 0.0, keyframe), route


def following(flight: Flight, cell_size: float = CELL) -> LineCounts:
    counts = LineCounts(cell_size)
    counts.add(*flight)
    return counts


def line(
    craft: tuple[float, float, float], point: tuple[float, float, float], times: int = 1
) -> Flight:
    xyz = np.repeat(np.array([point], dtype=np.float64), times, axis=0)
    keyframe = np.zeros(times, dtype=np.int32)
    return Points.of(xyz, keyframe), np.array([(0.0, *craft)])


@settings(max_examples=80)
@given(flights())
def test_lines_count_in_the_voxels_that_they_pass_through(flight: Flight) -> None:
    expected = counted(*flight, CELL)
    free = following(flight).free_space()
    free.check()
    assert counts_of(free) == expected
    assert free == free_space_of(expected)


def test_sides_that_no_number_holds_are_no_exception() -> None:
    rng = np.random.default_rng(3)
    craft, xyz = rng.uniform(-2, 2, (2, 3)), rng.uniform(-2, 2, (60, 3))
    points = Points.of(xyz, rng.integers(0, 2, 60).astype(np.int32))
    route = np.column_stack((np.arange(2.0), craft))
    for size in (0.15, 0.27, 1 / 3):
        assert counts_of(following((points, route), size).free_space()) == counted(
            points, route, size
        )


@settings(max_examples=35)
@given(flights())
def test_turned_and_mirrored_lines_count_in_turned_and_mirrored_voxels(flight: Flight) -> None:
    points, route = flight
    there = counts_of(following(flight).free_space())
    for (swap, *negate), flip in product(symmetries(), (False, True)):
        signs = np.where([*negate, flip], -1.0, 1.0)
        axes = [1, 0, 2] if swap else [0, 1, 2]
        turned = route.copy()
        turned[:, 1:] = (route[:, 1:] * signs)[:, axes]
        xyz = np.ascontiguousarray((points.xyz * signs)[:, axes])
        free = following((Points.of(xyz, points.keyframe), turned)).free_space()
        expected = {}
        for voxel, count in there.items():
            mirrored = [-1 - i if sign < 0 else i for i, sign in zip(voxel, signs, strict=True)]
            x, y, z = (mirrored[axis] for axis in axes)
            expected[x, y, z] = count
        assert counts_of(free) == expected


@settings(max_examples=35)
@given(flights(), st.integers(0, 2**32 - 1))
def test_neither_order_nor_parts_matter(flight: Flight, seed: int) -> None:
    points, route = flight
    rng = np.random.default_rng(seed)
    shuffled = points.take(rng.permutation(points.size))
    counts = LineCounts(CELL)
    for part in np.array_split(np.arange(points.size), int(rng.integers(1, 5))):
        counts.add(shuffled.take(part), route)
    assert counts.free_space() == following(flight).free_space()


def test_a_line_ends_a_cell_before_its_point() -> None:
    # Down through voxels 0.25 high, from within 11: 2.5 less a cell is 2.0 above the point.
    free = following(line((0.2, 0.2, 2.8), (0.2, 0.2, 0.3))).free_space()
    assert free.voxels.tolist() == [[0, 0, z] for z in range(3, 12)]
    near = following(line((0.2, 0.2, 2.8), (0.2, 0.2, 2.3)))
    assert near.free_space().size == near.left_out == 0


def test_through_edges_and_corners_and_along_sides_lines_pass_through_no_voxel() -> None:
    diagonal = following(line((0.25, 0.25, 0.125), (4.25, 4.25, 2.125))).free_space()
    assert [voxel for voxel in diagonal.voxels.tolist() if len(set(voxel)) > 1] == []
    assert diagonal.size > 5
    for craft in ((0.5, 0.2, 3.0), (0.2, 1.0, 3.0), (0.0, 0.0, 3.0)):
        assert following(line(craft, (*craft[:2], 0.0))).free_space().size == 0
    assert following(line((0.2, 0.2, 0.75), (3.2, 0.2, 0.75))).free_space().size == 0


def test_counts_stop_at_255() -> None:
    for times in (254, 255, 256, 1000):
        free = following(line((0.2, 0.2, 3.1), (0.2, 0.2, 0.1), times)).free_space()
        assert set(free.lines.tolist()) == {min(times, 255)}


def test_without_a_position_there_is_no_line() -> None:
    for craft in ((NAN, 0.0, 9.0), (0.2, 0.2, NAN), (NAN, NAN, NAN)):
        counts = following(line(craft, (0.2, 0.2, 0.1)))
        assert counts.free_space().size == counts.left_out == 0
    counts.add(Points.of(np.empty((0, 3)), np.empty(0, dtype=np.int32)), np.empty((0, 4)))
    assert counts.free_space().size == 0


def test_lines_of_any_length_and_place_are_followed_or_left_out_at_once() -> None:
    # Far from the origin, as coordinates of maps are.
    for x, y in ((4.5e6, -5.5e6), (8.0 - 2.0**30, 2.0**29)):
        flight = line((x + 0.3, y + 0.3, 9.1), (x + 3.3, y - 1.2, 0.1))
        assert counts_of(following(flight).free_space()) == counted(*flight, CELL)
    flight = line((0.2, 0.3, 0.1), (CELL * LONGEST * 0.99, 0.3, 0.1))
    assert following(flight).free_space().size == pytest.approx(0.99 * LONGEST, abs=3)
    begin = time.perf_counter()
    for craft, left_out in (
        ((CELL * LONGEST * 1.01, 0.3, 9.0), 1),
        ((1e9 * CELL, 0.3, 9.0), 1),
        ((0.3, 1e30, 9.0), 1),
        ((0.3, 0.3, -1e300), 1),
        ((0.3, 0.3, float("inf")), 1),
    ):
        counts = following(line(craft, (0.2, 0.2, 0.1)))
        assert (counts.free_space().size, counts.left_out) == (0, left_out)
    edge = following(line((2.0**30 + 9.0, 0.3, 3.0), (2.0**30 - 0.3, 0.3, 0.1)))
    assert (edge.free_space().size, edge.left_out) == (0, 1)
    assert time.perf_counter() - begin < 1


def test_many_blocks_find_room_or_are_refused_before_it_is_taken() -> None:
    rng = np.random.default_rng(5)
    xyz = rng.uniform(-60, 60, (400, 3))
    points = Points.of(xyz, np.zeros(400, dtype=np.int32))
    route = np.array([(0.0, 0.3, 0.3, 0.3)])
    free = following((points, route)).free_space()
    assert free.size > 30_000
    # Without room to spare, it grows often.
    rows = counts_of(free)
    for part in (xyz[:7], xyz[200:203]):
        some = Points.of(part, np.zeros(len(part), dtype=np.int32))
        assert counted(some, route, CELL).keys() <= rows.keys()
    counts = LineCounts(CELL, most=100_000)
    with pytest.raises(NoRoomError, match="`free_space`: takes more than") as caught:
        counts.add(points, route)
    assert caught.value.least > 100_000
    # The blocks fit, and the list of voxels does not.
    blocks = len(np.unique(free.voxels >> 3, axis=0))
    for room, fits in (
        (556 * blocks + 4 * free.size, False),
        (556 * blocks + 30 * free.size, True),
    ):
        counts = LineCounts(CELL, most=room)
        counts.add(points, route)
        if fits:
            assert counts.free_space() == free
        else:
            with pytest.raises(NoRoomError):
                counts.free_space()
