"""The account of a build: what became of the points, and where the time went."""

from __future__ import annotations

import time
from collections import Counter
from dataclasses import dataclass, field


@dataclass
class Report:
    """What became of the points, and where the time went.

    Attributes
    ----------
    points_read : int
        Points of the keyframes taken, before anything was dropped.
    dropped : Counter of str
        How many of them were dropped, by reason.
    batches : int
        Batches made.
    seconds : Counter of str
        Wall time (s) by step, summed over threads where the map is evaluated tile by tile.
    slowest_batch : float or None
        Wall time (s) of the batch that took longest; None where the map did not grow by batches.
    sizes : dict of str to str
        Why ``cell_size`` and ``gap_size`` were chosen, where they were ``auto``.
    doubts : list of str
        Where what was chosen is beyond reason, a line each.
    """

    points_read: int = 0
    dropped: Counter[str] = field(default_factory=Counter)
    batches: int = 0
    seconds: Counter[str] = field(default_factory=Counter)
    slowest_batch: float | None = None
    sizes: dict[str, str] = field(default_factory=dict)
    doubts: list[str] = field(default_factory=list)

    def drop(self, reason: str, points: int) -> None:
        """Count points dropped for a reason; negative: points that came back as the map grew."""
        if not points:
            return
        self.dropped[reason] += points
        if not self.dropped[reason]:
            del self.dropped[reason]

    def add(self, part: Report) -> None:
        """Add what a part of the work has dropped and chosen, and its time, but no other counts."""
        for reason, points in part.dropped.items():
            self.drop(reason, points)
        self.seconds.update(part.seconds)
        self.sizes |= part.sizes
        self.doubts += part.doubts

    def timed(self, what: str) -> Timed:
        """Return a context that adds the wall time of its block to ``seconds[what]``."""
        return Timed(self.seconds, what)


class Timed:
    """Measures the wall time of a block."""

    def __init__(self, seconds: Counter[str], what: str) -> None:
        self._seconds, self._what = seconds, what

    def __enter__(self) -> None:
        """Begin."""
        self._begin = time.perf_counter()

    def __exit__(self, *raised: object) -> None:
        """Add the time, even where the block raised."""
        self._seconds[self._what] += time.perf_counter() - self._begin  # type: ignore[assignment]
