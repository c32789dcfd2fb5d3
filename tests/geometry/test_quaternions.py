"""In which order the numbers of quaternions stand, told by the scene.

How these tests could be cheated: by the order that is common. So each flight is written in both,
and the numbers alone must tell; and what tells nothing must not be certain.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mlscli.geometry.quaternions import CERTAIN, favour, otherwise
from mlscli.runtime.arrays import Float64

RNG = np.random.default_rng(8)


def yard() -> Float64:
    """Return ground of 20 by 20, and a wall of 20 by 4."""
    flat = RNG.uniform((-10, -10, -0.02), (10, 10, 0.02), (3000, 3))
    wall = RNG.uniform((-10, 9.98, 0), (10, 10.02, 4), (800, 3))
    return np.concatenate((flat, wall))


STEPS = np.linspace(0, 1, 30)[:, np.newaxis]
ROUTE: Float64 = np.hstack((16 * STEPS - 8, 4 * STEPS - 2, np.full((30, 1), 6.0)))
# A camera that looks ahead along x of the craft: its x is to the right, its y down.
CAMERA = Rotation.from_matrix([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])


def flown(turn: float, kind: str) -> Float64:
    """Return attitudes of a craft, or its camera, that turns by so many degrees on its way."""
    shaken = np.hstack((RNG.normal(0, 2, (30, 2)), turn * STEPS))
    attitudes = Rotation.from_euler("xyz", shaken, degrees=True)
    return np.asarray((attitudes * CAMERA if kind == "camera" else attitudes).as_quat())


@pytest.mark.parametrize("kind", ["body", "camera"])
@pytest.mark.parametrize("turn", [90, 180, 360])
def test_the_order_in_which_a_craft_flies_upright_above_the_ground_is_likelier(
    turn: float, kind: str
) -> None:
    attitudes, points = flown(turn, kind), yard()
    written_w_first = np.roll(attitudes, 1, axis=1)

    assert favour(points, ROUTE, attitudes, otherwise(attitudes, "x y z w")) > CERTAIN
    np.testing.assert_array_equal(otherwise(written_w_first, "x y z w"), attitudes)
    assert favour(points, ROUTE, written_w_first, attitudes) < -CERTAIN
    np.testing.assert_array_equal(otherwise(attitudes, "w x y z"), written_w_first)


def test_numbers_that_say_the_same_in_both_orders_tell_nothing() -> None:
    # A turn by 120 degrees about the diagonal of all axes.
    attitudes = np.full((30, 4), 0.5)

    assert favour(yard(), ROUTE, attitudes, otherwise(attitudes, "x y z w")) == 0


@pytest.mark.parametrize("kind", ["body", "camera"])
def test_a_flight_straight_ahead_is_not_certain(kind: str) -> None:
    # The same numbers in the other order are those of a camera, or of a craft, on its side.
    attitudes = flown(0, kind)

    assert abs(favour(yard(), ROUTE, attitudes, otherwise(attitudes, "x y z w"))) < CERTAIN


def test_what_stays_where_it_is_or_saw_nothing_tells_nothing() -> None:
    attitudes = flown(90, "body")
    others = otherwise(attitudes, "x y z w")

    assert favour(yard(), np.zeros((30, 3)), attitudes, others) == 0
    assert favour(np.empty((0, 3)), ROUTE, attitudes, others) == 0
