"""The column of a place: its free intervals are those of its voxels, one by one.

Ways to pass without being right: only one free voxel, so there are runs and gaps; no patch within
what lines passed through, so one cuts a run; columns beside it, which must not count.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mlscli.maps.free_space import FreeSpace
from mlscli.maps.space import FREE, space_at
from mlscli.maps.surface_map import SurfaceMap
from mlscli.queries.column import column_at
from tests.helpers.maps import CELL, Patch, map_of

HALF = CELL / 2


def seen(surface: SurfaceMap, columns: dict[tuple[int, int], dict[int, int]]) -> SurfaceMap:
    """Return a map with free space: the lines through each voxel of each column."""
    cells = sorted(columns)
    voxels = [sorted(columns[cell].items()) for cell in cells]
    return replace(
        surface,
        free=FreeSpace(
            np.array([ix for ix, _ in cells], dtype=np.int32),
            np.array([iy for _, iy in cells], dtype=np.int32),
            np.cumsum([0, *map(len, voxels)]),
            np.array([iz for column in voxels for iz, _ in column], dtype=np.int32),
            np.array([lines for column in voxels for _, lines in column], dtype=np.uint8),
        ),
    )


@pytest.mark.parametrize("least", [1, 2, 3])
def test_free_intervals_are_the_free_voxels_of_the_column(least: int) -> None:
    rng = np.random.default_rng(least)
    for _ in range(30):
        heights = rng.uniform(-3, 3, 4)
        surface = map_of([Patch(x, 1, z, 0.2, 0, 1) for x in (0, -1) for z in heights.tolist()])
        columns = {
            (x, 1): {int(iz): int(rng.integers(1, 4)) for iz in rng.integers(-15, 15, 12)}
            for x in (-1, 0)
        }
        surface = seen(surface, columns)
        column = column_at(surface, 0.7 * CELL, 1.2 * CELL, least)
        assert (column.ix, column.iy) == (0, 1)
        assert surface.height[column.patch].tolist() == sorted(heights.tolist())
        assert column.free is not None
        for iz in range(-20, 20):
            middle = (iz + 0.5) * HALF
            place = np.array([[0.7 * CELL, 1.2 * CELL, middle]])
            within = [low < middle < high for low, high in column.free.tolist()]
            assert sum(within) == (space_at(surface, place, least)[0] == FREE)
        assert (np.diff(column.free, axis=1) > 0).all()
        assert (column.free[1:, 0] > column.free[:-1, 1]).all()


def test_where_no_line_passed_nothing_is_free() -> None:
    surface = seen(map_of([Patch(0, 0, 0.0, 0.0, 0, 1)]), {(3, 3): {1: 9}})
    column = column_at(surface, 0.1, 0.1)
    assert column.free is not None
    assert column.free.shape == (0, 2)


def test_a_map_that_does_not_say_what_was_seen_through_says_so() -> None:
    assert column_at(map_of([Patch(0, 0, 0.0, 0.0, 0, 1)]), 0.1, 0.1).free is None
