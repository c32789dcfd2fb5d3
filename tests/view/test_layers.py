"""What a map shows: every element in one layer, in the order in which they appear.

Ways to pass without being right: layers that leave triangles out; the keyframe of any one corner
in place of the last; levels mixed up where one lies above the other.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mlscli.io.writing.way import way_colours
from mlscli.maps.surface_map import SurfaceMap
from mlscli.mesh import build_mesh
from mlscli.queries.clearance import BLOCKED, FITS, NEVER_SEEN, clearance
from mlscli.queries.explore import explore
from mlscli.view.layers import MOST_POINTS, Layer, Picture, picture
from tests.helpers.maps import Patch, map_of
from tests.helpers.meshes import a_map, house, plane, soup
from tests.queries.test_explore import yard


def layers_of(shown: Picture) -> dict[str, Layer]:
    return {layer.name: layer for layer in shown.layers}


def test_surfaces_walls_and_artificial_make_up_the_mesh() -> None:
    mesh = build_mesh(house())
    shown = picture(house())
    layers = layers_of(shown)
    position = shown.vertices["mesh"].position
    parts = [layers[name].elements for name in ("surface", "walls", "artificial")]
    assert soup(position, np.concatenate(parts)) == soup(mesh.vertices, mesh.triangles)
    assert all(map(len, parts))


def test_walls_stand_and_surfaces_do_not() -> None:
    shown = picture(house())
    layers = layers_of(shown)
    corners = shown.vertices["mesh"].position
    for name, stands in (("walls", True), ("surface", False)):
        a, b, c = np.moveaxis(corners[layers[name].elements][:, :, :2], 1, 0)
        (ux, uy), (vx, vy) = (b - a).T, (c - a).T
        seen_from_above = ux * vy - uy * vx
        assert ((np.abs(seen_from_above) < 1e-12) == stands).all()


def test_artificial_triangles_have_an_artificial_corner_and_no_others_have() -> None:
    mesh, layers = build_mesh(house()), layers_of(picture(house()))
    for name, is_artificial in (("artificial", True), ("walls", False), ("surface", False)):
        assert ((mesh.origin[layers[name].elements] == 2).any(axis=1) == is_artificial).all()


def test_a_triangle_appears_with_the_last_of_its_corners() -> None:
    # Two floors, one above the other, seen in opposite directions.
    low, high = plane(6, 4), plane(6, 4, 5.0)
    surface = a_map(*low, *high)
    first = np.where(surface.height > 2, 5 - surface.ix, surface.ix).astype(np.int32)
    surface = replace(surface, first_keyframe=first, last_keyframe=first)
    shown = picture(surface)
    layer = layers_of(shown)["surface"]
    assert len(layer.elements) == 2 * 2 * 5 * 3
    for triangle, when in zip(layer.elements, layer.when, strict=True):
        x, _, z = shown.vertices["mesh"].position[triangle].T
        ix = np.floor(x)
        assert when == (5 - ix if z[0] > 2 else ix).max()


def test_what_appears_ascends_in_every_layer() -> None:
    rng = np.random.default_rng(3)
    points = rng.uniform(-3, 3, (500, 3))
    for layer in picture(timed(house()), points).layers:
        assert len(layer.when) == len(layer.elements)
        assert (np.diff(layer.when) >= 0).all()


def timed(surface: SurfaceMap) -> SurfaceMap:
    first = np.where(surface.origin == 0, surface.ix % 7, -1).astype(np.int32)
    return replace(surface, first_keyframe=first, last_keyframe=first)


def test_patches_are_points_at_their_heights_and_depths_lines_beneath() -> None:
    surface = map_of([Patch(0, 0, 1.0, 0.0, 0, 3), Patch(2, 1, 4.0, 1.5, 0, 2)])
    shown = picture(surface)
    layers, position = layers_of(shown), shown.vertices["patches"].position
    assert position[layers["patches"].elements[:, 0]].tolist() == [
        [0.25, 0.25, 1.0],
        [1.25, 0.75, 4.0],
    ]
    assert position[layers["depths"].elements].tolist() == [[[1.25, 0.75, 4.0], [1.25, 0.75, 2.5]]]


def test_the_routes_follow_the_craft() -> None:
    route = np.array([[0, 0.5, 0.5, 9], [1, 1.5, 0.5, 9], [2, np.nan, 0, 0], [3, 2.5, 0.5, 9]])
    surface = replace(a_map(*plane(4, 2)), route=route)
    shown = picture(replace(surface, first_keyframe=surface.first_keyframe * 0))
    layers = layers_of(shown)
    assert layers["track"].when.tolist() == [1, 3]
    assert layers["route"].when.tolist() == [1, 3]
    ends = shown.vertices["mesh"].position[layers["route"].elements]
    assert ends[:, :, 0].tolist() == [[0.5, 1.5], [1.5, 2.5]]


def test_a_route_that_comes_back_is_there_when_it_came_back() -> None:
    x = [0.5, 1.5, 0.5, 2.5]
    route = np.column_stack((np.arange(4), x, np.full(4, 0.5), np.full(4, 9)))
    shown = picture(replace(a_map(*plane(4, 2)), route=route))
    layer = layers_of(shown)["route"]
    ends = shown.vertices["mesh"].position[layer.elements][:, :, 0]
    arrived = dict(zip(layer.when.tolist(), ends[:, 1].tolist(), strict=True))
    assert arrived == {1: 1.5, 2: 0.5, 3: 2.5}


def test_patches_appear_when_first_seen_and_points_with_their_cell() -> None:
    surface = a_map(*plane(3, 1))
    first = np.array([2, 0, 1], dtype=np.int32)
    surface = replace(surface, first_keyframe=first, last_keyframe=first)
    points = np.array([[0.5, 0.5, 0], [1.5, 0.5, 9], [2.5, 0.5, 0], [7.5, 0.5, 0]])
    patches = layers_of(picture(surface))["patches"]
    assert (patches.elements[:, 0].tolist(), patches.when.tolist()) == ([1, 2, 0], [0, 1, 2])
    layer = layers_of(picture(surface, points))["points"]
    assert dict(zip(layer.elements[:, 0].tolist(), layer.when.tolist(), strict=True)) == {
        0: 2, 1: 0, 2: 1, 3: 0,
    }  # fmt: skip


def test_points_are_thinned_where_there_are_too_many() -> None:
    many = np.zeros((2 * MOST_POINTS + 1, 3))
    layer = layers_of(picture(a_map(*plane(3, 1)), many))["points"]
    assert MOST_POINTS / 2 < len(layer.elements) <= MOST_POINTS


def test_an_empty_map_shows_nothing() -> None:
    shown = picture(map_of([]), np.empty((0, 3)))
    assert all(len(layer.elements) == 0 for layer in shown.layers)


def test_views_appear_with_the_finished_map() -> None:
    found = explore(yard(), 0.5, 0.5, most=2)
    shown = picture(yard(), explored=found)
    layer = shown.layers[-1]
    assert layer.name == "views"
    assert set(layer.when.tolist()) == {len(yard().route) - 1}
    vertices = shown.vertices["views"].position
    for view in found.views:
        # On the way, and where its camera is.
        assert (vertices == view.place).all(axis=1).sum() >= 2
    assert all(layer.name != "views" for layer in picture(yard()).layers)


def test_the_way_of_a_craft_is_drawn_as_high_as_it_is_in_the_colours_of_its_clearance() -> None:
    found = clearance(yard(), np.array([[0.0, -4, 1.0], [2.25, 0, 1.0], [4, 1, 2.0]]), 0.6, 0.4)
    shown = picture(yard(), fitted=found)
    ends = shown.vertices["clearance"].position[shown.layers[-1].elements]
    colours = shown.vertices["clearance"].colour[shown.layers[-1].elements]
    assert len(ends) == 2 * len(found.verdict)
    assert {BLOCKED, FITS, NEVER_SEEN} <= set(found.verdict.tolist())
    place = found.pieces.place
    np.testing.assert_array_equal(ends[::2], np.stack((place[:-1], place[1:]), axis=1))
    bars = ends[1::2]
    assert bars.mean(axis=1) == pytest.approx((place[:-1] + place[1:]) / 2)
    assert bars[:, 1] - bars[:, 0] == pytest.approx(np.tile([0, 0, 0.4], (len(bars), 1)))
    for line in (0, 1):
        for end in (0, 1):
            np.testing.assert_array_equal(colours[line::2, end], way_colours(found))
