"""Similarities that keep z up: a turn about z, a scale, and a shift."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mlscli.runtime.arrays import Array, Float64

# How far a matrix may be from a similarity, as its numbers are rounded; relative to its scale.
_ROUNDED = 1e-9


@dataclass(frozen=True)
class Similarity:
    """A turn about z, a scale, and then a shift.

    Attributes
    ----------
    yaw : float
        The turn, in radians, from x to y.
    scale : float
        Above 0.
    shift : tuple of float
        Along x, y and z, in the unit of what it leads to.
    """

    yaw: float = 0.0
    scale: float = 1.0
    shift: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @classmethod
    def of(cls, matrix: Array) -> Similarity | None:
        """Return the similarity of a matrix (4, 4); None where it is none that keeps z up."""
        if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
            return None
        scale = float(matrix[2, 2])
        if not scale > 0:
            return None
        x, y, z = matrix[:3, 3].tolist()
        found = cls(math.atan2(matrix[1, 0], matrix[0, 0]), scale, (x, y, z))
        near = np.abs(found.matrix - matrix).max() <= _ROUNDED * scale
        return found if near else None

    @property
    def linear(self) -> Float64:
        """Turn and scale, float64 (3, 3)."""
        cosine, sine = math.cos(self.yaw), math.sin(self.yaw)
        return self.scale * np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])

    @property
    def matrix(self) -> Float64:
        """The same for homogeneous coordinates, float64 (4, 4)."""
        whole = np.eye(4)
        whole[:3, :3], whole[:3, 3] = self.linear, self.shift
        return whole

    @property
    def inverse(self) -> Similarity:
        """The way back."""
        linear = self.linear.T / self.scale**2
        x, y, z = (-linear @ np.array(self.shift)).tolist()
        return Similarity(-self.yaw, 1 / self.scale, (x, y, z))

    def points(self, points: Float64) -> Float64:
        """Return points (N, 3) moved."""
        return np.asarray(np.einsum("ij,nj->ni", self.linear, points) + self.shift)
