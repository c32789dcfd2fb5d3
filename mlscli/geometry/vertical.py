"""The vertical of a cloud, found where the user did not name it.

The coordinates of a map projection have z up, unless attitudes contradict it. Otherwise it is the
direction for which most speaks: the attitudes of cameras or craft, as in
`mlscli.geometry.attitudes`, and flat surroundings and the extent of the cloud, as in
`mlscli.geometry.evidence`. Where these leave open which way along it is up, `mlscli.geometry.sides`
tells.
"""

from __future__ import annotations

import math

import numpy as np

from mlscli.errors import InputError
from mlscli.geometry.attitudes import likelihoods, taken_as
from mlscli.geometry.evidence import FEWEST, Evidence, around, dots, half_sphere
from mlscli.geometry.sides import Reason, Scene, customary, decide
from mlscli.geometry.up import UP_AXES, Up, axis_named, describe, nearest_axis
from mlscli.keyframes.keyframe import Axes
from mlscli.runtime.arrays import Float64

_DIRECTIONS = 2000
# The runner-up is at least this far from the axis; with more than this share of its likelihood the
# two are supported about equally. Where no surroundings are flat, it must be clearer than that.
_APART = math.radians(45)
_EQUAL, _CLEAR = 0.85, 0.35
# Points and attitudes contradict each other if they speak for different ones of the two by more
# than this, as logarithms; then one must be clearer, too, or the customary one.
_CONTRADICTION = 1.0
# A cloud is one plane if more than this share of its surfaces is level, and less than the rest
# plumb.
_ONE_PLANE = 0.9
# What attitudes say is given up to fit walls and floors by this much at most, as a logarithm.
_YIELD = 2.0
# Attitudes contradict a vertical with which they are so much less likely, as a logarithm. What is
# within this of it is the same vertical.
CONTRADICTS = 6.0
_SAME = math.radians(10)
# Floors and walls that stand upright on each other, each this share of what is flat, within so many
# degrees, give up nothing: what leans is the craft.
_UPRIGHT, _EXACTLY = 0.1, 5.0
# An axis this near to one of the recording's is replaced by that.
_ROUNDING = 1e-6
# More weight than this of the attitudes decides which way is up, whatever else there is.
_DECISIVE = 20.0
# What attitudes are is told by what they are within so many degrees of the axis found.
_ABOUT = 6.0
# The least extent of a route, as a share of what is seen from it.
_TRAVELS = 0.01
# The coordinates of map projections, in metres or feet: at least so far from their origin along
# both axes, and along one, and at most so high.
_FAR_BOTH, _FAR, _HIGHEST = 1e4, 1e5, 1e4


def find_up(
    points: Float64,
    route: Float64 | None = None,
    attitudes: Float64 | None = None,
    axes: Axes = "unknown",
) -> Up:
    """Find the vertical of a recording, and which way along it is up.

    Parameters
    ----------
    points : float64 (N, 3)
        A `PointSample` of the cloud: finite, no point twice.
    route : float64 (K, 3), optional
        Where the craft was, in the same frame; NaN where not known.
    attitudes : float64 (K, 4), optional
        Quaternions x y z w from the axes of the craft, or of its camera, to that frame; NaN where
        not known.
    axes : {"camera", "body", "unknown"}
        Which axes these are.

    Raises
    ------
    InputError
        Where too few points have flat surroundings, or two axes are supported about equally, and
        no attitudes decide.
    """
    if has_z_up(points, attitudes, axes):
        z, x = axis_named("z"), axis_named("x")
        return Up(z, 0.0, 0.0, x, 0.0, "the coordinates are those of a map projection")
    attitudes = of_craft(attitudes, axes, points, route)
    evidence = Evidence(points, attitudes, axes)
    half = half_sphere(_DIRECTIONS)
    both = np.concatenate((half, -half))
    score = np.tile(evidence.of_points(half), 2) + evidence.of_attitudes(both)
    best = int(score.argmax())
    axis = _refined(evidence, both[best])
    apart = np.abs(dots(both, axis)) <= math.cos(_APART)
    second = int(np.where(apart, score, -math.inf).argmax())
    runner_up = _refined(evidence, both[second])
    if abs(runner_up @ axis) > math.cos(_APART):
        runner_up = both[second]
    doubt = float(np.exp(score[second] - score[best]))
    if evidence.trusted < FEWEST and (doubt > _CLEAR or not len(points)):
        raise InputError(
            f"`up` auto: found {evidence.trusted:.0f} points with flat surroundings among "
            f"{len(points):,}, expected at least {FEWEST:.0f}; say which axis points up: "
            f"{', '.join(UP_AXES)}"
        )
    axis, why = _upwards(evidence, axis, route, attitudes, axes)
    runner_up, _ = _upwards(evidence, runner_up, route, attitudes, axes)
    if doubt > _CLEAR and _contradict(evidence, both[best], both[second]):
        # Cameras that all look straight at a plane: at ground, or at a facade. Custom decides.
        custom = [customary(direction).weight for direction in (axis, runner_up)]
        if max(custom) <= 0 or custom[0] == custom[1]:
            raise InputError(_undecided(evidence, axis, runner_up))
        if custom[0] < custom[1]:
            (axis, why), runner_up = _upwards(evidence, runner_up, route, attitudes, axes), axis
    elif doubt > _EQUAL:
        raise InputError(_undecided(evidence, axis, runner_up))
    return Up(axis, *evidence.shares(axis), runner_up, doubt, why, _middle(points))


def has_z_up(points: Float64, attitudes: Float64 | None, axes: Axes) -> bool:
    """Return whether points (N, 3) have the coordinates of a map projection: far away, not high.

    Not so where attitudes whose axes are known contradict it. Parameters are those of `find_up`.
    """
    if not len(points):
        return False
    x, y, z = np.abs(np.median(points, axis=0)).tolist()
    if min(x, y) <= _FAR_BOTH or max(x, y) <= _FAR or z >= _HIGHEST:
        return False
    return axes == "unknown" or lost_with(axis_named("z"), attitudes, axes) < CONTRADICTS


def lost_with(axis: Float64, attitudes: Float64 | None, axes: Axes) -> float:
    """Return how much less likely attitudes are with an axis (3,) up than with the likeliest one.

    It is a natural logarithm, 0 or more. Parameters are those of `find_up`.
    """
    half = half_sphere(_DIRECTIONS // 2)
    directions = np.concatenate((half, -half))
    said = likelihoods(attitudes, axes, directions)
    return float(said.max() - said[dots(directions, axis) > math.cos(_SAME)].max())


def of_craft(
    attitudes: Float64 | None, axes: Axes, points: Float64, route: Float64 | None
) -> Float64 | None:
    """Return attitudes (K, 4) if they may be a craft's; None otherwise.

    A scanner that turns but stays where it is tells nothing of the vertical, unless its axes are
    known. Parameters are those of `find_up`.
    """
    known = np.empty((0, 3)) if route is None else route[np.isfinite(route).all(axis=1)]
    if axes != "unknown" or not len(known) or not len(points):
        return attitudes
    flown, seen = (
        float(np.linalg.norm(np.ptp(np.percentile(some, [5, 95], axis=0), axis=0)))
        for some in (known, points)
    )
    return attitudes if flown > _TRAVELS * seen else None


def _middle(points: Float64) -> Float64:
    """Return the middle of a cloud, in whole units, that lies far from the origin; or else 0.

    It is far if the cloud's diagonal, without the outermost, does not reach to the origin.
    """
    if not len(points):
        return np.zeros(3)
    low, middle, high = np.percentile(points, [2, 50, 98], axis=0)
    is_far = np.linalg.norm(middle) > np.linalg.norm(high - low)
    return np.round(middle) + 0.0 if is_far else np.zeros(3)


def _undecided(evidence: Evidence, *axes: Float64) -> str:
    supported = " and ".join(
        f"{describe(axis)}, by {sum(evidence.shares(axis)):.0%} of the points with flat "
        "surroundings"
        for axis in axes
    )
    choice = " or ".join(f"`up` {nearest_axis(axis)[0]}" for axis in axes)
    return f"`up` auto: two axes are supported about equally, {supported}; expected {choice}"


def _contradict(evidence: Evidence, best: Float64, second: Float64) -> bool:
    """Return whether points speak for one of two directions, and attitudes for the other."""
    two = np.stack((best, second))
    of_points, of_attitudes = (
        float(said[0] - said[1]) for said in (evidence.of_points(two), evidence.of_attitudes(two))
    )
    return of_points * of_attitudes < 0 and min(abs(of_points), abs(of_attitudes)) > _CONTRADICTION


def _refined(evidence: Evidence, axis: Float64) -> Float64:
    """Return the axis near this one that best fits level and plumb planes, and the attitudes."""
    fitted = evidence.fitted(axis)
    if evidence.has_attitudes and min(evidence.shares(fitted, _EXACTLY)) < _UPRIGHT:
        climbed = evidence.climbed(axis)
        with_floors, without = evidence.of_attitudes(np.stack((fitted, climbed))).tolist()
        if with_floors < without - _YIELD:
            fitted = climbed
    whole = np.round(fitted)
    return whole if np.linalg.norm(fitted - whole) < _ROUNDING else fitted


def _upwards(
    evidence: Evidence,
    axis: Float64,
    route: Float64 | None,
    attitudes: Float64 | None,
    axes: Axes,
) -> tuple[Float64, str]:
    """Return the axis or its opposite, whichever points up, and the reason."""
    x, y, z = axis.tolist()
    axis = axis if (z - y, x) >= (0, 0) else -axis
    ahead, back = evidence.of_attitudes(np.stack((axis, -axis))).tolist()
    weight = max(-_DECISIVE, min(_DECISIVE, ahead - back))
    up = axis if weight >= 0 else -axis
    said = Reason(weight, taken_as(attitudes, axes, around(up, _ABOUT)))
    scene = Scene(evidence.all_surfaces, axis)
    total, why = decide([said, *scene.reasons(route), customary(axis)])
    of_level, of_plumb = evidence.shares(axis)
    is_one_plane = of_level > _ONE_PLANE and of_plumb < 1 - _ONE_PLANE
    if is_one_plane and (axes == "unknown" or not evidence.has_attitudes):
        why += "; a facade alone would look the same"
    return (axis if total >= 0 else -axis), why
