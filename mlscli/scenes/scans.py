"""Scans: dense clouds that a craft flies over as over a scene."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from mlscli.errors import UsageError
from mlscli.geometry.surroundings import planes
from mlscli.runtime.arrays import Float64
from mlscli.scenes.discs import Discs, discs
from mlscli.scenes.surfaces import Leg

NEIGHBOURS = 8
"""How many neighbours make the surroundings of a point."""

MAX_SCAN_POINTS = 50_000_000

# Surroundings that reach this many times as far as the median are those of a stray point.
_STRAY = 4.0
# Standard deviations off its plane up to which a disc hides nothing.
_DEPTH = 3.0
# Texture of a plane; that of points spread evenly in all directions is 1 more.
_PLAIN = 0.05


@dataclass(frozen=True, eq=False)
class Scan:
    """A dense cloud, and what it tells of the surfaces that it is of.

    Attributes
    ----------
    name : str
        What messages call it.
    xyz : float64 (N, 3)
        Its distinct points, sorted, in the unit of the scan, z up.
    foot : float64 (N, 3)
        The points moved onto the planes through their surroundings.
    normal : float64 (N, 3)
        Unit normals of the planes through the surroundings of each point, to either side.
    radius : float64 (N,)
        How far the surroundings of each point reach, in the unit of the scan.
    depth : float64 (N,)
        How far the surroundings lie off their plane: 3 standard deviations, in the unit of the
        scan.
    texture : float64 (N,)
        How many features a camera finds there, relatively: little on planes, more on edges and
        corners, up to 1.05.
    stray : bool (N,)
        Points that are so far from all others that they are not taken for a surface.
    legs : tuple of Leg
        The route given by hand, if any.
    """

    name: str
    xyz: Float64
    foot: Float64
    normal: Float64
    radius: Float64
    depth: Float64
    texture: Float64
    legs: tuple[Leg, ...] = ()

    @classmethod
    def of(cls, name: str, points: Float64) -> Scan:
        """Return the scan that points are; neither their order nor repetitions change it.

        Parameters
        ----------
        name : str
            What messages call it.
        points : float64 (N, 3)
            In the unit of the scan, z up.

        Raises
        ------
        UsageError
            Where they are too many, or so few that they have no surroundings.
        """
        if len(points) > MAX_SCAN_POINTS:
            raise UsageError(
                f"{name}: holds {len(points):,} points, expected at most {MAX_SCAN_POINTS:,}; "
                "`crop` takes a part of it"
            )
        xyz = _distinct(points + 0.0)
        if len(xyz) <= NEIGHBOURS:
            raise UsageError(
                f"{name}: holds {len(xyz)} distinct points, expected a dense cloud of more than "
                f"{NEIGHBOURS}"
            )
        around = planes(xyz, NEIGHBOURS + 1)
        total = around.variances.sum(axis=1)
        # Three times the surface variation of Pauly, Gross and Kobbelt (2002,
        # doi:10.1109/VISUAL.2002.1183771), which is a third at most.
        variation = 3 * around.variances[:, 0] / np.where(total > 0, total, 1.0)
        off = ((around.middles - xyz) * around.normals).sum(axis=1)
        return cls(
            name,
            xyz,
            xyz + off[:, None] * around.normals,
            around.normals,
            around.reach,
            # A plane takes three degrees of freedom.
            _DEPTH * np.sqrt(around.variances[:, 0] * (1 + 3 / (NEIGHBOURS - 2))),
            _PLAIN + variation,
        )

    def with_legs(self, *legs: Leg) -> Scan:
        """Return the scan with a route given by hand."""
        return replace(self, legs=legs)

    @cached_property
    def spacing(self) -> float:
        """The median radius of the surroundings of a point."""
        return float(np.median(self.radius))

    @cached_property
    def solid(self) -> Float64:
        """The points that are not strays, float64 (M, 3)."""
        return self.xyz[self.radius <= _STRAY * self.spacing]

    @cached_property
    def discs(self) -> Discs:
        """The discs that hide what is behind them; strays are points."""
        kept = self.radius <= _STRAY * self.spacing
        return discs(self.foot[kept], self.normal[kept], self.radius[kept], self.depth[kept])

    @cached_property
    def bounds(self) -> tuple[Float64, Float64]:
        """The least and the greatest x, y, z of all points that are not strays, (3,) each."""
        return self.solid.min(axis=0), self.solid.max(axis=0)


def _distinct(points: Float64) -> Float64:
    """Return the distinct points, sorted by x, y and z, float64 (N, 3)."""
    order = np.lexsort(points.T[::-1])
    ordered = points[order]
    fresh = np.ones(len(ordered), dtype=np.bool_)
    fresh[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    return ordered[fresh]
