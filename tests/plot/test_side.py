"""Maps from the side: what is nearer hides what is farther, and what lies before the middle.

Ways to pass without being right: maps that look alike from both sides, or on which axes can be
exchanged; so walls differ in width and height, and the same map is looked at turned.
"""

from __future__ import annotations

import numpy as np
import pytest

import mlscli
from mlscli.maps.surface_map import SurfaceMap
from mlscli.plot.relief import SOFT_RED, frame_of
from mlscli.plot.side import Side, is_mostly_walls, side_of
from tests.helpers.maps import Patch, map_of
from tests.helpers.meshes import a_map

# Rows of ground in the south, a low wall, and a high one far behind it, over ten columns.
COLUMNS = [
    *((x, y, 0.0, 0.0) for x in range(12) for y in range(5)),
    *((x, 5, 1.5, 1.5) for x in range(8)),
    *((x, 9, 3.5, 3.5) for x in range(2, 9)),
]


def seen(surface: SurfaceMap) -> Side:
    return side_of(surface, frame_of(surface), SOFT_RED)


def brightness(side: Side) -> list[str]:
    """Return the view from the top down: a blank, ``n`` for what is near, ``f`` for what is far."""
    near = side.image[0, 0, :3].astype(int).sum()
    rows = []
    for row in side.image[::-1].astype(int):
        signs = [" " if not a else "n" if rgb <= near else "f" for *c, a in row for rgb in [sum(c)]]
        rows.append("".join(signs))
    return rows


def test_what_is_nearer_hides_what_is_farther() -> None:
    walls = [column for column in COLUMNS if column[1] >= 5]
    side = seen(a_map(*walls))
    # The low wall is nearer; of the high one that is seen which stands above it and beside it.
    assert brightness(side) == [
        "  fffffff",
        "  fffffff",
        "nnnnnnnnf",
        "nnnnnnnnf",
    ]
    assert side.extent == (0.0, 9.0, 0.0, 4.0)
    assert (side.across, side.along) == ("x", "y")


def test_what_lies_before_the_middle_is_not_seen() -> None:
    side = seen(a_map(*COLUMNS))
    # The middle of the patches is a row of ground; those before it would be as wide as this.
    assert side.middle == 3.0
    front = [(x, 0, 9.0, 9.0) for x in range(12)]
    kept = [column for column in COLUMNS if column[1] > 0]
    assert brightness(seen(a_map(*front, *kept))) == brightness(side)


def test_a_map_longer_to_the_north_is_looked_at_to_the_east() -> None:
    north = [column for column in COLUMNS if column[1] >= 5]
    # Turned to the right: what was north is east, and what was west is north.
    east = [(y, -1 - x, height, depth) for x, y, height, depth in north]
    one, other = seen(a_map(*north)), seen(a_map(*east))
    assert (other.across, other.along) == ("y", "x")
    np.testing.assert_array_equal(one.image, other.image)
    assert other.extent == (0.0, -9.0, 0.0, 4.0)


def test_artificial_walls_are_red() -> None:
    surface = map_of([Patch(x, 0, 2.0, 2.0, 2, 0) for x in range(3)])
    assert seen(surface).image[0, 0].tolist() == [*SOFT_RED.tolist(), 255]


@pytest.mark.parametrize(("walls", "axes"), [(2, 1), (4, 2)])
def test_a_map_that_is_mostly_walls_is_shown_from_the_side_too(walls: int, axes: int) -> None:
    surface = a_map(*((x, 0, 2.0, 2.0 if x < walls else 0.0) for x in range(10)))
    assert is_mostly_walls(surface) == (axes == 2)
    figure = mlscli.plot_above(surface)
    drawn = [each for each in figure.axes if each.get_label() != "<colorbar>"]
    assert len(drawn) == axes
    # A level that is asked for is seen from above alone.
    alone = mlscli.plot_above(surface, level=1)
    assert len([each for each in alone.axes if each.get_label() != "<colorbar>"]) == 1
