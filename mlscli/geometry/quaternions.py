"""Whether the numbers of quaternions stand in the order x y z w, or w x y z.

The length tells nothing, nor do the turns from one attitude to the next: both are the same in
either order. But read in the wrong one, a craft that turns about its vertical rolls, and one that
keeps its course hangs upside down below what it flew above. So that order is likelier in which
attitudes, points and route are likelier together, with whatever direction as the vertical.
"""

from __future__ import annotations

import numpy as np

from mlscli.geometry.attitudes import likelihoods
from mlscli.geometry.evidence import Evidence, dots, half_sphere
from mlscli.geometry.sides import Scene, customary
from mlscli.geometry.vertical import of_craft
from mlscli.keyframes.keyframe import Axes
from mlscli.runtime.arrays import Float64

_DIRECTIONS = 1000

_CANDIDATES, _APART = 4, 0.9
"""Verticals that are tried in full, and the cosine of the angle from which on they are others."""

CERTAIN = 2.0
"""An order that is not so much likelier than the other, as a logarithm, is not certain."""


def otherwise(quaternions: Float64, order: str) -> Float64:
    """Return quaternions x y z w (K, 4) that were read in an order as if written in the other.

    The orders are ``x y z w`` and ``w x y z``.
    """
    return np.roll(quaternions, -1 if order == "x y z w" else 1, axis=1)


def favour(
    points: Float64,
    route: Float64 | None,
    attitudes: Float64,
    others: Float64,
    axes: Axes = "unknown",
) -> float:
    """Return how much likelier attitudes are than the same numbers in another order.

    It is a natural logarithm, below 0 where the others are likelier. Parameters are those of
    `mlscli.geometry.vertical.find_up`, with both attitudes (K, 4).
    """
    if not len(points) or of_craft(attitudes, axes, points, route) is None:
        return 0.0
    evidence, half = Evidence(points), half_sphere(_DIRECTIONS)
    both, of_points = np.concatenate((half, -half)), np.tile(evidence.of_points(half), 2)
    one, other = (
        _likelihood(evidence, route, both, of_points + likelihoods(each, axes, both))
        for each in (attitudes, others)
    )
    return one - other


def _likelihood(evidence: Evidence, route: Float64 | None, both: Float64, score: Float64) -> float:
    """Return how likely all is with the likeliest vertical; `score` (D,) is that of `both`."""
    best = -np.inf
    for _ in range(_CANDIDATES):
        number = int(score.argmax())
        axis = both[number]
        said = [*Scene(evidence.all_surfaces, axis).reasons(route), customary(axis)]
        best = max(best, float(score[number]) + sum(reason.weight for reason in said) / 2)
        score = np.where(dots(both, axis) > _APART, -np.inf, score)
    return best
