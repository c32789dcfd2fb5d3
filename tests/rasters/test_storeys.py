"""Storeys: what is free, occupied and unknown for a robot, and which floors go together.

How one could cheat: to call all that was seen free, or all that is not; to take the lowest
heights for a floor, so that the deck of a bridge vanishes; to join two terraces across the wall
between them, as a ramp elsewhere does; to draw red patches as floor; to let nothing known between
count as free. Each has a scene here, and random maps are held to the rules cell by cell.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mlscli import build_map, open_recording
from mlscli.errors import UsageError
from mlscli.maps.space import FREE, OCCUPIED, UNKNOWN
from mlscli.maps.surface_map import SurfaceMap
from mlscli.rasters.extent import MOST_CELLS
from mlscli.rasters.robot import Robot
from mlscli.rasters.storeys import Storey, Storeys, storeys_of
from tests.helpers.maps import Patch, map_of, random_map

SIZE = 0.5
ROBOT = Robot(slope=20, step=0.15, headroom=1.0)


def scene(*boxes: tuple[range, range, float]) -> list[Patch]:
    """Return measured floors, each over ranges of ix and iy, at a height."""
    return [Patch(x, y, z, 0.0, 0, 3) for xs, ys, z in boxes for x in xs for y in ys]


def found(patches: list[Patch], robot: Robot = ROBOT) -> Storeys:
    return storeys_of(map_of(patches, cell_size=SIZE), robot)


def state(found: Storeys, storey: Storey, x: int, y: int) -> int:
    return int(storey.space[y - found.extent.min_y, x - found.extent.min_x])


def states(found: Storeys, storey: Storey, *cells: tuple[int, int]) -> set[int]:
    return {state(found, storey, x, y) for x, y in cells}


GROUND = (range(-10, 10), range(-6, 6), 0.0)


def test_a_plain_is_free_and_what_was_not_seen_beside_it_is_unknown() -> None:
    patches = [p for p in scene(GROUND) if p.cell not in {(0, 0), (1, 0)}]
    result = found(patches)
    (storey,) = result.storeys
    assert states(result, storey, (0, 0), (1, 0)) == {UNKNOWN}
    assert np.count_nonzero(storey.space == FREE) == len(patches)
    assert (result.extent, result.left_out) == ((-10, -6, 20, 12), 0)


def test_walls_and_what_is_too_low_to_pass_are_occupied_and_what_is_high_enough_is_not() -> None:
    patches = [p for p in scene(GROUND) if p.ix != 0]
    patches += [Patch(0, y, 2.0, 2.0, 0, 5) for y in range(-6, 6)]
    patches += [Patch(-5, y, 0.9, 0.0, 0, 1) for y in range(-6, 6)]
    patches += [Patch(5, y, 1.1, 0.0, 0, 1) for y in range(-6, 6)]
    result = found(patches)
    lowest = result.storeys[0]
    assert states(result, lowest, *((0, y) for y in range(-6, 6))) == {OCCUPIED}
    assert states(result, lowest, *((-5, y) for y in range(-6, 6))) == {OCCUPIED}
    assert states(result, lowest, *((5, y) for y in range(-6, 6))) == {FREE}


def test_a_slope_is_free_up_to_the_robot_s_and_a_lone_step_up_to_its_step() -> None:
    def ramp(rise: float) -> list[Patch]:
        return [
            Patch(x, y, rise * SIZE * max(0, x), 0.0, 0, 3) for x in range(-9, 9) for y in range(5)
        ]

    for degrees, expected in ((18, FREE), (22, OCCUPIED)):
        result = found(ramp(np.tan(np.radians(degrees))), replace(ROBOT, step=0.3))
        assert states(result, result.storeys[-1], *((x, 2) for x in range(3, 6))) == {expected}
    for height, free in ((0.15, True), (0.25, False)):
        kerb = scene((range(-9, 0), range(5), 0.0), (range(9), range(5), height))
        result = found(kerb)
        whole = len(result.storeys) == 1 and bool((result.storeys[0].space == FREE).all())
        assert whole is free


def test_a_bridge_and_the_ground_beneath_it_are_two_storeys_each_with_the_ramps() -> None:
    deck = [Patch(x, y, 2.0, 0.0, 0, 3) for x in range(-6, 7) for y in range(-2, 3)]
    ramps = [
        Patch(s * (7 + k), y, 2.0 - 0.17 * (k + 1), 0.0, 0, 3)
        for k in range(11) for y in range(-2, 3) for s in (-1, 1)
    ]  # fmt: skip
    under = {p.cell for p in ramps}
    ground = [p for p in scene((range(-30, 31), range(-9, 10), 0.0)) if p.cell not in under]
    result = found(ground + deck + ramps)
    low, high = result.storeys
    beneath = [(0, y) for y in range(-8, 9)]
    assert states(result, low, *beneath) == {FREE}
    assert np.nanmax(low.floor[:, 30]) == 0.0
    across = [(x, 0) for x in range(-30, 31)]
    assert states(result, high, *across) == {FREE}
    floor = high.floor[0 - result.extent.min_y]
    assert (floor[30], floor[0]) == (2.0, 0.0)
    # One can drive around to the ground beside the deck, but not off its side.
    assert states(result, high, (0, 2), (0, -2)) == {OCCUPIED}
    assert states(result, high, (0, 3), (0, -3)) == {FREE}


def test_terraces_joined_by_a_ramp_stay_apart_where_there_is_none() -> None:
    upper = [(x, y) for x in range(8) for y in range(20)]
    patches = scene((range(-8, 0), range(20), 0.0))
    patches += [Patch(x, y, min(0.9, 0.1 * y), 0.0, 0, 3) for x, y in upper]
    result = found(patches)
    (storey,) = result.storeys
    assert states(result, storey, (-1, 0), (0, 0), (-1, 1), (0, 1)) == {FREE}
    assert states(result, storey, *((0, y) for y in range(4, 20))) == {OCCUPIED}
    assert states(result, storey, *((-1, y) for y in range(4, 20))) == {FREE}
    assert states(result, storey, *((1, y) for y in range(20))) == {FREE}


def test_artificial_patches_are_neither_floor_nor_obstacle() -> None:
    patches = [p for p in scene(GROUND) if p.cell not in {(0, 0), (2, 0), (4, 0)}]
    patches += [
        Patch(0, 0, 0.0, 0.0, 2, 0),
        Patch(2, 0, 2.0, 2.0, 2, 0),
        Patch(4, 0, 0.0, 0.0, 1, 0),
    ]
    patches += [Patch(-3, 0, 0.9, 0.0, 2, 0), Patch(-5, 0, 5.0, 0.0, 2, 0)]
    result = found(patches)
    lowest = result.storeys[0]
    assert states(result, lowest, (0, 0), (2, 0), (-3, 0)) == {UNKNOWN}
    assert states(result, lowest, (4, 0), (-5, 0)) == {FREE}


def test_a_drop_is_occupied_and_what_lies_above_alone_is_unknown() -> None:
    pit = {(x, y) for x in range(-2, 3) for y in range(-2, 3)}
    patches = [p for p in scene(GROUND) if p.cell not in pit and p.cell != (7, 0)]
    patches += [Patch(x, y, -2.0, 0.0, 0, 3) for x, y in pit] + [Patch(7, 0, 3.0, 0.0, 0, 1)]
    result = found(patches)
    ground = result.storeys[-1]
    assert states(result, ground, *pit) == {OCCUPIED}
    assert state(result, ground, 7, 0) == UNKNOWN
    # What lies deeper, and is small, is no storey of its own.
    assert (len(result.storeys), result.left_out) == (1, len(pit) + 1)


def test_floors_beyond_a_narrow_gap_are_one_storey_and_small_ones_are_counted() -> None:
    patches = scene((range(10), range(10), 0.0), (range(14, 24), range(10), 0.2))
    patches += scene((range(40, 42), range(2), 7.0))
    result = found(patches)
    (storey,) = result.storeys
    assert states(result, storey, (5, 5), (20, 5)) == {FREE}
    assert states(result, storey, (11, 5)) == {UNKNOWN}
    assert result.left_out == 4


def test_rooms_at_one_height_are_one_storey_whatever_lies_between_them() -> None:
    rooms = scene((range(10), range(10), 0.0), (range(24, 34), range(10), 0.1))
    closet = scene((range(50, 52), range(2), 0.0))
    result = found(rooms + closet)
    (storey,) = result.storeys
    assert states(result, storey, (5, 5), (30, 5), (51, 1)) == {FREE}
    assert state(result, storey, 17, 5) == UNKNOWN
    assert result.left_out == 0
    # Lower than the robot is high they are of one storey; a gallery is one of its own.
    for height, count in ((0.7, 1), (1.7, 2)):
        other = scene((range(10), range(10), 0.0), (range(24, 34), range(10), height))
        assert len(found(other).storeys) == count
    # A table under which nobody saw is no floor of the room.
    table = scene((range(12, 14), range(2), 0.8))
    result = found(rooms + table)
    assert (state(result, result.storeys[0], 12, 1), result.left_out) == (OCCUPIED, 4)


def test_a_ragged_room_is_one_storey() -> None:
    # As a sparse map is: the floor in pieces, less than a robot's height apart, and furniture.
    rng = np.random.default_rng(4)
    pieces = [
        (range(x, x + 5), range(y, y + 4), float(rng.uniform(-0.4, 0.4)))
        for x in range(-18, 18, 6) for y in range(-15, 15, 5)
    ]  # fmt: skip
    shelves = [(range(x, x + 5), range(-17, -15), 1.3 + 0.4 * (x % 3)) for x in range(-18, 18, 6)]
    tables = [(range(x, x + 3), range(3), 1.2) for x in (-12, 0)]
    result = found(scene(*pieces, *shelves, *tables))
    (storey,) = result.storeys
    assert np.count_nonzero(storey.space == FREE) > 0.7 * 20 * len(pieces)
    assert np.nanmax(storey.floor) < 0.5
    assert result.left_out >= 2 * 9


def test_floors_above_each_other_are_storeys_also_if_they_are_small_beside_the_largest() -> None:
    yard = (range(-30, 30), range(-20, 20), 0.0)
    upper = [(range(12), range(12), 3.0), (range(12), range(12), 6.0)]
    assert len(found(scene(yard, *upper)).storeys) == 3
    # A roof under which nobody saw, and a hut's ceiling, are none.
    roof = (range(40, 50), range(10), 4.5)
    hut = (range(20, 23), range(3), 4.5)
    result = found(scene(yard, *upper, roof, hut))
    assert (len(result.storeys), result.left_out) == (3, 100 + 9)


@pytest.mark.parametrize(
    ("name", "up", "storeys"),
    [
        ("sparse/tello_saloon.csv", "-y", 1),
        ("sparse/euroc_orb3_pointcloud.txt", "auto", 1),
        ("multilevel/als_underpass_samp22.pcd", "z", 2),
        ("multilevel/building_floors_cgal.ply", "z", 3),
    ],
)
def test_real_places_have_as_many_storeys_as_one_would_count(
    shared_data: Path, name: str, up: str, storeys: int
) -> None:
    surface = build_map(open_recording(shared_data / name, up=up))
    assert len(storeys_of(surface).storeys) == storeys


def test_patches_that_hang_together_nowhere_are_no_storeys() -> None:
    # One of each would be as many images as there are patches.
    loose = [Patch(8 * (n % 40), 8 * (n // 40), 3.0 * (n % 97), 0.0, 0, 1) for n in range(900)]
    result = found(loose)
    assert (result.storeys, result.left_out) == ([], 900)


def test_every_cell_of_random_maps_follows_the_rules() -> None:
    rng = np.random.default_rng(5)
    free = 0
    for _ in range(150):
        surface = random_map(rng)
        if not surface.size:
            continue
        robot = Robot(slope=30, step=0.3, headroom=float(rng.choice((0.5, 1.0))))
        result = storeys_of(surface, robot)
        for storey in result.storeys:
            free += check(surface, result, storey)
    assert free > 500


def check(surface: SurfaceMap, result: Storeys, storey: Storey) -> int:
    """Hold each cell of a storey to the rules; return how many are free."""
    headroom, free = result.limits.headroom, 0
    for row, column in np.ndindex(storey.space.shape):
        cell = column + result.extent.min_x, row + result.extent.min_y
        here = np.flatnonzero((surface.ix == cell[0]) & (surface.iy == cell[1]))
        certain = here[surface.origin[here] != 2]
        if storey.space[row, column] == UNKNOWN:
            continue
        assert len(certain)
        if storey.space[row, column] == OCCUPIED:
            continue
        free += 1
        floor = storey.floor[row, column]
        assert floor in surface.height[certain]
        above = here[surface.height[here] > floor]
        assert (surface.low_end[above] >= floor + headroom).all()
        for dy, dx in ((0, 1), (1, 0), (1, 1), (1, -1)):
            beside = row + dy, column + dx
            if beside[0] < storey.space.shape[0] and 0 <= beside[1] < storey.space.shape[1]:
                apart = abs(storey.floor[beside] - floor)
                rise = result.limits.rise(surface.cell_size) * (abs(dx) + dy)
                assert storey.space[beside] != FREE or apart <= rise
    return free


def test_the_robot_is_as_high_as_the_map_s_vehicle_and_else_as_its_gap() -> None:
    surface = map_of(scene(GROUND))
    assert Robot().limits(surface).headroom == surface.gap_size
    surface.meta["parameters"] = {"vehicle": {"height": "4 cells"}}
    assert Robot().limits(surface).headroom == 4 * surface.cell_size
    surface.meta["parameters"] = {"vehicle": {"height": 0.7}}
    assert Robot().limits(surface).headroom == 0.7
    surface.meta["parameters"] = {"vehicle": {"height": "tall"}}
    assert Robot().limits(surface).headroom == surface.gap_size


def test_a_robot_that_cannot_be_and_maps_of_nothing_or_too_wide_are_refused() -> None:
    for given, words in (
        ({"slope": 90}, "at most 60"),
        ({"step": "-1"}, "at least 0"),
        ({"headroom": "0"}, "above 0"),
        ({"headroom": "high"}, "a length"),
    ):
        with pytest.raises(UsageError, match=words):
            Robot.of(**given)
    with pytest.raises(UsageError, match="`slope`"):
        Robot(slope=-1)
    with pytest.raises(UsageError, match="empty"):
        storeys_of(map_of([]))
    far = [Patch(0, 0, 0.0, 0.0, 0, 1), Patch(2**20, 2**20, 0.0, 0.0, 0, 1)]
    with pytest.raises(UsageError, match=f"{MOST_CELLS:,}.*`crop`"):
        storeys_of(map_of(far))
