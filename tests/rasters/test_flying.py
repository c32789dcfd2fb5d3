"""What a craft meets at a flying height.

How one could cheat: to call free what no line passed through, or what lines passed through in part.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mlscli.errors import UsageError
from mlscli.maps.free_space import FreeSpace
from mlscli.maps.space import FREE, OCCUPIED, UNKNOWN, space_at
from mlscli.maps.surface_map import SurfaceMap
from mlscli.rasters.flying import at_height
from mlscli.rasters.robot import Robot
from tests.helpers.maps import Patch, map_of, random_map

CELL = 0.5


def with_random_free(surface: SurfaceMap, rng: np.random.Generator) -> SurfaceMap:
    """Return a map with voxels seen through, most of them by two lines, in and around it."""
    voxels = {
        (int(x), int(y), int(z))
        for x, y in {(*cell,) for cell in rng.integers(-9, 9, (60, 2)).tolist()}
        for z in range(-8, 14)
        if rng.random() < 0.9
    }
    listed = np.array(sorted(voxels), dtype=np.int32)
    first = np.flatnonzero(np.any(np.diff(listed[:, :2], axis=0, prepend=-99), axis=1))
    start = np.append(first, len(listed)).astype(np.int64)
    lines = rng.choice([1, 2, 9], len(listed), p=(0.05, 0.5, 0.45)).astype(np.uint8)
    ix, iy, iz = (np.ascontiguousarray(column) for column in listed.T)
    free = FreeSpace(ix[first], iy[first], start, iz, lines)
    free.check()
    return replace(surface, free=free)


def test_each_cell_is_what_all_voxels_of_the_craft_are() -> None:
    rng = np.random.default_rng(2)
    seen = set()
    for _ in range(25):
        surface = with_random_free(random_map(rng, fill=0.3), rng)
        assert surface.free is not None
        certain = surface.take(surface.origin != 2)
        z, size = rng.uniform(-1, 2), float(rng.choice([0.2, 0.5, 1.1]))
        flight = at_height(surface, z, Robot(headroom=size))
        steps = np.arange(np.floor(flight.low / CELL * 2), np.ceil(flight.high / CELL * 2))
        for row, column in np.ndindex(flight.space.shape):
            x, y = column + flight.extent.min_x + 0.5, row + flight.extent.min_y + 0.5
            places = np.array([(x * CELL, y * CELL, (step + 0.5) * CELL / 2) for step in steps])
            states = space_at(surface, places)
            expected = FREE if (states == FREE).all() else UNKNOWN
            if (space_at(certain, places) == OCCUPIED).any():
                expected = OCCUPIED
            assert flight.space[row, column] == expected
            seen.add(expected)
    assert seen == {FREE, OCCUPIED, UNKNOWN}


def test_without_free_space_nothing_is_free() -> None:
    surface = map_of([Patch(0, 0, 2.0, 2.0, 0, 5), Patch(3, 0, 0.0, 0.0, 0, 5)])
    assert at_height(surface, 1.0).space.tolist() == [[OCCUPIED, UNKNOWN, UNKNOWN, UNKNOWN]]
    assert at_height(surface, 9.0).space.tolist() == [[UNKNOWN] * 4]


def test_a_height_that_is_none_is_refused() -> None:
    with pytest.raises(UsageError, match="`flying_height`"):
        at_height(map_of([Patch(0, 0, 0.0, 0.0, 0, 1)]), float("nan"))
