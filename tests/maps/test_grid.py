"""Grids, and maps that are made on them."""

from __future__ import annotations

import numpy as np
import pytest

from mlscli.errors import UsageError
from mlscli.maps.grid import Grid
from mlscli.maps.surface_map import SurfaceMap
from tests.helpers.maps import Patch, map_of

GRID = Grid(0.5, 0.75, 0.25, "odom")


def test_a_map_on_a_grid_is_empty_until_it_is_given_patches() -> None:
    surface = SurfaceMap.of(GRID)
    surface.check()
    assert surface.size == 0
    assert surface.grid == GRID


def test_a_map_is_the_one_of_its_grid_and_columns() -> None:
    surface = map_of([Patch(0, 0, 0.0, 0.0, 0, 1), Patch(1, 0, 2.0, 1.0, 1, 0)])
    again = SurfaceMap.of(surface.grid, surface.columns, surface.route, surface.meta)
    assert again == surface
    np.testing.assert_array_equal(again.route, surface.route)


def test_grids_differ_by_lengths_whatever_their_frames_are_called() -> None:
    GRID.require_same(Grid(0.5, 0.75, 0.25, "map"))
    for name, other in (
        ("cell_size", Grid(0.25, 0.75, 0.25)),
        ("gap_size", Grid(0.5, 1.0, 0.25)),
        ("thickness", Grid(0.5, 0.75, 0.5)),
    ):
        with pytest.raises(UsageError, match=f"^maps of different {name} do not go together: "):
            GRID.require_same(other)
