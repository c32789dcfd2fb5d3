"""Meshes of maps: everything is drawn, where it is, once.

Ways to pass without being right: to draw every patch alone, so known maps have known counts; to
draw a vertical patch by its ends only, so an edge from foot to top is looked for; to colour what
is next to it, so colours are looked up by position.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from mlscli import mesh as mesh_module
from mlscli.errors import InputError, UsageError
from mlscli.maps.grid import Grid
from mlscli.maps.surface_map import ARTIFICIAL, MEASURED, SurfaceMap
from mlscli.mesh import GROUPS, ROUTE, ROUTE_LIFT, STYLES, Mesh, Style, build_mesh
from mlscli.mesh.colours import ARTIFICIAL_RED, ROUTE_GREEN
from mlscli.runtime.arrays import Float64
from tests.helpers.maps import Patch, map_of, patches_of, random_map, symmetries, turned_map
from tests.helpers.meshes import a_map, areas, house, plane


def edges_in_cells(mesh: Mesh, cell_size: float) -> dict[tuple[int, int], set[tuple[float, float]]]:
    """Return the heights that the edges of triangles run between, within each cell."""
    found: dict[tuple[int, int], set[tuple[float, float]]] = {}
    for corners in mesh.vertices[mesh.triangles]:
        cells = [tuple(cell) for cell in np.floor(corners[:, :2] / cell_size).astype(int).tolist()]
        for i in range(3):
            for j in range(3):
                if cells[i] == cells[j]:
                    low, high = sorted((float(corners[i, 2]), float(corners[j, 2])))
                    found.setdefault(cells[i], set()).add((low, high))
    return found


@pytest.mark.parametrize("seed", range(100))
def test_every_patch_is_drawn_over_all_its_height(seed: int) -> None:
    rng = np.random.default_rng(seed)
    surface = random_map(rng)
    drawn = edges_in_cells(build_mesh(surface, max_slope=float(rng.uniform(0, 3))), 0.5)
    for patch in patches_of(surface):
        end = patch.low
        for low, high in sorted(drawn[patch.cell]):
            end = high if low == end else end
        assert end == patch.height
        assert (end, end) in drawn[patch.cell] or patch.depth > 0


@pytest.mark.parametrize("seed", range(100))
def test_no_triangle_is_degenerate_or_drawn_twice(seed: int) -> None:
    mesh = build_mesh(random_map(np.random.default_rng(seed)))
    assert (areas(mesh) > 0).all()
    corners = mesh.vertices[mesh.triangles]
    places = {tuple(sorted(map(tuple, triangle))) for triangle in corners.tolist()}
    assert len(places) == len(mesh.triangles)


@pytest.mark.parametrize("seed", range(60))
def test_no_triangle_is_folded_onto_its_neighbour(seed: int) -> None:
    mesh = build_mesh(random_map(np.random.default_rng(seed)))
    across = defaultdict[tuple[int, int], list[Float64]](list)
    for a, b, c in mesh.triangles.tolist():
        for begin, end, apex in ((a, b, c), (b, c, a), (c, a, b)):
            edge = mesh.vertices[max(begin, end)] - mesh.vertices[min(begin, end)]
            away = mesh.vertices[apex] - mesh.vertices[min(begin, end)]
            away = away - edge * (away @ edge) / (edge @ edge)
            key = min(begin, end), max(begin, end)
            across[key].append(away / np.linalg.norm(away))
    for ways in across.values():
        for i, way in enumerate(ways):
            assert all(way @ other < 1 - 1e-9 for other in ways[:i])


@pytest.mark.parametrize("style", STYLES)
def test_every_vertex_lies_in_the_patch_that_it_names(style: Style) -> None:
    surface = house()
    mesh = build_mesh(surface, style)
    assert ((mesh.patch < 0) == (mesh.origin == ROUTE)).all()
    drawn = mesh.patch >= 0
    patch, place = mesh.patch[drawn], mesh.vertices[drawn]
    cell = np.floor(place[:, :2] / surface.cell_size).astype(int)
    assert cell.tolist() == np.column_stack((surface.ix, surface.iy))[patch].tolist()
    assert (place[:, 2] <= surface.height[patch]).all()
    assert (place[:, 2] >= surface.low_end[patch]).all()
    assert set(patch.tolist()) == set(range(surface.size))


@pytest.mark.parametrize("seed", range(60))
def test_a_turned_or_mirrored_map_has_as_many_triangles(seed: int) -> None:
    surface = random_map(np.random.default_rng(seed))
    counts = {len(build_mesh(turned_map(surface, turn)).triangles) for turn in symmetries()}
    assert len(counts) == 1


def test_surfaces_look_up() -> None:
    mesh = build_mesh(random_map(np.random.default_rng(3), fill=1.0))
    a, b, c = np.moveaxis(mesh.vertices[mesh.triangles], 1, 0)
    up = np.cross(b - a, c - a)[:, 2]
    upright = np.abs(up) < 1e-12
    assert (up[~upright] > 0).all()
    assert 0 < upright.sum() < len(up)


def test_a_plane_shares_its_vertices_at_cell_centres() -> None:
    mesh = build_mesh(a_map(*plane(3, 2, height=7.0), cell_size=0.5))
    assert mesh.vertices.tolist() == [[x, y, 7.0] for x in (0.25, 0.75, 1.25) for y in (0.25, 0.75)]
    assert areas(mesh).sum() == pytest.approx(1.0 * 0.5)


def test_a_lone_horizontal_patch_is_a_square_half_a_cell_wide() -> None:
    mesh = build_mesh(a_map((-3, 5, 2.0, 0.0), cell_size=4.0))
    assert (len(mesh.vertices), len(mesh.triangles)) == (4, 2)
    assert areas(mesh).sum() == pytest.approx(2.0**2)
    assert mesh.vertices.mean(axis=0).tolist() == [-10.0, 22.0, 2.0]


def test_a_lone_vertical_patch_is_two_crossing_quads_with_a_square_on_top() -> None:
    mesh = build_mesh(a_map((0, 0, 5.0, 3.0), cell_size=2.0))
    assert (len(mesh.vertices), len(mesh.triangles)) == (12, 6)
    assert areas(mesh).sum() == pytest.approx(2 * (1.0 * 3.0) + 1.0**2)


def test_a_wall_needs_no_square_on_top() -> None:
    assert len(build_mesh(a_map((0, 0, 3, 3), (1, 0, 3, 3), (2, 0, 3, 3))).triangles) == 4


def test_a_pole_on_a_floor_stands_on_it_and_shows_its_height() -> None:
    floor = [column for column in plane(3, 3) if column[:2] != (1, 1)]
    mesh = build_mesh(a_map(*floor, (1, 1, 3.0, 3.0)))
    assert areas(mesh).sum() == pytest.approx(2 * 2 + 2 * (0.5 * 3) + 0.5**2)


def test_a_depth_lost_in_rounding_is_drawn_as_a_horizontal_patch() -> None:
    surface = a_map((0, 0, 1e9, 1e-12))
    assert len(build_mesh(surface).triangles) == 2
    assert len(build_mesh(surface, "patches").lines) == 0


@pytest.mark.parametrize("style", ["surface", "patches"])
def test_an_empty_map_has_an_empty_mesh(style: Style) -> None:
    mesh = build_mesh(SurfaceMap.of(Grid(0.5, 1.0, 0.2)), style)
    assert [part.shape for part in (mesh.vertices, mesh.triangles, mesh.lines, mesh.points)] == [
        (0, 3),
        (0, 3),
        (0, 2),
        (0,),
    ]


@pytest.mark.parametrize("seed", range(20))
def test_patches_are_points_at_their_height_with_lines_for_depths(seed: int) -> None:
    surface = random_map(np.random.default_rng(seed))
    mesh = build_mesh(surface, "patches")
    patches = patches_of(surface)
    points = mesh.vertices[mesh.points]
    assert points.tolist() == [[(p.ix + 0.5) / 2, (p.iy + 0.5) / 2, p.height] for p in patches]
    ends = mesh.vertices[mesh.lines]
    assert (ends[:, 0, :2] == ends[:, 1, :2]).all()
    upright = [[p.height, p.low] for p in patches if p.depth > 0]
    assert ends[:, :, 2].tolist() == upright
    assert len(mesh.triangles) == 0


def test_vertices_take_the_origin_and_colour_of_their_patch() -> None:
    surface = house()
    mesh = build_mesh(surface)
    columns = (surface.ix, surface.iy, surface.height, surface.low_end, surface.origin)
    spans = defaultdict[tuple[int, int], list[tuple[float, float, int]]](list)
    for ix, iy, top, low, origin in zip(*(c.tolist() for c in columns), strict=True):
        spans[ix, iy].append((low, top, origin))
    cells = np.floor(mesh.vertices[:, :2] / surface.cell_size).astype(int).tolist()
    for (ix, iy), z, origin in zip(
        cells, mesh.vertices[:, 2].tolist(), mesh.origin.tolist(), strict=True
    ):
        within = {o for low, top, o in spans[ix, iy] if low <= z <= top}
        assert origin == ROUTE or origin in within
    is_red = (mesh.colours == ARTIFICIAL_RED).all(axis=1)
    assert (is_red == (mesh.origin == ARTIFICIAL)).all()
    assert is_red.any()


def test_an_element_belongs_to_the_group_of_its_least_certain_vertex() -> None:
    origins = {(0, 0): 0, (1, 0): 0, (1, 1): 1, (0, 1): 2}
    surface = map_of([Patch(*cell, 0.0, 0.0, o, int(o == 0)) for cell, o in origins.items()])
    mesh = build_mesh(surface)
    groups = mesh.group(mesh.triangles).tolist()
    assert sorted(groups) == [1, 2]
    assert GROUPS == ("measured", "plastered", "artificial", "route")


def test_without_artificial_patches_the_rest_looks_the_same() -> None:
    surface = house()
    bare = build_mesh(surface, artificial=False)
    known = build_mesh(surface.take(surface.origin != ARTIFICIAL))
    assert bare.vertices.tolist() == known.vertices.tolist()
    assert bare.triangles.tolist() == known.triangles.tolist()
    assert not (bare.origin == ARTIFICIAL).any()
    before, after = (
        {
            tuple(vertex): colour
            for vertex, colour, origin in zip(
                mesh.vertices.tolist(), mesh.colours.tolist(), mesh.origin, strict=True
            )
            if origin == MEASURED
        }
        for mesh in (build_mesh(surface), bare)
    )
    assert before.keys() & after.keys()
    assert all(before[place] == after[place] for place in before.keys() & after.keys())


@pytest.mark.parametrize("style", ["surface", "patches"])
def test_the_route_is_a_green_line_just_above_the_ground(style: Style) -> None:
    surface = replace(
        a_map(*plane(9, 1, height=1.0), cell_size=2.0),
        route=np.array([(0, 1.5, 1.0, 4.0), (1, np.nan, 0, 0), (2, 5.5, 1.5, 5.0), (3, 9, 1, 5)]),
    )
    mesh = build_mesh(surface, style)
    z = 1.0 + ROUTE_LIFT * 2.0
    route = mesh.vertices[mesh.origin == ROUTE]
    assert mesh.vertices[mesh.lines].tolist() == [list(leg) for leg in pairwise(route.tolist())]
    assert [route[0].tolist(), route[-1].tolist()] == [[1.5, 1.0, z], [9.0, 1.0, z]]
    assert [5.5, 1.5, z] in route.tolist()
    assert (route[:, 2] == z).all()
    assert np.linalg.norm(np.diff(route, axis=0), axis=1).max() <= 2.0
    assert (mesh.colours[mesh.lines] == ROUTE_GREEN).all()
    assert (mesh.group(mesh.lines) == ROUTE).all()


def test_heights_that_differ_by_rounding_are_one_plane_whatever_the_slope() -> None:
    level = build_mesh(a_map(*plane(3, 3, 0.3)), max_slope=0.0)
    columns = [(x, y, 0.1 + 0.2 if (x + y) % 2 else z, d) for x, y, z, d in plane(3, 3, 0.3)]

    rounded = build_mesh(a_map(*columns), max_slope=0.0)

    assert len(rounded.triangles) == len(level.triangles)
    assert len(rounded.vertices) == len(level.vertices)


@pytest.mark.parametrize("slope", [-0.1, np.nan, np.inf])
def test_a_slope_that_is_none_is_refused(slope: float) -> None:
    with pytest.raises(UsageError, match=r"`max_slope` .* of 0 or more"):
        build_mesh(a_map((0, 0, 0, 0)), max_slope=slope)


def test_an_unknown_colouring_is_refused() -> None:
    with pytest.raises(UsageError, match=r"colour: is 'mood'; .* height, origin, variance"):
        build_mesh(a_map((0, 0, 0, 0)), colour="mood")  # type: ignore[arg-type]


def test_an_unknown_style_is_refused() -> None:
    with pytest.raises(UsageError, match=r"style: is 'solid'; .* surface, patches"):
        build_mesh(a_map((0, 0, 0, 0)), "solid")  # type: ignore[arg-type]


def test_a_mesh_beyond_float64_is_refused() -> None:
    with pytest.raises(InputError, match="beyond float64"):
        build_mesh(a_map((2**30, 0, 0, 0), cell_size=1e300))


def test_more_vertices_than_can_be_numbered_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mesh_module, "MAX_VERTICES", 7)
    assert len(build_mesh(a_map(*plane(1, 1))).vertices) == 4
    with pytest.raises(InputError, match="would have 8 vertices; at most 7"):
        build_mesh(a_map((0, 0, 0, 0), (5, 5, 0, 0)))
