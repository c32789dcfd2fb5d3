"""Keyframes: a recording is a sequence of clouds, each with its time and the craft's position."""

from __future__ import annotations

import math
from dataclasses import dataclass

from mlscli.runtime.arrays import Float64

FARTHEST = 1e8
"""The greatest absolute value of a coordinate; a point with a greater one is no measurement."""

UNKNOWN_POSITION = (math.nan, math.nan, math.nan)


@dataclass(frozen=True, eq=False)
class Keyframe:
    """A cloud in the map frame, with the time and the position from which it was seen.

    Attributes
    ----------
    points : float64 (N, 3)
        Coordinates in the unit of the recording, z up, all finite; never -0.0.
    stamp : float
        Time in seconds; NaN where not known.
    position : tuple of float
        x, y, z of the craft in the map frame; NaN where not known.
    """

    points: Float64
    stamp: float = math.nan
    position: tuple[float, float, float] = UNKNOWN_POSITION
