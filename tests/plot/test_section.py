"""Cuts: which patches a line meets, and where.

Ways to pass without being right: lines along an axis only.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from mlscli.errors import UsageError
from mlscli.plot.section import cut, plot_section
from tests.helpers.meshes import Column, a_map, plane

FLOOR = a_map(*plane(6, 4), cell_size=0.5)


def test_a_cut_along_an_axis_meets_each_cell_once() -> None:
    found = cut(FLOOR, (0.25, 0.75), (2.25, 0.75))
    cells = list(zip(FLOOR.ix[found.patch].tolist(), FLOOR.iy[found.patch].tolist(), strict=True))
    assert cells == [(0, 1), (1, 1), (2, 1), (3, 1), (4, 1)]
    assert found.begin == pytest.approx([0, 0.25, 0.75, 1.25, 1.75])
    assert found.end == pytest.approx([0.25, 0.75, 1.25, 1.75, 2.0])


def test_a_slanting_cut_meets_what_the_line_runs_through() -> None:
    start, end = (0.1, 0.2), (2.9, 1.7)
    found = cut(FLOOR, start, end)
    along = np.linspace(0, 1, 100_001)
    x, y = (start[i] + along * (end[i] - start[i]) for i in (0, 1))
    cells = set(zip((x // 0.5).astype(int).tolist(), (y // 0.5).astype(int).tolist(), strict=True))
    met = list(zip(FLOOR.ix[found.patch].tolist(), FLOOR.iy[found.patch].tolist(), strict=True))
    assert len(met) == len(cells)
    assert set(met) == cells
    assert found.begin[0] == 0
    assert found.end[-1] == pytest.approx(math.dist(start, end))
    assert found.begin[1:] == pytest.approx(found.end[:-1])


def test_all_levels_of_a_cell_are_met_from_below() -> None:
    surface = a_map((0, 0, 0, 0), (0, 0, 3, 0), (0, 0, 9, 2))
    found = cut(surface, (-1, 0.5), (2, 0.5))
    assert found.patch.tolist() == [0, 1, 2]
    assert found.begin.tolist() == [1, 1, 1]


@pytest.mark.parametrize(
    "ends", [((1, 1), (1, 1)), ((0, 0), (math.nan, 1)), ((0, 0), (1e300, 0)), ((0, 0), (1e9, 0))]
)
def test_a_line_that_is_none_is_refused(
    ends: tuple[tuple[float, float], tuple[float, float]],
) -> None:
    with pytest.raises(UsageError, match="`section`"):
        cut(FLOOR, *ends)


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
