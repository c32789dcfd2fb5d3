"""Where the craft itself was.

How one could cheat: to call all space around the route free, or all between two positions; to take
the vehicle's default, a number of cells, for the size of a craft; to round voxels outwards.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from mlscli.maps.surface_map import SurfaceMap
from mlscli.queries.clearance import BLOCKED, FITS, NEVER_SEEN, clearance
from mlscli.queries.flown import stated_vehicle, with_flown
from tests.helpers.lines import free_space_of
from tests.helpers.maps import CELL, Patch, map_of

HALF = CELL / 2
PLACES = np.array([[0.3, 0.1, 2.1], [math.nan, 0, 0], [4.3, -0.2, 2.4], [1e300, 0, 0]])


def flown(vehicle: Any, *, free: bool = True) -> SurfaceMap:
    """Return a floor over which a craft flew at two known places, seen by nobody else."""
    floor = map_of([Patch(ix, iy, 0.0, 0.0, 0, 9) for ix in range(-4, 12) for iy in range(-4, 4)])
    route = np.full((7, 4), np.nan)
    route[: len(PLACES), 1:] = PLACES
    meta = {"parameters": {"vehicle": vehicle}}
    return replace(floor, route=route, meta=meta, free=free_space_of({}) if free else None)


def voxels(surface: SurfaceMap) -> set[tuple[int, ...]]:
    assert surface.free is not None
    return {tuple(voxel) for voxel in surface.free.voxels.tolist()}


OWN = {(0, 0, 8), (8, -1, 9)}


@pytest.mark.parametrize(
    "vehicle",
    [
        {"width": "1 cell", "height": "3 cells"},
        {"width": 0.8},
        {"width": 0.8, "height": -1},
        {"width": 1e9, "height": 1.0},
        {"width": True, "height": 1.0},
        "0.8 x 0.4",
        None,
    ],
)
def test_without_a_stated_vehicle_only_the_voxels_of_the_places_are_free(vehicle: Any) -> None:
    assert stated_vehicle(flown(vehicle)) is None
    assert voxels(with_flown(flown(vehicle))) == OWN


def test_a_stated_vehicle_frees_what_lies_wholly_within_it() -> None:
    vehicle = {"width": 2.6, "height": 1.2}
    right = set(OWN)
    for ix in range(-8, 16):
        for iy in range(-8, 8):
            for iz in range(20):
                corners = [
                    (x * CELL, y * CELL, z * HALF)
                    for x in (ix, ix + 1) for y in (iy, iy + 1) for z in (iz, iz + 1)
                ]  # fmt: skip
                for place in PLACES[[0, 2]]:
                    off = np.array(corners) - place
                    inside = np.hypot(off[:, 0], off[:, 1]) <= 1.3
                    if (inside & (np.abs(off[:, 2]) <= 0.6)).all():
                        right.add((ix, iy, iz))
    assert len(right) > 20
    assert voxels(with_flown(flown(vehicle))) == right


def test_a_craft_fits_where_it_was_and_nobody_knows_between() -> None:
    surface = flown({"width": 3.0, "height": 2.0})
    for place in PLACES[[0, 2]]:
        assert clearance(surface, place[None], 0.4, 0.4).overall == FITS
    found = clearance(surface, PLACES[[0, 2]], 0.4, 0.4)
    assert [stretch.verdict for stretch in found.stretches] == [FITS, NEVER_SEEN, FITS]
    unstated = flown({"width": "6 cells", "height": "4 cells"})
    assert clearance(unstated, PLACES[:1], 0.4, 0.4).overall == NEVER_SEEN


def test_what_stands_there_now_still_blocks_and_lines_are_added() -> None:
    surface = flown({"width": 3.0, "height": 2.0})
    wall = map_of([Patch(0, 0, 9.0, 9.0, 0, 9)])
    blocked = replace(surface.union(wall), free=surface.free, route=surface.route)
    assert clearance(blocked, PLACES[:1], 1.0, 3.0).overall == BLOCKED
    seen = replace(surface, free=free_space_of({(5, 5, 5): 1, (0, 0, 8): 1}))
    assert voxels(with_flown(seen)) == voxels(with_flown(surface)) | {(5, 5, 5)}


def test_a_map_that_does_not_know_what_was_seen_stays_as_it_is() -> None:
    blind = flown({"width": 3.0, "height": 2.0}, free=False)
    assert with_flown(blind) is blind
    assert clearance(blind, PLACES[:1], 0.4, 0.4).overall == NEVER_SEEN
