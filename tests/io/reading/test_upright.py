"""The turn after which z points up, and the way back.

How these tests could be cheated: by clouds about the origin, where it does not matter about what
they turn; by a matrix that is told, but not what is done to the points.
"""

from __future__ import annotations

import numpy as np
import pytest

from mlscli.geometry.up import UP_AXES, Up
from mlscli.io.reading.upright import Upright
from mlscli.runtime.arrays import Float64

NO = np.zeros(3)
POINTS = np.random.default_rng(1).normal(size=(50, 3)) * 9


def up_along(x: float, y: float, z: float, middle: Float64 = NO) -> Up:
    axis = np.array([x, y, z]) / np.linalg.norm([x, y, z])
    return Up(axis, 0.5, 0.5, np.array([1.0, 0.0, 0.0]), 0.1, "it was found", middle)


def by_matrix(upright: Upright, points: Float64) -> Float64:
    return (np.column_stack((points, np.ones(len(points)))) @ upright.matrix.T)[:, :3]


@pytest.mark.parametrize("name", UP_AXES)
def test_the_matrix_of_an_axis_is_what_is_done_to_the_points(name: str) -> None:
    upright = Upright.along(name)
    turned = upright.points(POINTS.copy())

    np.testing.assert_array_equal(turned, by_matrix(upright, POINTS))
    np.testing.assert_array_equal(upright.recorded(turned), POINTS)


@pytest.mark.parametrize("name", UP_AXES)
def test_an_axis_that_was_found_exactly_turns_as_if_it_were_named(name: str) -> None:
    named = Upright.along(name)
    far = np.array([513_000.0, 5_403_000.0, 300.0])
    x, y, z = named.matrix[2, :3].tolist()
    found = Upright.found(up_along(x, y, z, far))

    np.testing.assert_array_equal(found.points(POINTS + far), named.points(POINTS + far))
    np.testing.assert_array_equal(found.matrix, named.matrix)


def test_a_cloud_about_the_origin_turns_about_the_origin() -> None:
    upright = Upright.found(up_along(0.1, -0.9, -0.3))

    assert upright.matrix[:3, 3].tolist() == [0, 0, 0]
    np.testing.assert_allclose(upright.points(POINTS.copy()), by_matrix(upright, POINTS))
    assert upright.position((0.0, 0.0, 0.0)) == (0, 0, 0)


@pytest.mark.parametrize(
    ("axis", "lands"),
    [
        ((0.02, 0.0, 1.0), (4000, 9000, 70)),
        ((0.1, -0.9, -0.3), (4000, 70, -9000)),
        ((0.0, 0.9, 0.2), (4000, -70, 9000)),
    ],
)
def test_a_cloud_far_away_turns_about_its_middle_which_goes_where_the_nearest_axis_takes_it(
    axis: tuple[float, float, float], lands: tuple[float, float, float]
) -> None:
    middle = np.array([4000.0, 9000.0, 70.0])
    upright = Upright.found(up_along(*axis, middle))
    turned = upright.points(POINTS + middle)

    assert upright.position((4000.0, 9000.0, 70.0)) == lands
    np.testing.assert_allclose(turned - lands, POINTS @ upright.matrix[:3, :3].T, atol=1e-9)
    np.testing.assert_allclose(turned, by_matrix(upright, POINTS + middle), atol=1e-9)
    np.testing.assert_allclose(upright.recorded(turned), POINTS + middle, atol=1e-9)
