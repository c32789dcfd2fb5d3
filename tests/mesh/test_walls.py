"""Walls: what is joined, without overlaps and cracks.

Ways to pass without being right: to draw nothing, so areas and what is shown are checked; to draw
twice, so the strip between two cells is cut and the pieces must not overlap.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from mlscli.mesh.triangulation import nodes_of
from mlscli.mesh.walls import wall_triangles
from mlscli.surface_map import SurfaceMap
from mlscli.typing import Array
from tests.maps import random_map
from tests.meshes import Column, a_map


class Walls:
    """The wall triangles of a map, by patches and heights."""

    def __init__(self, surface: SurfaceMap, reach: float = 1.0) -> None:
        nodes = nodes_of(surface)
        triangles, self.shown = wall_triangles(surface, nodes, reach)
        self.patch, self.height = nodes.patch[triangles], nodes.height[triangles]
        self.cell = np.stack((surface.ix, surface.iy), axis=1)[self.patch].astype(np.int64)

    @property
    def count(self) -> int:
        return len(self.patch)

    @property
    def areas(self) -> Array:
        """The area of each triangle, which has two corners in one cell and one in another."""
        across = np.linalg.norm(self.cell[:, 0] - self.cell[:, 2], axis=1)
        areas: Array = across * (self.height[:, 1] - self.height[:, 0]) / 2
        return areas


def distance(surface: SurfaceMap, one: int, other: int) -> float:
    low, high = surface.low_end, surface.height
    return float(max(low[one], low[other]) - min(high[one], high[other]))


def test_two_neighbouring_patches_make_a_quad() -> None:
    walls = Walls(a_map((0, 0, 3, 3), (1, 0, 2.5, 2)))
    assert walls.count == 2
    assert walls.areas.sum() == pytest.approx((3 + 2) / 2)
    assert walls.shown.all()


@pytest.mark.parametrize("low", [2.0, 3.0, 4.0])
def test_patches_are_joined_up_to_the_reach(low: float) -> None:
    surface = a_map((0, 0, 2, 2), (0, 1, low + 1, 1))
    assert Walls(surface, reach=1.0).count == (2 if low <= 3 else 0)


def test_a_wall_in_pieces_beside_a_whole_one_has_no_crack() -> None:
    pieces: list[Column] = [(1, 0, 1, 1), (1, 0, 2, 1), (1, 0, 3, 1)]
    walls = Walls(a_map((0, 0, 3, 3), *pieces, (2, 0, 3, 3)))
    assert walls.areas.sum() == pytest.approx(6)
    assert walls.shown.all()


def test_equal_pieces_are_joined_each_with_its_own_kind() -> None:
    pieces: list[Column] = [(x, 0, z, 1) for x in range(2) for z in (1, 2, 3)]
    walls = Walls(a_map(*pieces))
    assert walls.count == 6
    assert {tuple(sorted(set(patches.tolist()))) for patches in walls.patch} == {
        (0, 3),
        (1, 4),
        (2, 5),
    }


def test_a_window_stays_open() -> None:
    walls = Walls(a_map((0, 0, 3, 3), (1, 0, 1, 1), (1, 0, 3, 1)))
    assert walls.areas.sum() == pytest.approx(3 - 1 / 2)
    assert walls.shown.all()


def test_a_wall_far_below_does_not_hide_one_that_is_near() -> None:
    walls = Walls(a_map((0, 0, 1, 1), (1, 0, -4, 1), (1, 0, 2.1, 1)), reach=1.5)
    assert walls.shown.tolist() == [True, False, True]
    assert walls.count == 2


def test_a_wall_follows_a_corner_without_cutting_it_off() -> None:
    corner = a_map((0, 0, 3, 3), (1, 0, 3, 3), (1, 1, 3, 3))
    assert Walls(corner).count == 4


@pytest.mark.parametrize("other", [(1, 1), (1, -1)])
def test_a_diagonal_wall_is_joined_across_corners(other: tuple[int, int]) -> None:
    walls = Walls(a_map((0, 0, 3, 3), (*other, 3, 3)))
    assert walls.count == 2
    assert walls.areas.sum() == pytest.approx(3 * np.sqrt(2))


def test_a_wall_on_another_level_is_no_way_round_a_corner() -> None:
    walls = Walls(a_map((0, 0, 3, 3), (1, 1, 3, 3), (1, 0, 20, 3)))
    assert walls.shown.tolist() == [True, False, True]


def test_a_wall_joined_with_one_side_only_is_no_way_round_a_corner() -> None:
    walls = Walls(a_map((0, 0, 3, 3), (1, 1, 5, 2.5), (1, 0, -0.5, 2.5)))
    assert sorted(map(tuple, np.unique(np.sort(walls.patch, axis=1), axis=0).tolist())) == [
        (0, 0, 1),
        (0, 0, 2),
        (0, 1, 1),
        (0, 2, 2),
    ]


@pytest.mark.parametrize("seed", range(150))
def test_triangles_join_near_patches_and_never_overlap(seed: int) -> None:
    rng = np.random.default_rng(seed)
    surface, reach = random_map(rng), float(rng.choice([0.0, 0.3, 2.0]))
    walls = Walls(surface, reach)
    strips: dict[tuple[tuple[int, ...], ...], list[tuple[float, float]]] = {}
    shown = np.zeros(surface.size, dtype=np.bool_)
    for patch, cell, height in zip(walls.patch, walls.cell, walls.height, strict=True):
        own, same, other = patch.tolist()
        assert own == same
        assert distance(surface, own, other) <= reach
        assert height[0] < height[1]
        shown[own] = True
        here, there = tuple(cell[0].tolist()), tuple(cell[2].tolist())
        middle = sorted((float(height[0] + height[2]), float(height[1] + height[2])))
        strips.setdefault(tuple(sorted((here, there))), []).append((middle[0], middle[1]))
    assert (shown == walls.shown).all()
    for cuts in strips.values():
        cuts.sort()
        for (_, high), (low, _) in pairwise(cuts):
            assert high <= low + 1e-9
