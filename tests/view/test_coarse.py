"""The coarse map that the page draws while it moves, of arrays handed to the page's own program."""

from __future__ import annotations

import json
from importlib import resources
from typing import Any, NamedTuple

import numpy as np
import pytest

from mlscli.typing import Array
from tests.browser import Browser

CELL, FEW = 0.5, 50_000


class Layer(NamedTuple):
    elements: Array
    when: Array


def coarser(browser: Browser, position: Array, *layers: Layer) -> list[Layer]:
    """Return what the page makes of layers with the same vertices."""
    text = (resources.files("mlscli.view") / "web" / "coarse.js").read_text(encoding="utf-8")
    told = [
        {"corners": layer.elements.shape[1], "elements": layer.elements.ravel().tolist(),
         "when": layer.when.tolist()}
        for layer in layers
    ]  # fmt: skip
    made: list[dict[str, Any]] = browser.evaluate(f"""(() => {{
        {text};
        const layers = {json.dumps(told)}.map(({{ corners, elements, when }}) => (
          {{ corners, elements: Uint32Array.from(elements), when: Int32Array.from(when) }}
        ));
        const position = Float32Array.from({json.dumps(position.ravel().tolist())});
        return coarser({{ layers, cell_size: {CELL}, vertices: {{ mesh: {{ position }} }} }})
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
    points = Layer(np.arange(len(position))[:, None], np.arange(len(position)))
    for layer, same in zip((fine, points), coarser(browser, position, fine, points), strict=True):
        np.testing.assert_array_equal(layer.elements, same.elements)
        np.testing.assert_array_equal(layer.when, same.when)


def test_lines_and_points_are_thinned_evenly(browser: Browser) -> None:
    position, _ = plane(350)
    number = np.arange(len(position))
    points, lines = Layer(number[:, None], number), Layer(np.stack((number, number), 1), number)
    for layer in coarser(browser, position, points, lines):
        np.testing.assert_array_equal(layer.when, number[::3])
        np.testing.assert_array_equal(
            layer.elements, np.tile(number[::3, None], (1, layer.elements.shape[1]))
        )


def test_triangles_of_which_none_can_be_spared_are_drawn_all(browser: Browser) -> None:
    position = 1e4 * np.array([[0.1, 0.1, 0.1], [1, 0.1, 0.1], [0.1, 1, 0.1]])
    many = Layer(np.tile([0, 1, 2], (FEW + 1, 1)), np.zeros(FEW + 1, dtype=np.int64))
    (kept,) = coarser(browser, position, many)
    assert len(kept.elements) == FEW + 1
