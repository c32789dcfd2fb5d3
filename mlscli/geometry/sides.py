"""Which way along a vertical is up.

Each reason has a weight, the natural logarithm of how much more likely it makes one side than the
other. The weights are added, and the sum decides. Level surfaces count by their area, not by their
points: a ceiling that was seen better than the floor is no larger than it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mlscli.geometry.evidence import dots, level
from mlscli.geometry.surroundings import Planes
from mlscli.runtime.arrays import Float64, Int64

# Most recordings have z up or, in a camera's frame, y down, at most so much out of plumb, as
# cameras look down a little. Where y is plumb, though, it may as well be up, as in graphics.
_OUT_OF_PLUMB, _PLUMB = math.radians(25), math.radians(5)
_Z_UP, _Y_DOWN, _Y_PLUMB = 1.5, 1.1, 0.5
# Weights, where all of it speaks for one side: of a flight outside of all that was seen, of a
# flight above what is level, and of what is level in the lower half of the scene; and of all that,
# as it looks at the same surfaces.
_OUTSIDE, _ABOVE, _LOWER, _SCENE = 2.5, 1.0, 1.36, 2.5
# A pose is outside if at least this share of the points around it, and of the area of what is
# level, lies to one side of it.
_ALL, _ALL_LEVEL = 0.95, 0.9
# Level surfaces say less, in proportion, with less trust in all than this, or with a smaller share
# of the trust in all surfaces: of surfaces at any angle, some are level by chance.
_ENOUGH, _SHARE = 20.0, 0.05
# The least height that counts, as a share of the extent across.
_FLAT = 0.01
# The poses and points that are compared, at most; the points for each cell of area.
_POSES, _POINTS, _POINTS_PER_CELL = 200, 5000, 32
# A reason with less weight is not told; a sum that is less decides nothing, or is not certain.
_SLIGHT, _NOTHING, _UNCERTAIN = 0.3, 0.1, 0.5


class Reason(NamedTuple):
    """What speaks for one of the two directions along an axis.

    Attributes
    ----------
    weight : float
        Above 0 for the direction of the axis, below 0 for its opposite.
    why : str
        In words.
    """

    weight: float
    why: str


class Scene:
    """Points seen along an axis, which of them are level, and how far they extend.

    Parameters
    ----------
    surfaces : Planes
        The planes through the surroundings of N points.
    axis : float64 (3,)
        Unit vector.
    """

    def __init__(self, surfaces: Planes, axis: Float64) -> None:
        self._axis = axis
        self._across = np.linalg.svd(axis[np.newaxis])[2][1:]
        along = np.abs(dots(surfaces.normals, axis))
        self._level = surfaces.trust * level(along, 15, 30)
        self._standing = along < math.cos(math.radians(45))
        trusted, of_level = float(surfaces.trust.sum()), float(self._level.sum())
        self._weight = min(1.0, of_level / _ENOUGH, of_level / (_SHARE * trusted or 1.0))
        self._xy, self._heights = self._seen(surfaces.points)
        low, high = np.percentile(self._xy, [5, 95], axis=0)
        self._reach = float(np.hypot(*(high - low)))

    def _seen(self, points: Float64) -> tuple[Float64, Float64]:
        """Return positions across the axis (N, 2) and along it (N,)."""
        return dots(points, self._across), dots(points, self._axis)

    def reasons(self, route: Float64 | None) -> list[Reason]:
        """Return what the scene says, and a route (K, 3) through it."""
        reasons = [self.flown(route), self.lies()]
        total = abs(sum(reason.weight for reason in reasons))
        share = min(1.0, _SCENE / total) if total else 1.0
        return [reason._replace(weight=share * reason.weight) for reason in reasons]

    def flown(self, route: Float64 | None) -> Reason:
        """Return what a route (K, 3) says: a craft flies above the ground, and above what it sees.

        Within the scene, where points lie above it and below it, it says little.
        """
        known = np.empty((0, 3)) if route is None else route[np.isfinite(route).all(axis=1)]
        if not len(known):
            return Reason(0.0, "")
        xy, heights = self._seen(known[:: math.ceil(len(known) / _POSES)])
        outside = self._outside(xy, heights)
        middle = float(np.median(heights))
        lower = self._lower(middle, _FLAT * self._reach)
        above = max(lower, 1 - lower)
        where = "all around it" if abs(outside) > _SLIGHT else f"{above:.0%} of what is level"
        weight = max(_OUTSIDE * outside, _ABOVE * self._weight * (2 * lower - 1), key=abs)
        return Reason(weight, f"the craft flew above {where}")

    def lies(self) -> Reason:
        """Return what the scene says: ground is level, and what stands on it thins out upwards.

        Where nothing is known to be level, the ground is the side that is less rough.
        """
        low, high = np.percentile(self._heights, [5, 95]).tolist()
        if high - low < _FLAT * self._reach:
            return Reason(0.0, "")
        lower = self._lower((low + high) / 2, 0.0)
        of_level = self._weight * (2 * lower - 1)
        smoother = (1 - self._weight) * self._smoother()
        tail = _tail(self._heights[self._standing]) / 2
        share = max(lower, 1 - lower)
        _, why = max(
            (abs(of_level), f"{share:.0%} of what is level lies in the lower half of the scene"),
            (abs(smoother), "the scene is smoother below than above"),
            (abs(tail), "what is not level thins out upwards"),
        )
        return Reason(_LOWER * (of_level + smoother + tail), why)

    def _outside(self, xy: Float64, pose_heights: Float64) -> float:
        """Return the share of poses, (K, 2) and (K,), above all around them, less that below all.

        Some of it must lie rather beneath or above than beside: not so what a scanner sees whose
        beams are level.
        """
        sides = []
        heights, is_level = self._heights[:_POINTS], self._level[:_POINTS] > _SLIGHT
        cell, _ = self._cells(np.arange(len(heights)))
        for place, own in zip(xy, pose_heights, strict=True):
            away = np.hypot(*(self._xy[:_POINTS] - place).T)
            around = away <= self._reach / 2
            steep = around & (np.abs(heights - own) > away / 2)
            is_lower = heights < own
            for side, sign in ((is_lower, 1), (~is_lower, -1)):
                if (steep & side).any() and side[around].mean() >= _ALL:
                    those, others = (
                        len(np.unique(cell[around & is_level & some])) for some in (side, ~side)
                    )
                    if those >= _ALL_LEVEL * (those + others):
                        sides.append(sign)
        return sum(sides) / len(xy)

    def _lower(self, height: float, margin: float) -> float:
        """Return which share of the area of level surfaces is lower than a height; 0.5 of none."""
        counted = (self._level > _SLIGHT) & (np.abs(self._heights - height) >= margin)
        if not counted.any():
            return 0.5
        cell, _ = self._cells(np.flatnonzero(counted))
        is_lower = self._heights[counted] < height
        lower, upper = len(np.unique(cell[is_lower])), len(np.unique(cell[~is_lower]))
        return lower / (lower + upper)

    def _smoother(self) -> float:
        """Return how much smoother the lower ends of columns are than the upper ends, -1 to 1."""
        cell, side = self._cells(np.arange(len(self._heights)))
        order = np.lexsort((self._heights, cell))
        first = np.searchsorted(cell[order], np.arange(side * side + 1))
        count = np.diff(first)
        ends = np.full((2, side * side), np.nan)
        filled, spare = count > 3, count // 10
        ends[0, filled] = self._heights[order][(first[:-1] + spare)[filled]]
        ends[1, filled] = self._heights[order][(first[1:] - 1 - spare)[filled]]
        steps = [np.abs(np.diff(ends.reshape(2, side, side), axis=axis)) for axis in (1, 2)]
        both = np.concatenate([step.reshape(2, -1) for step in steps], axis=1)
        both = both[:, np.isfinite(both[0])]
        if not both.any():
            return 0.0
        low, high = np.median(both, axis=1).tolist()
        return float((high - low) / (high + low)) if high + low > 0 else 0.0

    def _cells(self, counted: Int64) -> tuple[Int64, int]:
        """Return the cell, seen along the axis, of each point counted, and the cells on a side."""
        xy = self._xy[counted]
        low, high = np.percentile(xy, [2, 98], axis=0)
        side = max(3, math.isqrt(len(xy) // _POINTS_PER_CELL))
        scaled = (xy - low) / np.where(high > low, high - low, 1.0)
        cells = (np.clip(scaled, 0, 1 - 1e-9) * side).astype(np.int64)
        return cells[:, 0] * side + cells[:, 1], side


def customary(axis: Float64) -> Reason:
    """Return what custom says: z is up, or y down."""
    near, plumb = math.cos(_OUT_OF_PLUMB), math.cos(_PLUMB)
    _, y, z = axis.tolist()
    if abs(z) > near:
        weight = math.copysign(_Z_UP, z)
    elif abs(y) > near:
        weight = math.copysign(_Y_PLUMB if abs(y) > plumb else _Y_DOWN, -y)
    else:
        weight = 0.0
    return Reason(weight, "most recordings have z up or y down")


def decide(reasons: Sequence[Reason]) -> tuple[float, str]:
    """Return the sum of the weights, 0 where it leaves the side open, and what speaks for it."""
    total = sum(reason.weight for reason in reasons)
    told = sorted(reasons, key=lambda reason: -abs(reason.weight))
    told = [reason for reason in told if abs(reason.weight) > _SLIGHT]
    pro = [reason.why for reason in told if (reason.weight > 0) == (total > 0)]
    contra = [reason.why for reason in told if (reason.weight > 0) != (total > 0)]
    if abs(total) <= _NOTHING or not pro:
        return 0.0, "which way along it is up is not known; that nearer to z up and y down is taken"
    why = ", and ".join(pro)
    if contra:
        why = f"{why}; for the opposite speaks that {', and '.join(contra)}"
    if abs(total) < _UNCERTAIN:
        why = f"{why}; which way along it is up is not certain"
    return total, why


def _tail(heights: Float64) -> float:
    """Return how much farther heights (N,) reach above their median than below it, from -1 to 1."""
    if not len(heights):
        return 0.0
    low, middle, high = np.percentile(heights, [10, 50, 90]).tolist()
    return float((high + low - 2 * middle) / (high - low)) if high > low else 0.0
