"""Coordinates that were stored in float32 far from 0.

How these tests could be cheated: by doubting whatever is large or whole, so rasters of half and of
whole metres, and what float32 holds well, must pass.
"""

from __future__ import annotations

import numpy as np
import pytest

from mlscli.io.plausibility.rounding import lost_step
from mlscli.runtime.arrays import Float64

POINTS = np.random.default_rng(1).uniform(0, 40, (500, 3))
UTM = np.array([356_000.0, 5_572_094.0, 100.0])


def raster(step: float, begin: float) -> Float64:
    x, y = (axis.ravel() for axis in np.mgrid[0:20:step, 0:20:step])
    return np.asarray(np.column_stack((x + begin, y + begin, np.sin(x) * 3)) + UTM)


def test_a_northing_in_float32_has_lost_its_digits() -> None:
    assert lost_step((POINTS + UTM).astype(np.float32).astype(float)) == 0.5


@pytest.mark.parametrize(
    "points",
    [
        POINTS + UTM,
        POINTS.astype(np.float32).astype(float),
        raster(1, 0), raster(1, 0.5), raster(0.5, 0), raster(2, 0.25),
        POINTS[:9] + UTM, np.empty((0, 3)), np.full((50, 3), np.nan), np.full((50, 3), 1e300),
        np.zeros((50, 3)),
    ],
)  # fmt: skip
def test_others_have_not(points: Float64) -> None:
    assert lost_step(points) == 0
