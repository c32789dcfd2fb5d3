"""Noise of the points of a visual SLAM: scatter, wrong correspondences, outliers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mlscli.errors import UsageError
from mlscli.runtime.arrays import Bool, Float64
from mlscli.scenes.surfaces import Scatter

SALT_PEPPER_FACTOR = 5.0
"""Factor on the sigma in z of points with salt-and-pepper noise (thesis, section 5.2)."""

REFERENCE_DISTANCE = 2.0
"""Distance at which a point over a scene has the sigma given, in the unit of the scene."""

WRONG_DISPARITY = (0.5, 2.0)
"""Least and greatest factor on the disparity of a wrong correspondence."""

DEFAULT_SIGMA = Scatter(0.05, 0.05)
"""A third of the thesis's cell, in the unit of the scene."""


@dataclass(frozen=True)
class Noise:
    """How points are displaced.

    Attributes
    ----------
    kind : {"thesis", "slam"}
        ``thesis``: Gaussian in x, y and z; with the probability `salt_pepper`, the sigma in z is
        5 times as large. ``slam``: errors of triangulation. Along the viewing ray, the vertical
        sigma grows with the square of the distance; across it, the horizontal sigma grows with the
        distance; `sigma` holds at the distance `reference`. With the probability `salt_pepper` the
        correspondence is wrong: the depth is half to twice the true one, uniform in its inverse.
    sigma : Scatter
        For surfaces without a scatter of their own, in the unit of the scene.
    salt_pepper : float
        Probability, 0 to 1, of salt and pepper, or of a wrong correspondence.
    outliers : float
        Probability, 0 to 1, that z is replaced by one uniform from the scene's bottom to its top.
    reference : float or None
        Distance at which ``slam`` has the `sigma`, in the unit of the scene. None: 2, over a scan
        the median distance at which points are seen.
    """

    kind: Literal["thesis", "slam"] = "thesis"
    sigma: Scatter = DEFAULT_SIGMA
    salt_pepper: float = 0.1
    outliers: float = 0.0
    reference: float | None = None

    def check(self) -> None:
        """Check the ranges.

        Raises
        ------
        UsageError
            Where a value is out of range.
        """
        if not all(math.isfinite(sigma) and sigma >= 0 for sigma in self.sigma):
            given = ",".join(f"{sigma:g}" for sigma in self.sigma)
            raise UsageError(f"`sigma` {given}: expected two numbers of 0 or more")
        for name, chance in (("salt_pepper", self.salt_pepper), ("outliers", self.outliers)):
            if not 0 <= chance <= 1:
                raise UsageError(f"`{name}` {chance:g}: expected a share from 0 to 1")
        if self.reference is not None:
            if not (math.isfinite(self.reference) and self.reference > 0):
                raise UsageError(f"`reference` {self.reference:g}: expected a distance above 0")
            if self.kind != "slam":
                raise UsageError(f"`reference` {self.reference:g}: goes with noise slam")


@dataclass(frozen=True)
class Chances:
    """Random numbers by purpose: drawing more for one purpose changes no other.

    Attributes
    ----------
    seed : int
        Seed of all generators, 0 or more.
    """

    seed: int

    def of(self, purpose: str) -> np.random.Generator:
        """Return a new generator for a purpose; its numbers depend on seed and purpose only."""
        return np.random.default_rng([self.seed, *purpose.encode()])


def are_wrong(size: int, noise: Noise, chances: Chances) -> Bool:
    """Return which of so many points `displace` gives salt and pepper, or a wrong correspondence.

    Returns
    -------
    bool (size,)
    """
    return chances.of("salt and pepper").random(size) < noise.salt_pepper


def displace(
    xyz: Float64, cameras: Float64, sigma: Float64, noise: Noise, chances: Chances
) -> Float64:
    """Return points with noise.

    Parameters
    ----------
    xyz : float64 (N, 3)
        True positions, in the unit of the scene.
    cameras : float64 (N, 3)
        Position of the camera that sees each point; only the kind ``slam`` uses it.
    sigma : float64 (N, 2)
        The horizontal and the vertical sigma of each point, in the unit of the scene.
    noise : Noise
        Kind, probabilities and reference; its `sigma` is not used.
    chances : Chances
        Where the random numbers come from.

    Returns
    -------
    float64 (N, 3)
    """
    gauss = chances.of("scatter").standard_normal(xyz.shape)
    wrong = are_wrong(len(xyz), noise, chances)
    if noise.kind == "thesis":
        vertical = sigma[:, 1] * np.where(wrong, SALT_PEPPER_FACTOR, 1.0)
        moved: Float64 = xyz + gauss * np.column_stack((sigma[:, 0], sigma[:, 0], vertical))
        return moved
    ray = xyz - cameras
    distance = np.sqrt((ray * ray).sum(axis=1))
    far = distance / (REFERENCE_DISTANCE if noise.reference is None else noise.reference)
    ahead = ray / np.where(distance > 0, distance, 1.0)[:, None]
    error = gauss[:, 0] * sigma[:, 1] * far * far
    disparity = chances.of("correspondence").uniform(*WRONG_DISPARITY, len(xyz))
    depth = np.where(wrong, distance / disparity, distance + error)
    # Across the ray: an isotropic displacement without its component along the ray.
    space = chances.of("image").standard_normal(xyz.shape)
    across = space - (space * ahead).sum(axis=1)[:, None] * ahead
    seen: Float64 = cameras + depth[:, None] * ahead + (sigma[:, 0] * far)[:, None] * across
    return seen


def scatter_outliers(
    xyz: Float64, share: float, bottom: float, top: float, chances: Chances
) -> Float64:
    """Return points (N, 3), a share of them at uniform heights from `bottom` to `top` instead."""
    rng = chances.of("outliers")
    gross = rng.random(len(xyz)) < share
    height = rng.uniform(bottom, top, len(xyz))
    return np.column_stack((xyz[:, :2], np.where(gross, height, xyz[:, 2])))
