"""What a pass over a recording has read, and why points were dropped."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

from mlscli.io.plausibility.epochs import told
from mlscli.words import are, some

NO_RETURN, REPEATED, NOT_FINITE, BEYOND = "no return", "repeated", "not finite", "beyond 1e8"
"""Reasons to drop points; a sensor without an echo reports its own position, (0, 0, 0)."""

UNPLACED, IN_GAP = "no transform at their time", "within a gap of the transforms"
FRAMELESS, UNCONNECTED = "in no frame, unlike others", "no transform from their frame"
"""Reasons to leave out a keyframe whose place in the map frame is not known."""

_LATEST = 16
"""So many keyframes at the end tell what the clock says there."""

_FEWEST = 3
"""So many keyframes at 0 are not the beginnings of several sources."""

_WHY = {
    UNPLACED: "where they were is not known at their times",
    IN_GAP: "they fall into a gap of the transforms or poses; `pose_gap` says how long one may be",
    FRAMELESS: "they state no frame, and others of their topic do",
    UNCONNECTED: "no transform leads from their frame to the map frame",
}


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
    left_out : dict of str to int
        How many selected keyframes are left out, as their poses are not known, by reason.
    came : int
        Keyframes read, selected or not.
    began : float
        Stamp of the first keyframe read, in seconds; NaN before it.
    stampless : int
        Keyframes read whose stamp is 0.
    jumps : list of (float, float)
        What the clock said before and after each jump, in seconds.
    times : list of (float, float)
        The stamps of the first keyframes read, and when they were recorded, in seconds.
    latest : deque of (float, float)
        The same of the last ones.
    zeros : int
        Points dropped at exactly (0, 0, 0), though not in a sensor's frame.
    pile : str
        Where points pile up otherwise; empty where none were seen to.
    step : float
        To how much a coordinate of the first clouds was rounded, in the unit of the recording.
    """

    points_read: int = 0
    dropped: dict[str, int] = field(default_factory=dict)
    keyframes: int = 0
    left_out: dict[str, int] = field(default_factory=dict)
    came: int = 0
    began: float = math.nan
    stampless: int = 0
    jumps: list[tuple[float, float]] = field(default_factory=list)
    times: list[tuple[float, float]] = field(default_factory=list)
    latest: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=_LATEST))
    zeros: int = 0
    pile: str = ""
    step: float = 0.0

    @property
    def has_times(self) -> bool:
        """Whether keyframes read have stamps."""
        return any(math.isfinite(stamp) for stamp, _ in self.times)

    @property
    def unplaced(self) -> int:
        """Selected keyframes that are left out, as their poses are not known."""
        return sum(self.left_out.values())

    def leave_out(self, reason: str, points: int) -> None:
        """Count a keyframe that is left out, and its points, under a reason."""
        self.left_out[reason] = self.left_out.get(reason, 0) + 1
        self.drop(reason, points)

    def notes(self) -> Iterator[str]:
        """Yield what the user should know about which keyframes and points came."""
        for reason, count in self.left_out.items():
            of = some(self.keyframes, "keyframe")
            yield f"{count:,} of {of} {are(count)} left out: {_WHY[reason]}"
        if self.jumps:
            yield (
                f"the clock of the clouds jumps {told(self.jumps)}; `start` and `end` count on by "
                "the times of recording, and no pose before a jump counts after it"
            )
        if _FEWEST <= self.stampless < self.came:
            yield (
                f"{self.stampless:,} of {some(self.came, 'keyframe')} have the time 0, as before a "
                "clock is set; `start` and `end` take it as it is"
            )
        if self.zeros:
            yield f"{self.zeros:,} points pile up at exactly (0, 0, 0): no measurements, dropped"
        beyond = self.dropped.get(BEYOND, 0)
        if beyond > self.points_read / 2:
            yield (
                f"{beyond:,} of {some(self.points_read, 'point')} are dropped, as they lie beyond "
                "1e8: these are hardly coordinates, and what is left of them may be none either"
            )
        if self.pile:
            yield f"{self.pile}: no measurements, perhaps; all are taken"

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
