"""Which keyframes of a recording to take, by time and every N-th; and the crop of points."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from mlscli.errors import UsageError
from mlscli.io.plausibility.epochs import Elapsed
from mlscli.io.source import Wanted

_RELATIVE_BELOW = 1e8
"""Times (s) below this count from the first keyframe; as time stamps they would end in 1973."""


@dataclass(frozen=True)
class Selection:
    """Which keyframes and points to take; checked on construction.

    Attributes
    ----------
    start, end : float or None
        Times in seconds, inclusive; below 1e8 they count from the first keyframe, in the order of
        recording, also where the clock jumps.
    every : int
        Of the keyframes between, take the first and every N-th after it.
    crop : six floats or None
        xmin, xmax, ymin, ymax, zmin, zmax in the map frame, inclusive.

    Raises
    ------
    UsageError
        A value is out of range.
    """

    start: float | None = None
    end: float | None = None
    every: int = 1
    crop: Sequence[float] | None = None

    def __post_init__(self) -> None:
        for argument, time in (("start", self.start), ("end", self.end)):
            if time is not None and math.isnan(time):
                raise UsageError(f"`{argument}` {time}: expected seconds")
        if self.start is not None and self.end is not None:
            same_clock = (self.start < _RELATIVE_BELOW) == (self.end < _RELATIVE_BELOW)
            if same_clock and self.start > self.end:
                raise UsageError(f"`start` {self.start} is after `end` {self.end}")
        if self.every < 1:
            raise UsageError(f"`every` {self.every}: expected a whole number of at least 1")
        if self.crop is not None:
            _check_crop(self.crop)

    @property
    def by_time(self) -> bool:
        """Whether keyframes are chosen by time: `start` or `end` is given."""
        return self.start is not None or self.end is not None

    def duration(self, first: float, last: float) -> float:
        """Return how many seconds are selected of a recording from the time `first` to `last`.

        NaN where these are not known (NaN), unless `start` and `end` are both time stamps.
        """
        start = _absolute(self.start, first, first)
        end = _absolute(self.end, first, last)
        return max(min(end, last) - max(start, first), 0.0)

    def chooser(self, elapsed: Elapsed | None = None) -> Wanted:
        """Return a function that chooses by time; the first stamp passed to it is the beginning.

        Parameters
        ----------
        elapsed : Elapsed, optional
            It is told of all that come, chosen or not.

        Raises
        ------
        UsageError
            From that function, where `start` or `end` is given and a stamp is NaN.
        """
        clock = Elapsed() if elapsed is None else elapsed

        def wanted(stamp: float, logged: float = math.nan) -> bool:
            clock.come(stamp, logged)
            if not self.by_time:
                return True
            if math.isnan(stamp):
                raise UsageError("`start`, `end`: the recording has no time stamps to go by")
            start = _absolute(self.start, clock.zero, -math.inf)
            end = _absolute(self.end, clock.zero, math.inf)
            return start <= stamp <= end

        return wanted


def _absolute(time: float | None, beginning: float, default: float) -> float:
    if time is None:
        return default
    return beginning + time if time < _RELATIVE_BELOW else time


def _check_crop(crop: Sequence[float]) -> None:
    given = f"`crop` {','.join(f'{bound:g}' for bound in crop)}"
    if len(crop) != 6 or any(math.isnan(bound) for bound in crop):
        raise UsageError(f"{given}: expected six numbers xmin,xmax,ymin,ymax,zmin,zmax")
    for axis, low, high in zip("xyz", crop[::2], crop[1::2], strict=True):
        if low > high:
            raise UsageError(f"{given}: {axis}min {low:g} is above {axis}max {high:g}")
