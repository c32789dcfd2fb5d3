"""Places from all over a list: one in each part, and not in regular steps."""

from __future__ import annotations

import numpy as np
import pytest

from mlscli.io.plausibility.places import spread


@pytest.mark.parametrize(("count", "size"), [(7, 7), (1_000, 64), (1_001, 1_000)])
def test_places_are_one_in_each_part_of_a_list(count: int, size: int) -> None:
    places = spread(count, size)
    parts = np.arange(size + 1) * count / size
    assert len(places) == size
    assert (places >= np.floor(parts[:-1])).all()
    assert (places < parts[1:]).all()
    assert places.max() < count


def test_places_are_not_in_regular_steps() -> None:
    assert len(np.unique(np.diff(spread(64_000, 1_000)))) > 50
