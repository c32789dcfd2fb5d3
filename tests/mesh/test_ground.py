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
    assert landed(surface, (-0.5, 0.5, 9.0)) == [[-0.5, 0.5, 1.0]]


@pytest.mark.parametrize("cells", range(SEARCH_CELLS + 2))
def test_the_search_ends_a_few_cells_away(cells: int) -> None:
    surface = a_map((0, 0, 1, 0))
    on_ground, beyond = (0.5, 0.5, 2.0), (cells + 0.5, 0.5, 2.0)
    found = landed(surface, on_ground, beyond)
    assert ([cells + 0.5, 0.5, 1.0] in found) == (cells <= SEARCH_CELLS)


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
    surface = a_map((0, 0, 0.0, 0.0), (20, 0, 0.0, 0.0))
    route = np.array([(0, 0.5, 0.5, 2.0), (1, 20.5, 0.5, 2.0)])
    track = route_on_ground(replace(surface, route=route))
    x = track.vertices[:, 0]
    near = 1 + SEARCH_CELLS
    assert ((x < near) | (x > 20 - SEARCH_CELLS)).all()
    assert len(x) > 2
    lengths = np.abs(x[track.legs[:, 1]] - x[track.legs[:, 0]])
    assert lengths.max() <= 1
    assert len(track.legs) == len(x) - 2


def test_a_leg_of_any_length_takes_bounded_memory() -> None:
    surface = a_map((0, 0, 0.0, 0.0), cell_size=0.01)
    route = np.array([(0, 0.005, 0.005, 2.0), (1, 1e7, 0.005, 2.0)])
    track = route_on_ground(replace(surface, route=route))
    assert track.vertices.tolist() == [[0.005, 0.005, 0.0]]
