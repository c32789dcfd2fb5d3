"""WallTriangles: what is joined, without overlaps and cracks.

Ways to pass without being right: to draw nothing, so areas and what is left bare are checked; to
draw twice, so the strip between two cells is cut and the pieces must not overlap.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from mlscli.maps.surface_map import SurfaceMap
from mlscli.mesh import Mesh, build_mesh
from mlscli.mesh.triangulation import nodes_of
from mlscli.mesh.walls import walls_of
from mlscli.runtime.arrays import Array
from tests.helpers.maps import random_map
from tests.helpers.meshes import Column, a_map, areas, plane, shared_edges_of


class WallTriangles:
    """The wall triangles of a map, by patches and heights."""

    def __init__(self, surface: SurfaceMap, reach: float = 1.0) -> None:
        nodes, triangles, bare = walls_of(surface, nodes_of(surface, reach), reach)
        self.triangles = triangles
        self.patch, self.height = nodes.patch[triangles], nodes.height[triangles]
        self.cell = np.stack((surface.ix, surface.iy), axis=1)[self.patch].astype(np.int64)
        self.bare = nodes.height[bare].tolist()
        self.bare_patches = nodes.patch[bare[:, 0]].tolist()

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
    walls = WallTriangles(a_map((0, 0, 3, 3), (1, 0, 2.5, 2)))
    assert walls.count == 2
    assert walls.areas.sum() == pytest.approx((3 + 2) / 2)
    assert walls.bare == []


def test_ends_up_to_the_reach_apart_are_joined_by_a_slope() -> None:
    walls = WallTriangles(a_map((0, 0, 4, 4), (0, 1, 3, 2)), reach=1.0)
    assert walls.areas.sum() == pytest.approx((4 + 2) / 2)
    assert walls.bare == []


def test_ends_farther_apart_are_a_step_and_what_stands_above_it_is_bare() -> None:
    walls = WallTriangles(a_map((0, 0, 4, 4), (0, 1, 2, 2)), reach=1.0)
    assert walls.areas.sum() == pytest.approx(2)
    assert walls.bare == [[2, 4]]


def test_ends_that_are_one_but_for_rounding_make_no_slivers() -> None:
    # Three pieces, each from where the one below it ends, beside a wall in one piece.
    heights = (0.1 + 0.2, 0.7, 0.1 + 0.7)
    pieces: list[Column] = [
        (0, 0, z, z - low) for z, low in zip(heights, (0, 0.3, 0.7), strict=True)
    ]
    walls = WallTriangles(a_map(*pieces, (1, 0, 0.8, 0.8), *((2, *piece[1:]) for piece in pieces)))
    assert walls.areas.sum() == pytest.approx(2 * 0.8)
    assert walls.areas.min() > 0.01
    assert all(high - low > 0.01 for low, high in walls.bare)


def test_patches_that_do_not_face_each_other_are_not_joined() -> None:
    walls = WallTriangles(a_map((0, 0, 2, 2), (0, 1, 5, 2.5)), reach=1.0)
    assert walls.count == 0
    assert walls.bare == [[0, 2], [2.5, 5]]


def test_a_wall_in_pieces_beside_a_whole_one_has_no_crack() -> None:
    pieces: list[Column] = [(1, 0, 1, 1), (1, 0, 2, 1), (1, 0, 3, 1)]
    walls = WallTriangles(a_map((0, 0, 3, 3), *pieces, (2, 0, 3, 3)))
    assert walls.areas.sum() == pytest.approx(6)
    assert walls.bare == []


def test_equal_pieces_are_joined_each_with_its_own_kind() -> None:
    pieces: list[Column] = [(x, 0, z, 1) for x in range(2) for z in (1, 2, 3)]
    walls = WallTriangles(a_map(*pieces))
    assert walls.count == 6
    assert {tuple(sorted(set(patches.tolist()))) for patches in walls.patch} == {
        (0, 3),
        (1, 4),
        (2, 5),
    }


def test_a_window_is_a_rectangle_from_one_jamb_to_the_other() -> None:
    pieces: list[Column] = [(x, 0, z, 1) for x in (2, 3) for z in (1, 3)]
    whole: list[Column] = [(x, 0, 3, 3) for x in (0, 1, 4, 5)]
    walls = WallTriangles(a_map(*whole, *pieces), reach=0.5)
    assert walls.areas.sum() == pytest.approx(5 * 3 - 3 * 1)
    open_heights = (walls.height > 1) & (walls.height < 2)
    assert not open_heights.any()
    assert walls.bare == []


def test_a_door_has_an_upright_jamb() -> None:
    walls = WallTriangles(a_map((0, 0, 3, 3), (1, 0, 3, 1), (2, 0, 3, 3), (3, 0, 3, 3)), reach=0.5)
    assert walls.areas.sum() == pytest.approx(1 + 1 + 3)
    assert walls.bare == [[0, 2]]


def test_a_floor_that_meets_a_wall_between_its_ends_shares_a_vertex_with_it() -> None:
    floor = [(x, y, 3.0, 0.0) for x, y, _, _ in plane(3, 3)]
    surface = a_map(*floor, *[(3, y, 6.0, 6.0) for y in range(3)])
    walls = WallTriangles(surface)
    on_wall = walls.patch[walls.height == 3.0]
    assert set(surface.iy[on_wall].tolist()) == {0, 1, 2}
    assert walls.areas.sum() == pytest.approx(2 * 6)


def test_a_wall_follows_a_corner_without_cutting_it_off() -> None:
    corner = a_map((0, 0, 3, 3), (1, 0, 3, 3), (1, 1, 3, 3))
    assert WallTriangles(corner).count == 4


@pytest.mark.parametrize("other", [(1, 1), (1, -1)])
def test_a_diagonal_wall_is_joined_across_corners(other: tuple[int, int]) -> None:
    walls = WallTriangles(a_map((0, 0, 3, 3), (*other, 3, 3)))
    assert walls.count == 2
    assert walls.areas.sum() == pytest.approx(3 * np.sqrt(2))


def test_a_wall_on_another_level_is_no_way_round_a_corner() -> None:
    walls = WallTriangles(a_map((0, 0, 3, 3), (1, 1, 3, 3), (1, 0, 20, 3)))
    assert walls.bare_patches == [1]


def test_a_wall_joined_with_one_side_only_is_no_way_round_a_corner() -> None:
    walls = WallTriangles(a_map((0, 0, 3, 3), (1, 1, 5, 4.5), (1, 0, 0.4, 2.5)), reach=0.05)
    # The patches in order: (0, 0), (1, 0), (1, 1).
    joined = {tuple(sorted(set(patches.tolist()))) for patches in walls.patch}
    assert joined == {(0, 1), (0, 2)}


@pytest.mark.parametrize("seed", range(150))
def test_triangles_join_near_patches_and_never_overlap(seed: int) -> None:
    rng = np.random.default_rng(seed)
    surface, reach = random_map(rng), float(rng.choice([0.0, 0.3, 2.0]))
    walls = WallTriangles(surface, reach)
    strips: dict[tuple[tuple[int, ...], ...], list[tuple[float, float]]] = {}
    shown = dict.fromkeys(np.flatnonzero(surface.depth > 0).tolist(), 0.0)
    seen: set[tuple[int, float]] = set()
    for patch, cell, height in zip(walls.patch, walls.cell, walls.height, strict=True):
        own, same, other = patch.tolist()
        assert own == same
        assert distance(surface, own, other) <= reach
        assert height[0] < height[1]
        if (own, height[0]) not in seen:
            shown[own] += float(height[1] - height[0])
        seen.add((own, float(height[0])))
        here, there = tuple(cell[0].tolist()), tuple(cell[2].tolist())
        middle = sorted((float(height[0] + height[2]), float(height[1] + height[2])))
        strips.setdefault(tuple(sorted((here, there))), []).append((middle[0], middle[1]))
    for patch, (low, high) in zip(walls.bare_patches, walls.bare, strict=True):
        shown[patch] += high - low
    depths = {patch: surface.depth[patch] for patch in shown}
    assert shown == pytest.approx(depths)
    for cuts in strips.values():
        cuts.sort()
        for (_, high), (low, _) in pairwise(cuts):
            assert high <= low + 1e-9


def drawn_out(rng: np.random.Generator) -> SurfaceMap:
    """Return a map, half of whose measured patches are moved beyond their points."""
    surface = random_map(rng, fill=0.9)
    drawn = (surface.origin == 0) & (rng.random(surface.size) < 0.5)
    up, down = rng.choice([0.0, 0.1, 0.3], (2, surface.size)) * drawn
    is_wall = surface.depth > 0
    return surface.with_columns(
        height=surface.height + up, depth=np.where(is_wall, surface.depth + up + down, 0.0)
    )


def test_a_wall_is_measured_as_far_as_its_points_and_plastered_beyond() -> None:
    wall = a_map((0, 0, 2, 1), (1, 0, 2, 1))
    drawn = wall.with_columns(height=np.full(2, 2.5), depth=np.full(2, 2.25))
    mesh = build_mesh(drawn)
    own = areas(mesh)
    group = mesh.group(mesh.triangles)
    assert own[group == 0].sum() == pytest.approx(1.0)
    assert own[group == 1].sum() == pytest.approx(1.25)
    lines = build_mesh(drawn, "patches")
    length = np.abs(np.diff(lines.vertices[lines.lines, 2], axis=1))[:, 0]
    assert length[lines.group(lines.lines) == 0].tolist() == [1.0, 1.0]
    assert length[lines.group(lines.lines) == 1].tolist() == [0.5, 0.75] * 2


def test_a_wall_that_stands_alone_is_parted_where_its_points_end() -> None:
    mesh = build_mesh(a_map((0, 0, 2, 1)).with_columns(depth=np.array([1.5])))
    own, group = areas(mesh), mesh.group(mesh.triangles)
    # Two quads that cross, half a cell wide, and a square on top.
    assert own[group == 0].sum() == pytest.approx(2 * 0.5 * 1.0 + 0.25)
    assert own[group == 1].sum() == pytest.approx(2 * 0.5 * 0.5)


def test_marks_change_no_surface_and_nothing_beyond_points_is_measured() -> None:
    rng = np.random.default_rng(6)
    beyond = 0
    for _ in range(60):
        drawn = drawn_out(rng)
        mesh, unmarked = build_mesh(drawn), build_mesh(replace(drawn, moved=drawn.moved * 0))
        assert areas(mesh).sum() == pytest.approx(areas(unmarked).sum())
        measured = mesh.vertices[np.unique(mesh.triangles[mesh.group(mesh.triangles) == 0])]
        patch = mesh.patch[np.unique(mesh.triangles[mesh.group(mesh.triangles) == 0])]
        assert (measured[:, 2] <= drawn.top[patch] + 1e-6).all()
        assert (measured[:, 2] >= drawn.bottom[patch] - 1e-6).all()
        beyond += int((mesh.group(mesh.triangles) == 1).sum())
        # No crack is torn.
        assert open_length(mesh) == pytest.approx(open_length(unmarked))
    assert beyond > 100


def open_length(mesh: Mesh) -> float:
    """Return the length of all edges that an odd number of triangles use, seen by their places."""
    places, number = np.unique(mesh.vertices, axis=0, return_inverse=True)
    welded = replace(mesh, triangles=number.reshape(-1)[mesh.triangles].astype(np.int32))
    edges = [edge for edge, uses in shared_edges_of(welded).items() if len(uses) % 2]
    ends = places[np.array(edges, dtype=np.int64).reshape(-1, 2)]
    return float(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).sum())
