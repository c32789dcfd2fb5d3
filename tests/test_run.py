"""What `benchmarks/run.py` times beside the program does the same work.

How one could cheat: compare with something that does more, or less, than is asked for.
"""

from __future__ import annotations

import numpy as np

from benchmarks.run import CELL, GAP, MEDIAN, Row, cloud, packed_groups, tree_median
from mlscli.pipeline.grouping import group


def test_what_is_compared_gives_the_same_medians_and_patches() -> None:
    points = cloud(3000, 4.0)
    mine = MEDIAN.apply(points, CELL).xyz[:, 2]
    assert 1000 < len(mine) < 3000
    np.testing.assert_array_equal(mine, tree_median(points.xyz))
    surface = group(points, CELL, GAP, CELL)
    top, mean, variance = packed_groups(points.xyz)
    np.testing.assert_array_equal(surface.top, top)
    np.testing.assert_allclose(surface.mean, mean, atol=1e-9)
    np.testing.assert_allclose(surface.variance, variance, atol=1e-9)


def test_a_level_is_missed_where_the_ratio_or_the_rate_is_too_low() -> None:
    assert Row("", 30.0, 10.0, 3.0, 25.0).cells()[-1] == "reached"
    assert Row("", 30.0, 10.1, 3.0, 25.0).cells()[-1] == "MISSED"
    assert Row("", 24.9, 1.0, 3.0, 25.0).cells()[-1] == "MISSED"
    assert Row("", 24.9).cells()[-1] == ""
