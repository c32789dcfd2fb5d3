"""The axes that point up, and the turn to z.

How these tests could be cheated: by directions near z, or by any rotation that takes the axis to
z. So the angle of the rotation is checked, too.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mlscli.geometry.poses import turn
from mlscli.geometry.up import UP_AXES, Up, axes_matrix, axis_named, describe, rotation_to_z
from mlscli.runtime.arrays import Float64


def axis_of(name: str) -> Float64:
    """Return the axis as a direction: + or - 1 at its letter."""
    direction = np.zeros(3)
    direction["xyz".index(name[-1])] = -1.0 if name[0] == "-" else 1.0
    return direction


@pytest.mark.parametrize("name", UP_AXES)
def test_an_axis_found_turns_points_as_the_axis_told(name: str) -> None:
    points = np.random.default_rng(1).normal(size=(100, 3))
    axes, signs = UP_AXES[name]

    np.testing.assert_array_equal(
        turn(rotation_to_z(axis_of(name)), points), points[:, axes] * signs
    )
    np.testing.assert_array_equal(axis_named(name), axis_of(name))
    np.testing.assert_array_equal(axes_matrix(name), rotation_to_z(axis_of(name)))


def test_the_turn_to_z_is_the_smallest() -> None:
    rng = np.random.default_rng(2)
    down = [[1e-9, 0, -1], [1e-5, -1e-5, -1], [0.0, 1e-3, -1]]
    for axis in (*rng.normal(size=(200, 3)), *np.array(down)):
        axis = axis / np.linalg.norm(axis)
        matrix = rotation_to_z(axis)
        np.testing.assert_allclose(matrix @ axis, [0, 0, 1], atol=1e-12)
        np.testing.assert_allclose(matrix @ matrix.T, np.eye(3), atol=1e-9)
        angle = Rotation.from_matrix(matrix).magnitude()
        assert angle == pytest.approx(np.arctan2(np.hypot(*axis[:2]), axis[2]), abs=1e-6)


def test_a_direction_is_named_by_its_axis_or_the_nearest() -> None:
    assert describe(np.array([0.0, -1.0, 0.0])) == "-y"
    assert describe(np.array([0.001, 0.001, 1.0]) / np.sqrt(1.000002)) == "z"
    assert describe(np.array([-0.001, -0.8, 0.6])) == "(0.00, -0.80, 0.60), 37° from -y"


def test_what_was_found_is_told_in_a_sentence() -> None:
    up = Up(
        axis_of("y"), 0.25, 0.5, axis_of("x"), 0.4, "the craft flew above 90% of the level ones"
    )

    assert up.support == 0.75
    for words in ("`up` auto", "up is y", "75%", "25% level", "50% upright", "the craft flew"):
        assert words in up.summary
    assert "\n" not in up.summary
    # Where points say nothing, they are not mentioned.
    lone = Up(axis_of("y"), 0.0, 0.0, axis_of("x"), 0.0, "the cameras were held upright")
    assert lone.summary == "`up` auto: up is y; the cameras were held upright"
