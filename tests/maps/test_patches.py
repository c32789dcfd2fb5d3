"""Intervals of height that belong together.

How one could cheat: intervals that lie within others; a gap of exactly the size; the last cell, and
cells without any interval.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from mlscli.maps.patches import linked


def groups(intervals: list[tuple[float, float]], gap_size: float) -> list[int]:
    """Return where groups begin among intervals of one cell, by all pairs before each."""
    return [
        i
        for i, (low, _) in enumerate(intervals)
        if not any(low - high <= gap_size for _, high in intervals[:i])
    ]


def test_intervals_are_linked_across_no_gap_and_no_cell() -> None:
    rng = np.random.default_rng(4)
    seen = set()
    for _ in range(60):
        sizes = rng.integers(0, 5, 6)
        cells = np.concatenate(([0], np.cumsum(sizes)))
        # Multiples of a half: many gaps are exactly of the size.
        low = rng.integers(-6, 6, cells[-1]) / 2
        for begin, end in pairwise(cells):
            low[begin:end].sort()
        high = low + rng.integers(0, 6, cells[-1]) / 2
        expected = []
        for begin, end in pairwise(cells):
            intervals = list(zip(low[begin:end].tolist(), high[begin:end].tolist(), strict=True))
            expected += [int(begin) + i for i in groups(intervals, 1.0)]
        assert linked(cells, low, high, 1.0).tolist() == [*expected, len(low)]
        seen.add(len(low) - len(expected))
    assert len(seen) > 5
