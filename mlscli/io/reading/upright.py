"""Turn points as recorded so that z points up, and then onto another map, if asked for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from mlscli.geometry.poses import turn
from mlscli.geometry.up import UP_AXES, Up, axes_matrix, axis_named, describe, nearest_axis
from mlscli.io.reading.transform import Transform
from mlscli.runtime.arrays import Float64


@dataclass(frozen=True, eq=False)
class Upright:
    """The turn of points and positions after which z points up.

    Attributes
    ----------
    up : str
        Which direction of the recording points up: an axis, or the direction that was found.
    matrix : float64 (4, 4)
        The turn, for homogeneous coordinates: T_map_recording.
    then : Transform or None
        What follows it.
    """

    up: str
    matrix: Float64
    _turn: Callable[[Float64], Float64]
    then: Transform | None = None

    @classmethod
    def along(cls, up: str) -> Upright:
        """Return the rotation after which an axis of `UP_AXES` points up."""
        matrix = _with_shift(axes_matrix(up), np.zeros(3))
        if up == "z":
            return cls(up, matrix, lambda points: points)
        axes, signs = UP_AXES[up]
        return cls(up, matrix, lambda points: np.take(points, axes, axis=1) * signs)

    @classmethod
    def found(cls, up: Up) -> Upright:
        """Return the turn after which the direction that was found points up.

        It is about `Up.middle`, which goes where it would go if the nearest axis were up.
        """
        name, middle = describe(up.axis), up.middle
        if name in UP_AXES and np.array_equal(up.axis, axis_named(name)):
            return cls.along(name)
        if not middle.any():
            matrix = _with_shift(up.matrix, np.zeros(3))
            return cls(name, matrix, lambda points: turn(up.matrix, points))
        nearest, _ = nearest_axis(up.axis)
        target = axes_matrix(nearest) @ middle
        matrix = _with_shift(up.matrix, target - up.matrix @ middle)
        return cls(name, matrix, lambda points: turn(up.matrix, points - middle) + target)

    def before(self, then: Transform) -> Upright:
        """Return the same with something to follow.

        Raises
        ------
        UsageError
            Where that is for another turn.
        """
        then.require_turn(self.matrix)
        return replace(self, then=then)

    def points(self, points: Float64) -> Float64:
        """Return points (N, 3) turned, without negative zeros; `points` may be overwritten."""
        turned = self._turn(points)
        if self.then is not None:
            turned = self.then.fit.points(turned)
        # In place, if possible, it takes half as long; the source does not mind 0.0 for -0.0.
        # Signalling NaNs are no reason to warn.
        with np.errstate(invalid="ignore"):
            return np.add(turned, 0.0, out=turned if turned.flags.writeable else None)

    def position(self, position: tuple[float, float, float]) -> tuple[float, float, float]:
        """Turn a position like the points."""
        x, y, z = self.points(np.array([position])).ravel().tolist()
        return x, y, z

    def recorded(self, points: Float64) -> Float64:
        """Return turned points (N, 3) as they were recorded."""
        if self.then is not None:
            points = self.then.fit.inverse.points(points)
        return turn(self.matrix[:3, :3].T, points - self.matrix[:3, 3])


def _with_shift(rotation: Float64, shift: Float64) -> Float64:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, shift
    return matrix
