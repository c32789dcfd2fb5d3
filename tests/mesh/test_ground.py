"""The route on the ground.

Ways to pass without being right: routes that fly over one level only; ends of legs on the ground
and the way between through a hill.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mlscli.maps.grid import Grid
from mlscli.maps.surface_map import SurfaceMap
from mlscli.mesh.ground import SEARCH_CELLS, route_on_ground
from tests.helpers.meshes import a_map, plane

LEVELS = a_map(*plane(4, 4), *plane(4, 4, height=3.0), *plane(4, 4, height=6.0), cell_size=0.5)


def landed(surface: SurfaceMap, *positions: tuple[float, float, float]) -> list[list[float]]:
    route = np.array([(t, *position) for t, position in enumerate(positions)]).reshape(-1, 4)
    found: list[list[float]] = route_on_ground(replace(surface, route=route)).vertices.tolist()
    return found


@pytest.mark.parametrize(("z", "ground"), [(2.9, 0.0), (3.0, 3.0), (5.9, 3.0), (99.0, 6.0)])
def test_a_craft_is_above_the_highest_patch_at_or_below_it(z: float, ground: float) -> None:
    assert landed(LEVELS, (0.3, 1.1, z)) == [[0.3, 1.1, ground]]


def test_where_nothing_is_beneath_the_ground_is_sought_around() -> None:
    surface = a_map((0, 0, 1, 0), (2, 0, 5, 0))
    assert landed(surface, (1.5, 0.5, 4.0)) == [[1.5, 0.5, 1.0]]
    assert landed(surface, (1.5, 0.5, 6.0)) == [[1.5, 0.5, 5.0]]


def test_the_nearest_ring_of_cells_decides() -> None:
    surface = a_map((0, 0, 1, 0), (2, 0, 5, 0))
    near = a_map((-2, 0, 5, 0), (1, 0, 1, 0), (3, 0, 7, 0))
    assert landed(near, (0.5, 0.5, 9.0)) == [[0.5, 0.5, 1.0]]
    assert landed(surface, (1.5, 0.5, 9.0)) == [[1.5, 0.5, 5.0]]


@pytest.mark.parametrize("cells", range(SEARCH_CELLS + 2))
def test_the_search_ends_a_few_cells_away(cells: int) -> None:
    surface = a_map((0, 0, 1, 0), (2 * cells, 0, 1, 0))
    on_ground, between = (0.5, 0.5, 2.0), (cells + 0.5, 0.5, 2.0)
    found = landed(surface, on_ground, between)
    assert ([cells + 0.5, 0.5, 1.0] in found) == (cells <= SEARCH_CELLS)


@pytest.mark.parametrize("direction", [(1, 0), (0, -1), (1, 1), (-1, 1)])
def test_the_route_ends_where_the_map_ends_and_goes_on_over_holes(
    direction: tuple[int, int],
) -> None:
    hole = [(x, y) for x in range(3, 6) for y in range(3, 6)]
    surface = a_map(*[(x, y, 1, 0) for x in range(9) for y in range(9) if (x, y) not in hole])
    x, y = direction
    positions = [(4.5 + step * x, 4.5 + step * y, 2.0) for step in range(-9, 10)]
    for place in landed(surface, *positions):
        assert min(place[:2]) >= 0
        assert max(place[:2]) <= 9
    assert [4.5, 4.5, 1.0] in landed(surface, *positions)


def test_positions_unknown_beyond_the_grid_below_all_or_repeated_are_left_out() -> None:
    position, nan = (0.3, 0.3, 2.0), np.nan
    route = [(nan, nan, nan), (0.3, 0.3, nan), (1e300, 0, 1), (0.3, 0.3, -1), position, position]
    assert landed(LEVELS, *route) == [[0.3, 0.3, 0.0]]


def test_a_route_without_any_ground_beneath_it_is_given_as_it_was_flown() -> None:
    flown = [[50.5, 0.5, 2.0], [50.9, 0.5, 3.0]]
    assert landed(a_map((0, 0, 1, 0)), *[(x, y, z) for x, y, z in flown]) == flown


def test_a_map_without_route_or_patches_has_no_route_on_the_ground() -> None:
    assert landed(LEVELS) == []
    assert landed(SurfaceMap.of(Grid(0.5, 1, 0.2)), (0, 0, 1)) == []


def test_a_leg_goes_over_what_lies_between_its_ends_and_not_through_it() -> None:
    surface = a_map(*plane(9, 1), *[(x, 0, 5.0, 5.0) for x in (4, 5)])
    surface = surface.take(~np.isin(surface.ix, (4, 5)) | (surface.height > 0))
    route = np.array([(0, 0.5, 0.5, 9.0), (1, 8.5, 0.5, 9.0)])
    track = route_on_ground(replace(surface, route=route))
    x, z = track.vertices[:, 0], track.vertices[:, 2]
    assert (z == np.where((x > 4) & (x < 6), 5.0, 0.0)).all()
    assert set(np.floor(x)) == set(range(9))
    assert track.legs.tolist() == [[i, i + 1] for i in range(len(x) - 1)]


def test_a_leg_under_a_bridge_stays_on_the_ground_beneath_it() -> None:
    surface = a_map(*plane(9, 1), *[(x, 0, 5.0, 0.0) for x in (3, 4, 5)])
    route = np.array([(0, 0.5, 0.5, 2.0), (1, 8.5, 0.5, 2.0)])
    assert (route_on_ground(replace(surface, route=route)).vertices[:, 2] == 0).all()


def test_where_no_ground_is_known_the_track_is_interrupted() -> None:
    surface = a_map(*[(x, 0, 0.0, 0.0) for x in (0, 1, 20, 21)])
    route = np.array([(0, 0.5, 0.5, 2.0), (1, 21.5, 0.5, 2.0)])
    track = route_on_ground(replace(surface, route=route))
    x = track.vertices[:, 0]
    assert set(np.floor(x)) == {0, 1, 20, 21}
    assert set(np.floor(x[track.legs]).ravel()) == {0, 1, 20, 21}
    assert np.abs(np.diff(x[track.legs])).max() <= 1
    assert len(track.legs) == len(x) - 2


def test_a_leg_of_any_length_takes_bounded_memory() -> None:
    surface = a_map((0, 0, 0.0, 0.0), cell_size=0.01)
    route = np.array([(0, 0.005, 0.005, 2.0), (1, 1e7, 0.005, 2.0)])
    track = route_on_ground(replace(surface, route=route))
    assert track.vertices.tolist() == [[0.005, 0.005, 0.0]]
