"""Cuts as pictures: what is drawn, and what is told of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mlscli.errors import UsageError
from mlscli.maps.free_space import FreeSpace
from mlscli.maps.surface_map import SurfaceMap
from mlscli.plot.section import plot_section
from tests.helpers.meshes import Column, a_map, plane

FLOOR = a_map(*plane(6, 4), cell_size=0.5)


def test_a_cut_beside_the_map_is_refused() -> None:
    with pytest.raises(UsageError, match="meets no patch"):
        plot_section(FLOOR, (10, 10), (11, 11))


def test_the_space_under_a_bridge_is_told_once_and_in_the_map_s_unit() -> None:
    bridge: list[Column] = [(x, 0, 2.5, 0.0) for x in range(3, 8)]
    figure = plot_section(a_map(*plane(12, 1), *bridge), (0, 0.5), (12, 0.5))
    words = [text.get_text() for text in figure.axes[0].texts]
    assert [word for word in words if word] == ["2.5"]


def test_walls_are_boxes_down_to_their_depth() -> None:
    figure = plot_section(a_map(*plane(3, 1), (3, 0, 4.0, 3.0)), (0, 0.5), (4, 0.5))
    paths = [path.vertices for c in figure.axes[0].collections for path in c.get_paths()]
    boxes = [np.asarray(p) for p in paths]
    assert any(
        (box.min(axis=0).tolist(), box.max(axis=0).tolist()) == ([3, 1], [4, 4]) for box in boxes
    )


def test_the_ends_of_a_cut_are_told_apart_also_far_from_the_origin() -> None:
    surface = a_map(*[(4_498_561 + x, 0, 0.0, 0.0) for x in range(6)], cell_size=1.0)
    start, end = (4498561.25, 0.5), (4498566.5, 0.5)
    (axes, *_) = plot_section(surface, start, end).axes
    assert axes.get_xlabel() == "along the cut from (4498561.25, 0.5) to (4498566.5, 0.5)"
    with pytest.raises(UsageError, match=r"`section` 4498600,0\.5,4498601,0\.5: meets no patch"):
        plot_section(surface, (4498600, 0.5), (4498601, 0.5))


def legend(surface: SurfaceMap) -> set[str]:
    (drawn,) = plot_section(surface, (0, 0.5), (12, 0.5)).legends
    return {text.get_text() for text in drawn.get_texts()}


def test_the_legend_tells_what_is_drawn_and_what_is_not_known() -> None:
    bridge = a_map(*plane(12, 1), *[(x, 0, 2.5, 0.0) for x in range(3, 8)])
    assert legend(bridge) == {
        "between levels, seen or not",
        "beneath the ground",
        "narrowest clearance",
    }
    assert legend(replace(bridge, free=FreeSpace.of_none())) == {
        "seen through",
        "never seen",
        "beneath the ground",
        "narrowest clearance",
    }
    assert legend(FLOOR) == {"between levels, seen or not", "beneath the ground"}


def test_the_narrowest_clearance_of_all_stands_out() -> None:
    decks: list[Column] = [(x, 0, 2.5 if x < 6 else 1.75, 0.0) for x in (1, 2, 3, 4, 8, 9, 10)]
    figure = plot_section(a_map(*plane(12, 1), *decks), (0, 0.5), (12, 0.5))
    words = {text.get_text(): text for text in figure.axes[0].texts if text.get_text()}
    assert set(words) == {"2.5", "1.75"}
    assert words["1.75"].get_fontweight() == "bold"
    assert words["2.5"].get_fontweight() == "normal"
