"""The score of patches that a stage has drawn out or moved beyond their points.

How one could cheat: count what was drawn out as measured, or leave it out of the whole as well.
"""

from __future__ import annotations

import numpy as np

from mlscli.scoring import score
from tests.helpers.maps import map_of
from tests.scoring.test_score import flat, the_share, wall


def test_of_a_measured_patch_only_what_lies_within_its_points_was_seen() -> None:
    true = [wall(0.0, 3.0), flat(1.0, 5)]
    seen = map_of([wall(1.0, 2.0), flat(3.0, 5)])
    drawn = seen.with_columns(height=np.array([3.0, 1.0]), depth=np.array([3.0, 0.0]))
    result = score(drawn, map_of(true))
    assert result.total.completeness == the_share(2, 2)
    assert result.total.correctness == the_share(2, 2)
    assert result.by_origin["measured"].completeness == the_share(0, 2)
    assert result.by_origin["measured"].correctness == the_share(1, 2)
    assert score(seen, map_of(true)).by_origin["measured"] == result.by_origin["measured"]
