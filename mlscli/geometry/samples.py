"""A sample of points that are drawn without a look at the others, in no time.

Which points are taken depends on their order and on nothing else: the same stream always leaves the
same points. Where order may not count, nor how often a point comes, there is
`mlscli.geometry.surroundings.PointSample`, which looks at each.
"""

from __future__ import annotations

import numpy as np

from mlscli.runtime.arrays import Float64, Int64

# So many draws are made at once. The least share, as a logarithm, and the last number: after as
# many points nothing more is drawn.
_DRAWS, _LEAST, _LAST = 1024, -60.0, 2.0**62


class Reservoir:
    """A bounded sample of the points that come, each as likely as any other.

    What comes in is drawn beforehand: algorithm L of K.-H. Li, *Reservoir-sampling algorithms of
    time complexity O(n(1 + log(N/n)))*, 1994, https://doi.org/10.1145/198429.198435.

    Parameters
    ----------
    size : int
        The most points that are kept.
    """

    def __init__(self, size: int) -> None:
        self._points = np.empty((size, 3))
        self._came = 0
        self._chance = np.random.default_rng(0)
        # The logarithm of the share that is still drawn, and the number of the last point drawn.
        self._share, self._number = 0.0, float(size - 1)
        # The points that will be drawn, by number, and in whose places they come.
        self._next, self._places = np.empty(0), np.empty(0, dtype=np.int64)

    def add(self, points: Float64) -> None:
        """Take points, float64 (N, 3), finite."""
        begin, end, size = self._came, self._came + len(points), len(self._points)
        if begin < size:
            self._points[begin:end] = points[: size - begin]
        self._came = end
        if end > size:
            for numbers, places in self._drawn(end):
                # Of several that come into one place, the last one stays.
                self._points[places] = points[numbers - begin]

    @property
    def points(self) -> Float64:
        """The sample, float64 (M, 3)."""
        return self._points[: self._came]

    def _drawn(self, end: int) -> list[tuple[Int64, Int64]]:
        """Return the points drawn that come before number `end`, and in whose places they come."""
        drawn = []
        while True:
            count = int(np.searchsorted(self._next, end))
            if count:
                drawn.append((self._next[:count].astype(np.int64), self._places[:count]))
                self._next, self._places = self._next[count:], self._places[count:]
            if len(self._next):
                return drawn
            self._draw()

    def _draw(self) -> None:
        """Draw the next points."""
        shares = self._share + np.cumsum(np.log(self._numbers()) / len(self._points))
        skipped = np.floor(np.log(self._numbers()) / np.log1p(-np.exp(np.maximum(shares, _LEAST))))
        self._next = np.minimum(self._number + np.cumsum(skipped + 1), _LAST)
        self._places = self._chance.integers(len(self._points), size=_DRAWS)
        self._share, self._number = float(shares[-1]), float(self._next[-1])

    def _numbers(self) -> Float64:
        """Return numbers by chance, above 0 and up to 1, (`_DRAWS`,)."""
        return 1.0 - self._chance.random(_DRAWS)
