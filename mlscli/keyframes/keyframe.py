"""Keyframes: a recording is a sequence of clouds, each with its time and the craft's position."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from mlscli.errors import UsageError, expect
from mlscli.runtime.arrays import Array, Float64

UNKNOWN_POSITION = (math.nan, math.nan, math.nan)

Axes: TypeAlias = Literal["camera", "body", "unknown"]
"""Whose axes an attitude is of: a camera's (x right, y down, z ahead), a body's (x ahead, z up)."""


def require_points(points: Array, argument: str) -> None:
    """Refuse what is no array of points.

    Parameters
    ----------
    points : (N, 3), of any numbers
    argument : str
        What errors call it.

    Raises
    ------
    TypeError
        Where it is no array.
    UsageError
        Where it has another shape, or holds no numbers.
    """
    expected = "points as an array of numbers (N, 3)"
    expect(points, np.ndarray, argument, expected)
    if points.ndim != 2 or points.shape[1] != 3 or points.dtype.kind not in "iuf":
        found = f"has shape {points.shape} and dtype {points.dtype}"
        raise UsageError(f"`{argument}`: {found}; expected {expected}")


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
    is_ranged : bool
        Whether a laser measured how far away the points are: they do not err as those do that are
        triangulated.
    """

    points: Float64
    stamp: float = math.nan
    position: tuple[float, float, float] = UNKNOWN_POSITION
    is_ranged: bool = False
