"""A glance at the beginning of sources: so many points, so much time, and no more is read."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any, TypeVar, cast

from mlscli.io.source import Cloud, Source, Wanted, everything

_T = TypeVar("_T")


class Glance:
    """How much of the sources of one recording is read, and whether that was all.

    Each pass over them, for clouds, transforms or poses, begins anew and is bounded alike. A file
    of points is read whole when it is opened; of its keyframes, too, only the first are taken.

    Parameters
    ----------
    points : int
        Keyframes are read until so many points have come.
    seconds : float
        Of wall time from the first message on, in which a pass begins to read another.

    Attributes
    ----------
    cut : bool
        Whether the last pass over clouds has left some unread.
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
        """Return a source that ends where the glance does; its sources are to be read in turn."""
        self._sources += 1
        return cast("Source", _Beginning(source, self, is_first=self._sources == 1))

    def begin(self) -> None:
        """Begin a pass."""
        self._left = self._points
        self._deadline = None

    def took(self, points: int) -> None:
        """Count points."""
        self._left -= points

    @property
    def is_over(self) -> bool:
        """Whether nothing more is to be read in this pass."""
        now = time.monotonic()
        if self._deadline is None:
            # A file of points is read before its first keyframe is asked about, however long
            # that takes.
            self._deadline = now + self._seconds
        return self._left <= 0 or now > self._deadline


class _Over(Exception):  # noqa: N818  # no error: it ends a pass from within
    pass


class _Beginning:
    """The beginning of a source; all but its passes is the source's own."""

    def __init__(self, source: Source, glance: Glance, *, is_first: bool) -> None:
        self._source = source
        self._glance = glance
        self._is_first = is_first

    def __getattr__(self, name: str) -> Any:
        return getattr(self._source, name)

    def clouds(self, wanted: Wanted = everything) -> Iterator[Cloud]:
        glance = self._glance
        if self._is_first:
            glance.begin()
            glance.cut = False

        def asked(stamp: float) -> bool:
            # Asked of unwanted messages, too: a start far into the flight is not waited for.
            if glance.is_over:
                raise _Over
            return wanted(stamp)

        try:
            for cloud in self._source.clouds(asked):
                glance.took(len(cloud.points))
                yield cloud
        except _Over:
            glance.cut = True

    def transforms(self) -> Iterator[Any]:
        return self._while_time(self._source.transforms())

    def poses(self, topic: str) -> Iterator[Any]:
        return self._while_time(self._source.poses(topic))

    def _while_time(self, told: Iterator[_T]) -> Iterator[_T]:
        if self._is_first:
            self._glance.begin()
        for each in told:
            yield each
            if self._glance.is_over:
                self._glance.poses_cut = True
                return
