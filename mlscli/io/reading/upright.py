"""Turn points as recorded so that z points up."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mlscli.geometry.poses import turn
from mlscli.geometry.up import UP_AXES, Up, describe
from mlscli.runtime.arrays import Float64


@dataclass(frozen=True, eq=False)
class Upright:
    """The rotation of points and positions after which z points up.

    Attributes
    ----------
    up : str
        Which direction of the recording points up: an axis, or the direction that was found.
    """

    up: str
    _turn: Callable[[Float64], Float64]

    @classmethod
    def along(cls, up: str) -> Upright:
        """Return the rotation after which an axis of `UP_AXES` points up."""
        if up == "z":
            return cls(up, lambda points: points)
        axes, signs = UP_AXES[up]
        return cls(up, lambda points: np.take(points, axes, axis=1) * signs)

    @classmethod
    def found(cls, up: Up) -> Upright:
        """Return the rotation after which the direction that was found points up."""
        return cls(describe(up.axis), lambda points: turn(up.matrix, points))

    def points(self, points: Float64) -> Float64:
        """Return points (N, 3) turned, without negative zeros; `points` may be overwritten."""
        turned = self._turn(points)
        # In place, if possible, it takes half as long; the source does not mind 0.0 for -0.0.
        return np.add(turned, 0.0, out=turned if turned.flags.writeable else None)

    def position(self, position: tuple[float, float, float]) -> tuple[float, float, float]:
        """Turn a position like the points."""
        x, y, z = self.points(np.array([position])).ravel().tolist()
        return x, y, z
