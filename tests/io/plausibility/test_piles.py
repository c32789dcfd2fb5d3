"""Points at one place that were never measured, told from those that coincide as others do.

How these tests could be cheated: by dropping all that is zero, or all that is twice there. So there
are clouds about the origin, of triangles, and on coarse grids.
"""

from __future__ import annotations

import numpy as np
import pytest

from mlscli.io.plausibility.piles import pile, without_zeros
from mlscli.runtime.arrays import Float64

SCENE: Float64 = np.random.default_rng(2).uniform(-5, 5, (1000, 3))


def with_pile(share: float, place: tuple[float, float, float] = (0, 0, 0)) -> Float64:
    """Return the scene with this share of its points at one place, spread over the cloud."""
    points = SCENE.copy()
    points[np.random.default_rng(3).permutation(1000)[: round(1000 * share)]] = place
    return points


@pytest.mark.parametrize("share", [0.02, 0.25, 0.65, 1])
@pytest.mark.parametrize("zero", [0.0, -0.0])
def test_zeros_that_pile_up_are_no_measurements(share: float, zero: float) -> None:
    points = with_pile(share, (zero, 0, 0))
    found = without_zeros(points)

    assert found.value is not None
    assert found.value.tolist() == points.any(axis=1).tolist()
    assert "no measurements" in found.note


# The corners of a cube, each of which three sides of two triangles share; and a coarse grid.
CORNERS: Float64 = np.repeat(np.indices((2, 2, 2)).reshape(3, -1).T.astype(float), 5, axis=0)
GRID: Float64 = np.rint(SCENE[:, :3] / 4)


@pytest.mark.parametrize(
    "points",
    [
        np.concatenate((SCENE, np.zeros((1, 3)))),
        np.concatenate((SCENE[:20], np.zeros((2, 3)))),
        np.concatenate((SCENE, np.zeros((8, 3)))),
        SCENE * (0, 1, 1),
        CORNERS,
        GRID,
        np.empty((0, 3)),
    ],
)
def test_a_few_at_zero_or_many_that_coincide_alike_are_points(points: Float64) -> None:
    found = without_zeros(points)

    assert found.value is not None
    assert found.value.all()
    assert found.note == ""
    assert pile(points).note == ""


@pytest.mark.parametrize("share", [0.1, 0.5, 1])
def test_a_pile_anywhere_is_told_with_its_place(share: float) -> None:
    found = pile(with_pile(share, (1.5, -2, 0.25)))

    assert found.value == round(1000 * share)
    assert found.note == "points pile up at (1.5, -2, 0.25) exactly"
