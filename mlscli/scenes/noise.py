"""What is wrong with the points of a visual SLAM: scatter, wrong correspondences, outliers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mlscli.errors import UsageError
from mlscli.runtime.arrays import Float64
from mlscli.scenes.surfaces import Scatter

SALT_PEPPER_FACTOR = 5.0
"""How much wider the displacement in z of a point of salt and pepper is (thesis, section 5.2)."""

REFERENCE_DISTANCE = 2.0
"""Where a triangulated point has the sigma stated; in the unit of the scene."""

WRONG_DISPARITY = (0.5, 2.0)
"""What a wrong correspondence multiplies the disparity by, anything between."""


DEFAULT_SIGMA = Scatter(0.05, 0.05)
"""A third of the thesis's cell."""


@dataclass(frozen=True)
class Noise:
    """How points are displaced.

    Attributes
    ----------
    kind : {"thesis", "slam"}
        ``thesis``: Gaussian, in x and y and in z; with the chance `salt_pepper`, in z with 5
        times the sigma. ``slam``: as triangulation errs: along the viewing ray with the vertical
        sigma times the square of the distance, across it with the horizontal sigma times the
        distance, both sigmas as at 2 units; with the chance `salt_pepper`, the correspondence is
        wrong and the depth anything from half to twice the true one, evenly in its inverse.
    sigma : Scatter
        For surfaces without a scatter of their own.
    salt_pepper : float
        The chance of salt and pepper, or of a wrong correspondence.
    outliers : float
        Share of the points whose z is anything between the scene's bottom and top instead.
    """

    kind: Literal["thesis", "slam"] = "thesis"
    sigma: Scatter = DEFAULT_SIGMA
    salt_pepper: float = 0.1
    outliers: float = 0.0

    def check(self) -> None:
        """Check the ranges.

        Raises
        ------
        UsageError
            Naming the option at fault.
        """
        if not all(math.isfinite(sigma) and sigma >= 0 for sigma in self.sigma):
            given = ",".join(f"{sigma:g}" for sigma in self.sigma)
            raise UsageError(f"--sigma {given}: expected two numbers of 0 or more")
        for option, chance in (("salt-pepper", self.salt_pepper), ("outliers", self.outliers)):
            if not 0 <= chance <= 1:
                raise UsageError(f"--{option} {chance:g}: expected a share from 0 to 1")


@dataclass(frozen=True)
class Chances:
    """Random numbers by purpose, so that asking for more of one changes no other.

    Attributes
    ----------
    seed : int
        0 or more.
    """

    seed: int

    def of(self, purpose: str) -> np.random.Generator:
        """Return the generator of a purpose, at its beginning."""
        return np.random.default_rng([self.seed, *purpose.encode()])


def displace(
    xyz: Float64, cameras: Float64, sigma: Float64, noise: Noise, chances: Chances
) -> Float64:
    """Return points as they would be measured.

    Parameters
    ----------
    xyz : float64 (N, 3)
        Where they are.
    cameras : float64 (N, 3)
        From where each is seen; only ``slam`` looks at it.
    sigma : float64 (N, 2)
        The horizontal and the vertical sigma of each.
    """
    gauss = chances.of("scatter").standard_normal(xyz.shape)
    wrong = chances.of("salt and pepper").random(len(xyz)) < noise.salt_pepper
    if noise.kind == "thesis":
        vertical = sigma[:, 1] * np.where(wrong, SALT_PEPPER_FACTOR, 1.0)
        moved: Float64 = xyz + gauss * np.column_stack((sigma[:, 0], sigma[:, 0], vertical))
        return moved
    ray = xyz - cameras
    distance = np.sqrt((ray * ray).sum(axis=1))
    far = distance / REFERENCE_DISTANCE
    ahead = ray / np.where(distance > 0, distance, 1.0)[:, None]
    error = gauss[:, 0] * sigma[:, 1] * far * far
    disparity = chances.of("correspondence").uniform(*WRONG_DISPARITY, len(xyz))
    depth = np.where(wrong, distance / disparity, distance + error)
    # Across the ray: a scatter in space without its part along the ray.
    space = chances.of("image").standard_normal(xyz.shape)
    across = space - (space * ahead).sum(axis=1)[:, None] * ahead
    seen: Float64 = cameras + depth[:, None] * ahead + (sigma[:, 0] * far)[:, None] * across
    return seen


def scatter_outliers(
    xyz: Float64, share: float, bottom: float, top: float, chances: Chances
) -> Float64:
    """Return points of which a share has any height between `bottom` and `top` instead."""
    rng = chances.of("outliers")
    gross = rng.random(len(xyz)) < share
    height = rng.uniform(bottom, top, len(xyz))
    return np.column_stack((xyz[:, :2], np.where(gross, height, xyz[:, 2])))
