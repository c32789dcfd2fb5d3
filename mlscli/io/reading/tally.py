"""What a pass over a recording has read, and why points were dropped."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

NO_RETURN, UNPLACED = "no return", "no transform at their time"
"""Why points are dropped: a sensor without an echo says (0, 0, 0), which is where it is itself."""


@dataclass
class Tally:
    """What a pass has read so far.

    Attributes
    ----------
    points_read : int
        Points in the keyframes selected, before any is dropped.
    dropped : dict
        How many points were dropped, by reason.
    keyframes : int
        Keyframes selected.
    unplaced : int
        How many of them are left out, as it is not known where they were.
    came : int
        Keyframes, selected or not.
    began : float
        The time of the first of these.
    timed : bool
        Whether one of these had a time other than 0.
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
