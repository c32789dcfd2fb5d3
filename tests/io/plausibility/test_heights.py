"""Heights that stand for none, as rasters have them.

How these tests could be cheated: by doubting all that is low, or all that is the same. So there are
seas that lie level, pits, and a scene at that height.
"""

from __future__ import annotations

import numpy as np
import pytest

from mlscli.io.plausibility.heights import have_heights
from mlscli.runtime.arrays import Float64


def scene(fill: float, share: float, height: float = 120.0) -> Float64:
    """Return hills of which a share of the points, in one corner, has this z."""
    points = np.random.default_rng(2).uniform(0, 40, (1000, 3))
    points[:, 2] += height
    points[: round(1000 * share), 2] = fill
    return points


@pytest.mark.parametrize("fill", [-9999, -32768, -99999, 9999])
@pytest.mark.parametrize("share", [0.005, 0.3, 0.95])
def test_values_that_rasters_have_for_none_are_told(fill: float, share: float) -> None:
    note = have_heights(scene(fill, share)).note

    assert f"z of {share:.0%} of the points looked at is {fill} exactly" in note


@pytest.mark.parametrize(
    "points",
    [
        scene(0, 0.3),
        scene(-9999, 0.002),  # two strays
        scene(-9999, 1),
        scene(-9999, 0.3, height=-10040.0),  # a trench, in metres
        scene(-500, 0.3),
        np.array([[0, 0, 1e308], [0, 0, -1e308], *[[0, 0, -9999]] * 8]),
    ],
)
def test_other_heights_are_heights(points: Float64) -> None:
    assert not have_heights(points).note
