"""What the attitudes of cameras, or of a craft, say about the vertical.

- A *camera* (x right, y down, z ahead) is held upright: its x is level, whichever way it looks and
  however far up or down. Most look ahead, some straight down, and hardly any far up.
- A *body* (x ahead, y left, z up: REP 103 of ROS) hardly tilts.

Attitudes whose axes are not known may be those of a camera, also one turned by a quarter, or of a
body, or of anything that turns about the vertical and keeps its tilt. Each of these is tried, and
the most likely counts.
"""

from __future__ import annotations

import math

import numpy as np

from mlscli.geometry.poses import matrices
from mlscli.keyframes.keyframe import Axes
from mlscli.runtime.arrays import Bool, Float64

# The usual tilt of a craft, and roll of a camera, in radians.
_TILT = math.radians(12)
_ROLL = math.radians(6)
# How far up or down the cameras of a flight usually look, and the share of flights on which they
# look straight down, all but so much: cameras of one flight are much alike, and count once.
_PITCH, _DOWN, _ALL_BUT = math.radians(25), 0.15, math.radians(15)
# The least likelihood of one attitude: of so many, one is not as it should be.
_ODD = 0.02
# So many attitudes count, at most: those that follow one another are much alike.
_COUNTED = 10
_EVALUATED = 300
# The shares of what attitudes are expected to be, by what is known of their axes.
_SHARES: dict[Axes, dict[str, float]] = {
    "camera": {"camera": 0.94, "turned left": 0.03, "turned right": 0.03},
    "body": {"body": 1.0},
    "unknown": {
        "camera": 0.47, "body": 0.47, "turned left": 0.02, "turned right": 0.02, "steady": 0.02,
    },
}  # fmt: skip
# Which of its axes, and with which sign, point right and down as an upright camera's.
_RIGHT_AND_DOWN = {
    "camera": ((0, 1), (1, 1)),
    "turned right": ((1, -1), (0, 1)),
    "turned left": ((1, 1), (0, -1)),
}

_HELD = {
    "camera": "the cameras were held upright",
    "turned left": "the cameras were held upright, turned by a quarter",
    "turned right": "the cameras were held upright, turned by a quarter",
    "body": "the craft kept upright",
    "steady": "the craft kept its tilt",
}
_MEANT = {
    "camera": "a camera's (x right, y down)",
    "turned left": "a camera's (x right, y down)",
    "turned right": "a camera's (x right, y down)",
    "body": "a body's (z up)",
    "steady": "neither a camera's nor a body's",
}


def known_of(attitudes: Float64 | None) -> Bool:
    """Return which attitudes (K, 4) are known, bool (K,): quaternions of a length above 0."""
    if attitudes is None:
        return np.empty(0, dtype=np.bool_)
    return np.asarray(np.linalg.norm(attitudes, axis=1) > 0)


def likelihoods(attitudes: Float64 | None, axes: Axes, directions: Float64) -> Float64:
    """Return how likely attitudes are where each direction is up: natural logarithms, at most 0.

    Parameters
    ----------
    attitudes : float64 (K, 4) or None
        Quaternions x y z w from the axes of the craft, or its camera; NaN where not known.
    axes : {"camera", "body", "unknown"}
        Which axes these are.
    directions : float64 (D, 3)
        Unit vectors.

    Returns
    -------
    float64 (D,)
        0 where no attitude is known.
    """
    kinds = _by_kind(attitudes, axes, directions)
    if not kinds:
        return np.zeros(len(directions))
    return np.asarray(np.logaddexp.reduce(list(kinds.values())))


def taken_as(attitudes: Float64 | None, axes: Axes, directions: Float64) -> str:
    """Return what attitudes are where one of some directions is up, in words; empty: none is known.

    Parameters are those of `likelihoods`.
    """
    kinds = _by_kind(attitudes, axes, directions)
    if not kinds:
        return ""
    kind = max(kinds, key=lambda name: float(kinds[name].max()))
    if axes != "unknown":
        return _HELD[kind]
    return f"{_HELD[kind]}, if the axes of its attitudes are {_MEANT[kind]}"


def _by_kind(attitudes: Float64 | None, axes: Axes, directions: Float64) -> dict[str, Float64]:
    """Return for each kind of thing that the attitudes can be of how likely directions are up."""
    known = known_of(attitudes)
    if attitudes is None or not known.any():
        return {}
    turns = matrices(attitudes[known])
    counted = min(len(turns), _COUNTED)
    turns = turns[:: math.ceil(len(turns) / _EVALUATED)]
    # Each direction as each attitude sees it: its x, y and z, (3, K, D).
    seen = np.einsum("kij,di->jkd", turns, directions)
    return {
        kind: math.log(share) + _as(kind, seen, counted) for kind, share in _SHARES[axes].items()
    }


def _as(kind: str, seen: Float64, counted: int) -> Float64:
    """Return how likely directions (3, K, D) are up if seen by that kind of thing, float64 (D,)."""
    if kind == "body":
        return _together(np.exp((seen[2] - 1) / _TILT**2), counted)
    # The mean of unit vectors is shorter than 1 by half the mean square of the angles between them
    # and their mean.
    steady = (np.linalg.norm(seen.mean(axis=1), axis=0) - 1) / _TILT**2
    if kind == "steady":
        return np.asarray(steady * counted, dtype=np.float64)
    (right, right_sign), (down, down_sign) = _RIGHT_AND_DOWN[kind]
    across, below, ahead = right_sign * seen[right], down_sign * seen[down], seen[2]
    level = np.exp(-((across / _ROLL) ** 2) / 2)
    upside_down = _ramp(below, 0.1, 0.35)
    far_up = _ramp(ahead, 0.77, 0.94)
    one = level * (1 - upside_down) * (1 - far_up)
    pitch = np.arcsin(np.clip(ahead, -1, 1))
    level_sight = math.log(1 - _DOWN) - (pitch / _PITCH) ** 2 / 2
    straight_down = math.log(_DOWN) - ((pitch + math.pi / 2) / _ALL_BUT) ** 2 / 2
    sight = np.logaddexp(level_sight, straight_down).mean(axis=0)
    return np.asarray(_together(one, counted) + steady + sight)


def _together(likelihood: Float64, counted: int) -> Float64:
    """Return the logarithm for all attitudes of the likelihood of each (K, D)."""
    return np.asarray(np.log(np.maximum(likelihood, _ODD)).mean(axis=0) * counted)


def _ramp(values: Float64, zero: float, one: float) -> Float64:
    return np.asarray(np.clip((values - zero) / (one - zero), 0, 1))
