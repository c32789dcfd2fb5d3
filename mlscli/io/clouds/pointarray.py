"""Points that are in memory already, as an array."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mlscli.io.clouds.pointfile import Content, PointFile
from mlscli.io.source import Cloud
from mlscli.keyframes.keyframe import require_points
from mlscli.runtime.arrays import Array


class PointArray(PointFile):
    """An array of points as a source: one keyframe without a time.

    Parameters
    ----------
    points : (N, 3), of any numbers
        Copied, as float64; what is masked is no measurement (NaN).

    Raises
    ------
    UsageError
        It has another shape, or holds no numbers.
    """

    kind = "array"

    def __init__(self, points: Array) -> None:
        super().__init__(Path("array"))
        require_points(points, "sources")
        self._points = np.ma.filled(np.ma.array(points, dtype=np.float64, copy=True), np.nan)

    def _read(self) -> Content:
        return Content([Cloud(self._points)])
