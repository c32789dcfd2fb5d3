"""Grids, and maps that are made on them."""

from __future__ import annotations

import numpy as np
import pytest

from mlscli.errors import UsageError
from mlscli.maps.grid import Grid
from mlscli.maps.merging import merge_maps
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


def test_lengths_that_differ_by_a_rounding_are_the_same_length() -> None:
    grid = Grid(0.15, 3 * 0.15, 0.15)
    written = Grid(0.15, 0.45, 0.15)
    assert grid.gap_size != written.gap_size
    assert grid.differing(written) == written.differing(grid) == []
    far = Grid(0.15, 0.45 + 1e-6 * 0.15, 0.15 - 1e-6 * 0.15)
    assert grid.differing(far) == far.differing(grid) == ["gap_size", "thickness"]


def test_maps_whose_lengths_differ_by_a_rounding_are_merged() -> None:
    one, other = (map_of([Patch(0, 0, 0.0, 0.0, 0, 1)], gap, 0.15) for gap in (3 * 0.15, 0.45))
    assert merge_maps(one, other).count.tolist() == merge_maps(other, one).count.tolist() == [2]
