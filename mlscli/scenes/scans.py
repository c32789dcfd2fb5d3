"""Scans: dense clouds that a craft flies over as over a scene."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from mlscli.errors import UsageError
from mlscli.geometry.surroundings import planes
from mlscli.runtime.arrays import Bool, Float64
from mlscli.runtime.threads import in_ranges
from mlscli.runtime.tree import Tree
from mlscli.scenes.discs import Discs, discs
from mlscli.scenes.surfaces import Leg

NEIGHBOURS = 12
"""How many neighbours make the surroundings of a point."""

MAX_SCAN_POINTS = 20_000_000

# A disc is so large that it holds this many of them. Where points lie at random, discs of this size
# leave exp(-8) of a surface open, one part in 3,000.
_HELD = 8
# Standard deviations off its plane up to which a disc hides nothing.
_DEPTH = 3.0
# A disc's depth is at least this share of its radius; and its radius at least this, in any unit.
_FLATTEST, _LEAST = 0.01, 1e-100
# A stray's surroundings reach this many times as far as those of the points nearest to it.
_STRAY, _NEAREST = 4.0, 6
# The texture of a plane. What varies in all directions has 1 more.
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
        Unit normals of these planes, to either side.
    radius : float64 (N,)
        Radii of discs that cover the surface, in the unit of the scan.
    depth : float64 (N,)
        How far the surroundings lie off their plane: 3 standard deviations, or a hundredth of the
        radius if that is more, in the unit of the scan.
    texture : float64 (N,)
        How many features a camera finds on a piece of surface, relatively: 0.05 on a plane, more
        on edges and corners, at most 1.05.
    stray : bool (N,)
        Points so far from all others that they are of no surface, and hide nothing.
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
    stray: Bool
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
        xyz = _distinct(points)
        if len(xyz) <= NEIGHBOURS:
            raise UsageError(
                f"{name}: holds {len(xyz)} distinct points, expected a dense cloud of more than "
                f"{NEIGHBOURS}"
            )
        around = planes(xyz, NEIGHBOURS + 1)
        off = ((around.middles - xyz) * around.normals).sum(axis=1)
        across, total = around.variances[:, 0], around.variances.sum(axis=1)
        # Three times the surface variation, which is a third at most: Pauly, Gross and Kobbelt
        # 2002, doi:10.1109/VISUAL.2002.1183771.
        variation = 3 * across / np.where(total > 0, total, 1.0)
        usual = _usual(xyz, around.reach)
        stray = around.reach > _STRAY * usual
        radius = math.sqrt(_HELD / NEIGHBOURS) * np.where(stray, usual, around.reach)
        # Of points so close together that the square of their distance is 0.
        radius = np.maximum(radius, _LEAST)
        # A plane takes three degrees of freedom.
        depth = _DEPTH * np.sqrt(across * ((NEIGHBOURS + 1) / (NEIGHBOURS - 2)))
        return cls(
            name,
            xyz,
            xyz + off[:, None] * around.normals,
            around.normals,
            radius,
            np.maximum(depth, _FLATTEST * radius),
            _PLAIN + variation,
            stray,
        )

    def with_legs(self, *legs: Leg) -> Scan:
        """Return the scan with a route given by hand."""
        return replace(self, legs=legs)

    @cached_property
    def spacing(self) -> float:
        """The median radius of the discs."""
        return float(np.median(self.radius))

    @property
    def area(self) -> Float64:
        """How large the piece of surface is that each point stands for, relatively, (N,)."""
        return self.radius**2

    @cached_property
    def discs(self) -> Discs:
        """The discs that hide what is behind them."""
        kept = ~self.stray
        return discs(self.foot[kept], self.normal[kept], self.radius[kept], self.depth[kept])

    @cached_property
    def bounds(self) -> tuple[Float64, Float64]:
        """The least and the greatest x, y, z of all points that are not strays, (3,) each."""
        solid = self.xyz[~self.stray]
        return solid.min(axis=0), solid.max(axis=0)

    @property
    def usual_height(self) -> float:
        """How high above its top a craft usually flies: so that a survey has some 200 keyframes."""
        low, high = self.bounds
        length, width = (high - low)[:2] + self.spacing
        return float(f"{math.sqrt(length * width) / 10:.2g}")


def _distinct(points: Float64) -> Float64:
    """Return the distinct points, sorted by x, y and z, float64 (N, 3)."""
    order = np.lexsort(points.T[::-1])
    ordered = points[order] + 0.0
    fresh = np.ones(len(ordered), dtype=np.bool_)
    fresh[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    return ordered[fresh]


def _usual(xyz: Float64, reach: Float64) -> Float64:
    """Return the median reach of the points nearest to each point, itself among them, (N,)."""
    tree = Tree(xyz)
    usual = np.empty(len(xyz))

    def work(begin: int, end: int) -> None:
        rows = tree.rows[begin:end]
        _, near = tree.nearest(xyz[rows], min(_NEAREST, len(xyz)))
        usual[rows] = np.median(reach[near], axis=1)

    in_ranges(len(xyz), work)
    return usual
