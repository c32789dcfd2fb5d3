"""The coarse map that the page draws while it moves, of arrays handed to the page's own program."""

from __future__ import annotations

import json
from importlib import resources
from typing import Any, NamedTuple

import numpy as np
import pytest

from mlscli.runtime.arrays import Array
from tests.helpers.browser import Browser

CELL, FEW = 0.5, 50_000


class Layer(NamedTuple):
    elements: Array
    when: Array
    is_of_mesh: bool = True


def coarser(
    browser: Browser, position: Array, *layers: Layer, artificial: Array | None = None
) -> list[Layer]:
    """Return what the page makes of layers of a mesh, each of whose vertices is a patch."""
    text = (resources.files("mlscli.view") / "web" / "coarse.js").read_text(encoding="utf-8")
    origin = np.zeros(len(position), dtype=int) if artificial is None else 2 * artificial
    told = [
        {"corners": layer.elements.shape[1], "elements": layer.elements.ravel().tolist(),
         "when": layer.when.tolist(), "vertices": "mesh" if layer.is_of_mesh else "patches"}
        for layer in layers
    ]  # fmt: skip
    made: list[dict[str, Any]] = browser.evaluate(f"""(() => {{
        {text};
        const layers = {json.dumps(told)}.map(({{ elements, when, ...rest }}) => (
          {{ ...rest, elements: Uint32Array.from(elements), when: Int32Array.from(when) }}
        ));
        const position = Float32Array.from({json.dumps(position.ravel().tolist())});
        const patch = Int32Array.from(position.subarray(0, position.length / 3), (_, i) => i);
        const patches = {{ origin: {json.dumps(origin.tolist())} }};
        const vertices = {{ mesh: {{ position, patch }} }};
        return coarser({{ layers, cell_size: {CELL}, vertices, patches }})
          .map(({{ elements, when }}) => ({{ elements: [...elements], when: [...when] }}));
    }})()""")
    return [
        Layer(np.reshape(one["elements"], (-1, layer.elements.shape[1])), np.array(one["when"]))
        for one, layer in zip(made, layers, strict=True)
    ]


def plane(side: int, height: float = 0.0) -> tuple[Array, Layer]:
    """Return vertices and triangles of a plane that appears row by row, one vertex a cell."""
    x, y = np.indices((side, side))
    position = np.stack([CELL * x + 0.1, CELL * y + 0.1, height + 0 * x], axis=2).reshape(-1, 3)
    number = np.arange(side * side).reshape(side, side)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    triangles = np.stack([a, b, c, a, c, d], axis=2).reshape(-1, 3)
    return position, Layer(triangles, np.repeat(np.arange(side - 1), 2 * (side - 1)))


def area(position: Array, triangles: Array) -> Array:
    a, b, c = np.moveaxis(position[triangles], 1, 0)
    sizes: Array = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    return sizes


def test_a_plane_stays_a_plane_in_fewer_triangles(browser: Browser) -> None:
    position, fine = plane(240)
    (coarse,) = coarser(browser, position, fine)
    assert FEW / 5 < len(coarse.elements) <= FEW < len(fine.elements)
    sizes = area(position, coarse.elements)
    assert sizes.min() > 0
    assert sizes.sum() == pytest.approx(area(position, fine.elements).sum(), rel=0.03)


def test_what_appeared_with_a_keyframe_still_does(browser: Browser) -> None:
    position, fine = plane(240)
    (coarse,) = coarser(browser, position, fine)
    assert (np.diff(coarse.when) >= 0).all()
    rows = position[coarse.elements, 0].max(axis=1) / CELL
    # Boxes are a few cells wide.
    assert np.abs(rows - coarse.when).max() < 5


def test_levels_stay_apart(browser: Browser) -> None:
    below, ground = plane(170)
    above, deck = plane(170, height=1.1 * 2 * CELL)
    raised = Layer(deck.elements + len(below), deck.when)
    position = np.concatenate((below, above))
    for layer, height in zip(coarser(browser, position, ground, raised), (0.0, 1.1), strict=True):
        assert len(layer.elements) > 1000
        assert set(position[layer.elements, 2].ravel()) == {height}


def test_what_is_small_stays_as_it_is(browser: Browser) -> None:
    position, fine = plane(40)
    points = Layer(np.arange(len(position))[:, None], np.arange(len(position)), is_of_mesh=False)
    for layer, same in zip((fine, points), coarser(browser, position, fine, points), strict=True):
        np.testing.assert_array_equal(layer.elements, same.elements)
        np.testing.assert_array_equal(layer.when, same.when)


def test_lines_and_points_are_thinned_evenly(browser: Browser) -> None:
    position, _ = plane(350)
    number = np.arange(len(position))
    points = Layer(number[:, None], number, is_of_mesh=False)
    lines = Layer(np.stack((number, number), axis=1), number, is_of_mesh=False)
    for layer in coarser(browser, position, points, lines):
        np.testing.assert_array_equal(layer.when, number[::3])
        np.testing.assert_array_equal(
            layer.elements, np.tile(number[::3, None], (1, layer.elements.shape[1]))
        )


def test_lone_squares_and_strips_stay_in_sight(browser: Browser) -> None:
    side = 180
    x, y = np.indices((side, side))
    centre = np.stack([x, y], axis=2).reshape(-1, 1, 2) * 2 * CELL + 0.25
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * CELL / 4 + centre
    position = np.concatenate((corners, np.zeros((*corners.shape[:2], 1))), axis=2).reshape(-1, 3)
    halves = np.array([[0, 1, 2], [0, 2, 3]]) + 4 * np.arange(side * side)[:, None, None]
    squares = Layer(halves.reshape(-1, 3), np.zeros(2 * side * side, dtype=int))
    (coarse,) = coarser(browser, position, squares)
    assert FEW / 10 < len(coarse.elements) <= FEW
    assert area(position, coarse.elements).min() > 0
    # Everywhere something is left: each box of a few cells has one.
    seen = np.unique(np.floor(position[coarse.elements[:, 0], :2] / (8 * CELL)), axis=0)
    assert len(seen) == len(np.unique(np.floor(position[:, :2] / (8 * CELL)), axis=0))


def test_what_is_artificial_is_neither_lost_nor_more(browser: Browser) -> None:
    position, fine = plane(240)
    place = np.arange(len(position))
    red = np.isin(place, (120 * 240 + 100, 60 * 240 + 200, 61 * 240 + 200))
    is_red = red[fine.elements].any(axis=1)
    surface = Layer(fine.elements[~is_red], fine.when[~is_red])
    artificial = Layer(fine.elements[is_red], fine.when[is_red])
    plain, kept = coarser(browser, position, surface, artificial, artificial=red)
    assert not red[plain.elements].any()
    assert red[kept.elements].any(axis=1).all()
    assert len(kept.elements) > 0
    places = position[kept.elements].mean(axis=1)[:, :2] / CELL
    for spot in ((120, 100), (60.5, 200)):
        assert np.abs(places - spot).max(axis=1).min() < 4


def test_a_route_stays_connected(browser: Browser) -> None:
    position, fine = plane(240)
    steps = np.arange(240 * 120)
    route = Layer(np.stack((steps[:-1], steps[1:]), axis=1), steps[1:])
    _, coarse = coarser(browser, position, fine, route)
    assert 100 < len(coarse.elements) < len(route.elements) / 2
    assert (coarse.elements[1:, 0] == coarse.elements[:-1, 1]).all()


def test_a_stray_far_away_mixes_nothing(browser: Browser) -> None:
    position, fine = plane(240)
    far = position.copy()
    far[-1] = (3e5, 2e5, 1e3)
    (near,), (strayed,) = coarser(browser, position, fine), coarser(browser, far, fine)
    assert len(strayed.elements) == pytest.approx(len(near.elements), rel=0.01)


def test_triangles_of_which_none_can_be_spared_are_drawn_all(browser: Browser) -> None:
    position = 1e4 * np.array([[0.1, 0.1, 0.1], [1, 0.1, 0.1], [0.1, 1, 0.1]])
    many = Layer(np.tile([0, 1, 2], (FEW + 1, 1)), np.zeros(FEW + 1, dtype=np.int64))
    (kept,) = coarser(browser, position, many)
    assert len(kept.elements) == FEW + 1
