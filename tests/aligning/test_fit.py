"""Maps are aligned where they lie on each other in one way only, and otherwise not.

Ways to pass without being right: to return what was there before, so the second map is turned,
scaled and moved by much; to align all, so places that look alike from two sides, that slide, and
that are not the same must be refused, each with its reason; to be right by the grid alone, so both
maps have points of their own and cells that are no multiples of each other.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from mlscli.aligning.fit import MOST_RIVAL, align_maps
from mlscli.errors import InputError, UsageError
from mlscli.geometry.similarity import Similarity
from mlscli.maps.surface_map import SurfaceMap
from tests.helpers.maps import Patch, map_of
from tests.helpers.yards import CELL, cloud, map_of_points, off

MOVED = Similarity(2.1, 0.6, (-31.0, 12.5, 4.0))


@pytest.fixture(scope="module")
def yard() -> SurfaceMap:
    return map_of_points(cloud())


def test_a_map_of_another_frame_is_found_to_lie_where_it_does(yard: SurfaceMap) -> None:
    points = MOVED.points(cloud(2, (2, 12)))
    found = align_maps(yard, map_of_points(points, 0.27), 1 / MOVED.scale)
    assert off(found.fit, MOVED.inverse, points) < CELL / 2
    assert found.fit.scale == 1 / MOVED.scale
    assert found.rms < 0.05
    assert found.rival <= MOST_RIVAL


def test_the_scale_is_found_too(yard: SurfaceMap) -> None:
    points = MOVED.points(cloud(3))
    found = align_maps(yard, map_of_points(points, 0.25))
    assert found.fit.scale == pytest.approx(1 / MOVED.scale, rel=0.01)
    assert off(found.fit, MOVED.inverse, points) < CELL


@pytest.mark.parametrize(
    ("parts", "why"),
    [
        # A hall: turned by half a turn it is the same.
        ([((0, 0, 0), (12, 9, 0)), ((0, 0, 0), (0, 9, 2.5)), ((12, 0, 0), (12, 9, 2.5))], "alike"),
        # A street without ends slides along itself, as far as its maps overlap.
        ([((0, 0, 0), (30, 5, 0)), ((0, 0, 0), (30, 0, 3)), ((0, 5, 0), (30, 5, 2))], "aside"),
    ],
)
def test_a_place_that_fits_in_more_than_one_way_is_refused(
    parts: list[tuple[tuple[float, ...], ...]], why: str
) -> None:
    one, other = (map_of_points(cloud(seed, (0, 30), parts)) for seed in (4, 5))
    with pytest.raises(InputError, match=f"more than one fit is possible: .*{why}"):
        align_maps(one, other, 1.0)


def test_what_is_another_place_is_refused(yard: SurfaceMap) -> None:
    steps = [((n, 0, n / 2), (n + 1, 9, n / 2)) for n in range(12)]
    with pytest.raises(InputError, match=r"nothing fits|more than one fit"):
        align_maps(yard, map_of_points(cloud(6, (0, 12), steps)), 1.0)


def test_strays_and_endless_walls_neither_mislead_nor_take_memory(yard: SurfaceMap) -> None:
    strays = [Patch(30_000_000, 5, 0.0, 0.0, 0, 1), Patch(5, 5, 9e7, 1.8e8, 0, 2)]
    astray = map_of(strays, yard.gap_size, CELL)
    hostile = replace(yard, thickness=astray.thickness).union(astray)
    found = align_maps(hostile, map_of_points(cloud(7), 0.35), 1.0)
    assert off(found.fit, Similarity(), cloud(7)) < CELL / 2


def test_a_map_of_a_few_patches_is_refused(yard: SurfaceMap) -> None:
    few = map_of_points(np.zeros((5, 3)))
    with pytest.raises(InputError, match="the second map has too few measured patches"):
        align_maps(yard, few)
    with pytest.raises(InputError, match="the first map has too few"):
        align_maps(few, yard)


@pytest.mark.parametrize("scale", [0.0, -1.0, math.inf, math.nan])
def test_a_scale_that_is_none_is_refused(yard: SurfaceMap, scale: float) -> None:
    with pytest.raises(UsageError, match="`scale`"):
        align_maps(yard, yard, scale)
