"""What a pass over a recording has read, and why points were dropped."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field

NO_RETURN, UNPLACED, REPEATED = "no return", "no transform at their time", "repeated"
NOT_FINITE = "not finite"
"""Reasons to drop points; a sensor without an echo reports its own position, (0, 0, 0)."""


@dataclass
class Tally:
    """What a pass has read so far.

    Attributes
    ----------
    points_read : int
        Points in the keyframes selected, before any is dropped.
    dropped : dict of str to int
        How many points were dropped, by reason.
    keyframes : int
        Keyframes selected.
    unplaced : int
        Selected keyframes that are left out, as their poses are not known.
    came : int
        Keyframes read, selected or not.
    began : float
        Stamp of the first keyframe read, in seconds; NaN before it.
    timed : bool
        Whether a keyframe read has a stamp other than 0.
    """

    points_read: int = 0
    dropped: dict[str, int] = field(default_factory=dict)
    keyframes: int = 0
    unplaced: int = 0
    came: int = 0
    began: float = math.nan
    timed: bool = False

    def drop(self, reason: str, points: int) -> None:
        """Count dropped points under a reason."""
        if points:
            self.dropped[reason] = self.dropped.get(reason, 0) + points

    def tell(self, reasons: Iterable[tuple[str, int]]) -> None:
        """Count points that were dropped as not finite under the reasons why they are so."""
        for reason, points in reasons:
            self.dropped[NOT_FINITE] -= points
            self.drop(reason, points)
            if not self.dropped[NOT_FINITE]:
                del self.dropped[NOT_FINITE]
