"""The nearest of many points, as a search of all of them finds it.

How one could cheat: be right for points that lie nowhere on a grid and never twice; lose points at
the edge of a part, or where there are fewer than are asked for; search too far; keep the caller's
array and put it in another order.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from mlscli.runtime.arrays import Float64, Int64
from mlscli.runtime.tree import Tree

# Few different coordinates: points coincide, and many are equally far from a place.
COARSE = st.sampled_from([-2.0, -1.0, -0.0, 0.0, 0.5, 1.0, 1e8])
CLOUDS = st.integers(0, 80).flatmap(
    lambda size: arrays(np.float64, (size, 3), elements=COARSE | st.floats(-3, 3, width=32))
)


def squares(points: Float64, places: Float64) -> Float64:
    x, y, z = np.moveaxis(points[None] - places[:, None], 2, 0)
    found: Float64 = (x * x + y * y) + z * z
    return found


def nearest(points: Float64, places: Float64, count: int, reach: float) -> tuple[Float64, Int64]:
    """Return what `Tree.nearest` should: all are measured, and sorted by distance and number."""
    distances = np.full((len(places), count), np.inf)
    rows = np.full((len(places), count), len(points))
    for m, square in enumerate(squares(points, places)):
        order = np.argsort(square, kind="stable")
        order = order[square[order] < reach * reach][:count]
        distances[m, : len(order)], rows[m, : len(order)] = np.sqrt(square[order]), order
    return distances, rows


@given(CLOUDS, CLOUDS, st.integers(1, 30), st.sampled_from([0.0, 0.5, 1.0, 2.5, np.inf]))
def test_the_nearest_are_those_that_a_search_of_all_finds(
    points: Float64, places: Float64, count: int, reach: float
) -> None:
    distances, rows = Tree(points).nearest(places, count, reach)
    expected_distances, expected_rows = nearest(points, places, count, reach)
    assert np.array_equal(distances, expected_distances)
    assert np.array_equal(rows, expected_rows)


@given(CLOUDS, CLOUDS, st.sampled_from([0.0, 0.5, 1.0, 2.5]))
def test_those_within_reach_are_counted(points: Float64, places: Float64, reach: float) -> None:
    expected = (squares(points, places) <= reach * reach).sum(axis=1)
    assert np.array_equal(Tree(points).counts(places, reach), expected)


@pytest.mark.parametrize("size", [1, 28, 29, 56, 57, 5000])
def test_every_point_finds_itself_in_a_cloud_of_any_size(size: int) -> None:
    points = np.random.default_rng(size).normal(size=(size, 3)) * (100.0, 1.0, 0.01) + 1e6
    before = points.copy()
    tree = Tree(points)
    distances, rows = tree.nearest(points, 2)
    assert np.array_equal(points, before)
    assert not distances[:, 0].any()
    assert np.array_equal(rows[:, 0], np.arange(size))
    assert np.array_equal(np.sort(tree.rows), np.arange(size))


def test_neighbours_in_space_stand_together_in_the_order_of_the_tree() -> None:
    points = np.random.default_rng(1).random((5000, 3))
    ordered = points[Tree(points).rows]
    steps = [np.linalg.norm(np.diff(each, axis=0), axis=1).mean() for each in (points, ordered)]
    assert steps[1] < 0.25 * steps[0]


def test_a_place_that_is_not_known_has_no_neighbours() -> None:
    tree = Tree(np.zeros((3, 3)))
    distances, rows = tree.nearest(np.full((1, 3), np.nan), 2)
    assert np.isinf(distances).all()
    assert (rows == 3).all()


def test_points_that_must_not_be_written_to_are_taken() -> None:
    points = np.random.default_rng(1).random((50, 3))
    points.flags.writeable = False
    assert not Tree(points).nearest(points, 1)[0].any()


def test_points_put_into_the_order_of_the_tree_are_numbered_by_their_places() -> None:
    points = np.random.default_rng(1).random((500, 3))
    given = points.copy()
    tree = Tree(points, in_place=True)
    assert np.array_equal(points, given[tree.rows])
    distances, places = tree.nearest(given, 5)
    expected, rows = Tree(given).nearest(given, 5)
    assert np.array_equal(distances, expected)
    assert np.array_equal(tree.rows[places], rows)
