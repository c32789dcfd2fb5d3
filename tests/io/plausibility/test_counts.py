"""How many points a file holds, whatever its header declares.

How these tests could be cheated: by looking at what follows the points as a whole, where points
outnumber what lies before them. So headers of a file's length stand between points, and a header
that is not corrected stands before points that go on.
"""

from __future__ import annotations

import numpy as np
import pytest

from mlscli.io.plausibility.counts import count_of
from mlscli.runtime.arrays import Float64

HEADER = (
    b"# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\n"
    b"TYPE F F F\nCOUNT 1 1 1\nWIDTH 300\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 300\n"
    b"DATA binary\n"
)


def scene(count: int, seed: int = 1) -> Float64:
    return np.random.default_rng(seed).uniform(-9, 9, (count, 3))


@pytest.mark.parametrize("count", [1, 20, 5000])
def test_points_that_another_header_precedes_are_not_taken_for_more_of_the_first_ones(
    count: int,
) -> None:
    padded = HEADER + bytes(-len(HEADER) % 12)
    header = np.frombuffer(padded, "<f4").reshape(-1, 3).astype(float)

    found = count_of(np.concatenate([scene(300), header, scene(count, 2)]), 300)

    assert found.value is None
    assert "what follows the 300 points" in found.refusal


@pytest.mark.parametrize("outliers", [1, 30])
def test_points_that_go_on_are_taken_with_the_outliers_among_them(outliers: int) -> None:
    more = scene(5000, 2)
    more[:: 5000 // outliers] = 1e12

    found = count_of(np.concatenate([scene(300), np.zeros((20, 3)), more]), 300)

    assert found.value == 5320
    assert "declares 300 points, and there are 5,320" in found.note
