"""Read only the beginning of sources, up to a number of points and a time limit."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import Any, TypeVar, cast

from mlscli.io.source import Cloud, PassOver, Source, Wanted, everything

_T = TypeVar("_T")


class Glance:
    """The limits up to which the sources of one recording are read, and whether they were reached.

    They hold for each pass, over clouds, transforms or poses. A file of points is always read
    whole, but of its keyframes, too, only the first are taken.

    Parameters
    ----------
    points : int
        A pass over clouds ends when this number of points has been read.
    seconds : float
        A pass ends when this wall time has passed since its first message.

    Attributes
    ----------
    cut : bool
        Whether the last pass over clouds left some unread.
    poses_cut : bool
        Whether transforms or poses were left unread.
    """

    def __init__(self, points: int = 200_000, seconds: float = 2.0) -> None:
        self.cut = self.poses_cut = False
        self._points, self._seconds = points, seconds
        self._left = 0
        self._deadline: float | None = None
        self._sources = 0

    def of(self, source: Source) -> Source:
        """Return a source that ends at the limits; read sources in the order of these calls."""
        self._sources += 1
        return cast("Source", _Beginning(source, self, is_first=self._sources == 1))

    def begin(self) -> None:
        """Begin a pass."""
        self._left = self._points
        self._deadline = None

    def took(self, points: int) -> None:
        """Count points that have been read."""
        self._left -= points

    @property
    def is_over(self) -> bool:
        """Whether nothing more is to be read in this pass."""
        now = time.monotonic()
        if self._deadline is None:
            # The time begins here: a file of points is read whole before its first keyframe,
            # however long that takes.
            self._deadline = now + self._seconds
        return self._left <= 0 or now > self._deadline


class _Beginning:
    """A source whose passes end at the limits of a glance; all else is that of the source."""

    def __init__(self, source: Source, glance: Glance, *, is_first: bool) -> None:
        self._source = source
        self._glance = glance
        self._is_first = is_first

    def __getattr__(self, name: str) -> Any:
        return getattr(self._source, name)

    def clouds(self, wanted: Wanted = everything) -> Iterator[Cloud]:
        asked = self._begin(wanted)
        with suppress(PassOver):
            for cloud in self._source.clouds(asked):
                self._glance.took(len(cloud.points))
                yield cloud

    def latest(self, wanted: Wanted = everything) -> Sequence[Cloud]:
        # The limit of points does not matter here: one message is decoded.
        return self._source.latest(self._begin(wanted))

    def _begin(self, wanted: Wanted) -> Wanted:
        """Begin a pass over clouds, and return what ends it."""
        glance = self._glance
        if self._is_first:
            glance.begin()
            glance.cut = False

        def asked(stamp: float, logged: float = math.nan) -> bool:
            # Unwanted messages count, too: a start far into the flight is not waited for.
            if glance.is_over:
                glance.cut = True
                raise PassOver
            return wanted(stamp, logged)

        return asked

    def transforms(self) -> Iterator[Any]:
        return self._while_time(self._source.transforms())

    def poses(self, topic: str) -> Iterator[Any]:
        return self._while_time(self._source.poses(topic))

    def _while_time(self, poses: Iterator[_T]) -> Iterator[_T]:
        if self._is_first:
            self._glance.begin()
        for each in poses:
            yield each
            if self._glance.is_over:
                self._glance.poses_cut = True
                return
