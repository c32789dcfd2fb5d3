"""Which way is up: the axes that a user can name, a vertical that was found, the rotation to z."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from mlscli.runtime.arrays import Float64

# Which axes of a point as recorded, and with which sign, become x, y and z of the map.
UP_AXES = {
    "z": ((0, 1, 2), (1.0, 1.0, 1.0)),
    "-z": ((0, 1, 2), (1.0, -1.0, -1.0)),
    "y": ((0, 2, 1), (1.0, -1.0, 1.0)),
    "-y": ((0, 2, 1), (1.0, 1.0, -1.0)),
    "x": ((2, 1, 0), (-1.0, 1.0, 1.0)),
    "-x": ((2, 1, 0), (1.0, 1.0, -1.0)),
}


def axes_matrix(name: str) -> Float64:
    """Return the turn of `UP_AXES` as a matrix (3, 3); its last row is the axis that points up."""
    axes, signs = UP_AXES[name]
    return np.asarray(np.eye(3)[list(axes)] * np.array(signs)[:, np.newaxis])


def axis_named(name: str) -> Float64:
    """Return an axis of `UP_AXES` as a unit vector, float64 (3,)."""
    return np.asarray(axes_matrix(name)[2])


@dataclass(frozen=True, eq=False)
class Up:
    """The vertical of a recording, as found; see `mlscli.geometry.vertical.find_up`.

    Attributes
    ----------
    axis : float64 (3,)
        Unit vector upwards, in the frame of the recording.
    level, plumb : float
        Of the points with flat surroundings, the share (0 to 1) whose surroundings are level, and
        the share whose surroundings are plumb, both within 15 degrees.
    runner_up : float64 (3,)
        The best of the directions that are 45 degrees or more away, a unit vector.
    doubt : float
        The score of `runner_up` over that of `axis`, or where custom decided between the two, the
        lower over the higher: from 0 to 1.
    why : str
        What distinguished up from down.
    middle : float64 (3,)
        The point of the recording about which it turns: the middle of a cloud that lies far from
        the origin, or else the origin.
    """

    axis: Float64
    level: float
    plumb: float
    runner_up: Float64
    doubt: float
    why: str
    middle: Float64 = field(default_factory=lambda: np.zeros(3))

    @property
    def support(self) -> float:
        """Of the points with flat surroundings, the share whose surroundings are level or plumb."""
        return self.level + self.plumb

    @property
    def matrix(self) -> Float64:
        """The smallest rotation (3, 3) that turns `axis` to z; for `mlscli.geometry.poses.turn`."""
        return rotation_to_z(self.axis)

    @property
    def finding(self) -> str:
        """The direction, and what speaks for it, as text."""
        supported = (
            f", supported by {self.support:.0%} of the points with flat surroundings "
            f"({self.level:.0%} level, {self.plumb:.0%} upright)"
        )
        return f"up is {describe(self.axis)}{supported if self.support else ''}; {self.why}"

    @property
    def summary(self) -> str:
        """The result as a message to the user."""
        return f"`up` auto: {self.finding}"


def rotation_to_z(axis: Float64) -> Float64:
    """Return the smallest rotation, float64 (3, 3), that turns a unit vector (3,) to z.

    For the axes themselves it is the turn of `UP_AXES`, with entries 0, 1 and -1 only. A vector
    straight down is turned about x.
    """
    x, y, z = axis.tolist()
    across = x * x + y * y
    if z < 0 and across < 1e-24:
        return np.diag([1.0, -1.0, -1.0])
    # Both are 1 / (1 + z) but for rounding: the first fails near -z, the second near z.
    k = 1 / (1 + z) if z > 0 else (1 - z) / across
    return np.array([[1 - k * x * x, -k * x * y, -x], [-k * x * y, 1 - k * y * y, -y], [x, y, z]])


def nearest_axis(axis: Float64) -> tuple[str, float]:
    """Return the name of the axis nearest to a direction, and the degrees between them."""
    along = {name: signs[2] * float(axis[axes[2]]) for name, (axes, signs) in UP_AXES.items()}
    name = max(along, key=along.__getitem__)
    return name, math.degrees(math.acos(min(1.0, along[name])))


def describe(axis: Float64) -> str:
    """Return a direction as text: its axis, or else its coordinates and the nearest axis."""
    name, degrees = nearest_axis(axis)
    if degrees < 0.5:
        return name
    x, y, z = (axis.round(2) + 0.0).tolist()
    return f"({x:.2f}, {y:.2f}, {z:.2f}), {degrees:.0f}° from {name}"
