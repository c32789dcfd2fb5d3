"""Rings around what differs between two maps.

Ways to pass without being right: rings anywhere, so their places are known; one ring for all.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mlscli.errors import UsageError
from mlscli.maps.surface_map import SurfaceMap
from mlscli.plot.differences import changes, differing, plot_differences, rings
from mlscli.plot.relief import frame_of
from tests.helpers.meshes import a_map, plane

FLOOR = a_map(*plane(40, 30), cell_size=0.5)


def ringed(one: SurfaceMap, other: SurfaceMap) -> list[tuple[float, float]]:
    frame = frame_of(one, other)
    return [(ring.x, ring.y) for ring in rings(differing(one, other, frame), frame)]


def raised(by: float, *cells: tuple[int, int]) -> SurfaceMap:
    height = FLOOR.height.copy()
    for x, y in cells:
        height[(FLOOR.ix == x) & (FLOOR.iy == y)] += by
    return replace(FLOOR, height=height).sorted()


def test_equal_maps_have_no_ring() -> None:
    assert ringed(FLOOR, FLOOR) == []


def test_a_patch_that_one_map_only_has_is_ringed_in_the_middle_of_its_cell() -> None:
    missing = FLOOR.take(~((FLOOR.ix == 20) & (FLOOR.iy == 10)))
    assert ringed(FLOOR, missing) == [(10.25, 5.25)]
    assert ringed(missing, FLOOR) == [(10.25, 5.25)]


def test_heights_are_ringed_from_half_a_cell_on() -> None:
    assert ringed(FLOOR, raised(0.24, (5, 5))) == []
    assert ringed(FLOOR, raised(0.26, (5, 5))) == [(2.75, 2.75)]


def test_a_patch_that_is_artificial_in_one_map_alone_is_ringed() -> None:
    origin = FLOOR.origin.copy()
    origin[(FLOOR.ix == 20) & (FLOOR.iy == 10)] = 2
    assert ringed(FLOOR, replace(FLOOR, origin=origin)) == [(10.25, 5.25)]


def test_what_stretches_over_half_the_map_is_ringed_piece_by_piece() -> None:
    cells = [(x, 10) for x in range(40)]
    frame = frame_of(FLOOR)
    circles = rings(differing(FLOOR, raised(1, *cells), frame), frame)
    assert len(circles) > 2
    assert max(ring.radius for ring in circles) < 16 * 0.5
    for x, y in cells:
        place = (x + 0.5) * 0.5, (y + 0.5) * 0.5
        assert any(np.hypot(place[0] - c.x, place[1] - c.y) < c.radius for c in circles)


def test_what_is_near_shares_a_ring_and_what_is_far_has_its_own() -> None:
    assert len(ringed(FLOOR, raised(1, (5, 5), (6, 6), (30, 20)))) == 2


def test_a_ring_holds_all_that_differs() -> None:
    cells = ((5, 5), (6, 7), (7, 8))
    frame = frame_of(FLOOR)
    (ring,) = rings(differing(FLOOR, raised(1, *cells), frame), frame)
    corners = np.array([(x + dx, y + dy) for x, y in cells for dx in (0, 1) for dy in (0, 1)]) * 0.5
    assert (np.hypot(*(corners - (ring.x, ring.y)).T) <= ring.radius).all()


def test_the_picture_says_how_many_places_differ() -> None:
    figure = plot_differences(FLOOR, raised(1, (5, 5), (30, 20)), titles=("a", "b"))
    assert figure.get_supxlabel() == "2 places where the maps differ"
    assert [axes.get_title() for axes in figure.axes[:2]] == ["a", "b"]
    assert len(figure.axes[0].patches) == len(figure.axes[1].patches) == 4


def test_many_places_are_counted_and_not_ringed() -> None:
    places = [(x, y) for x in range(2, 40, 6) for y in range(2, 30, 5)]
    figure = plot_differences(FLOOR, raised(1, *places))
    assert figure.get_supxlabel() == "42 places where the maps differ"
    assert not figure.axes[0].patches


def test_heights_differ_by_what_the_other_map_is_higher() -> None:
    other = raised(0.5, (5, 5))
    other = other.take(~((other.ix == 20) & (other.iy == 10)))
    deck = a_map((5, 5, 9.0, 0.0), cell_size=0.5)
    frame = frame_of(FLOOR)
    found = changes(FLOOR, other, frame)
    assert found.higher[5, 5] == 0.5
    assert np.isnan(found.higher[10, 20])
    assert np.count_nonzero(found.higher == 0) == FLOOR.size - 2
    assert np.argwhere(found.in_one).tolist() == [[10, 20]]
    assert not found.in_other.any()
    back = changes(other, FLOOR, frame)
    assert back.higher[5, 5] == -0.5
    assert (back.in_other == found.in_one).all()
    assert np.argwhere(changes(FLOOR, deck, frame).in_other).tolist() == [[5, 5]]


def test_of_two_levels_the_one_that_moved_most_is_shown() -> None:
    levels = a_map((0, 0, 0.0, 0.0), (0, 0, 3.0, 0.0))
    moved = a_map((0, 0, 0.25, 0.0), (0, 0, 2.5, 0.0))
    assert changes(levels, moved, frame_of(levels)).higher[0, 0] == -0.5


def test_the_picture_names_what_one_map_only_has() -> None:
    missing = FLOOR.take(FLOOR.ix > 3)
    legend = plot_differences(FLOOR, missing, titles=("a.npz", "b.npz")).axes[2].get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["in a.npz only"]


def test_maps_of_other_cells_are_refused() -> None:
    with pytest.raises(UsageError, match="cell_size"):
        plot_differences(FLOOR, a_map((0, 0, 0, 0)))
