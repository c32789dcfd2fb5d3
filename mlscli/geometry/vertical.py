"""The vertical of a cloud, found where the user did not name it.

It is the direction with the highest score, a product of three:

- flat surfaces are *level* or *plumb*: floors, ground and roofs lie across it, walls along it;
- the cloud extends little: a flight covers more ground than height;
- the craft keeps its attitude: it turns about the vertical and hardly tilts.

Floors count twice as much as walls: otherwise all three axes of a room would be supported equally.
"""

from __future__ import annotations

import math

import numpy as np

from mlscli.errors import InputError
from mlscli.geometry.surroundings import Planes, planes
from mlscli.geometry.up import UP_AXES, Up, describe, nearest_axis
from mlscli.runtime.arrays import Float64

_DIRECTIONS = 2000
# The runner-up is at least this far from the axis; with at least this share of its score the two
# are supported about equally.
_APART = math.radians(45)
_EQUAL = 0.85
# Surroundings of growing size: how many neighbours, and among which part of the points (one in so
# many). They grow until those of enough points are flat; in a noisy cloud, small ones are not.
_SURROUNDINGS = ((16, 1), (32, 1), (64, 1), (128, 1), (128, 4), (128, 16))
# Sums of trust: the first is enough, and less than the second is too little.
_ENOUGH = 50.0
_FEWEST = 10.0
# The usual tilt of a craft.
_TILT = math.radians(12)
# An axis this near to one of the recording's is replaced by that.
_ROUNDING = 1e-6
# The route decides which way is up only if the shares of level surfaces above and below the craft
# differ by more than this.
_EVEN = 0.2
# Most recordings have z up or, in a camera's frame, y down, at most so much out of plumb, as
# cameras look down a little. Such an axis is given up only for more evidence against it than
# `_CUSTOM`; there can be up to 1.5.
_OUT_OF_PLUMB = math.radians(25)
_CUSTOMARY = np.array([(0.0, 0.0, 1.0), (0.0, -1.0, 0.0)])
_CUSTOM = np.array([1.1, 0.8])


def find_up(points: Float64, route: Float64 | None = None, attitudes: Float64 | None = None) -> Up:
    """Find the vertical of a recording, and which way along it is up.

    Up is the side on which the craft flew: above most level surfaces. Without a route, or where
    about as many lie above it as below, the scene decides: most level surfaces lie in its lower
    half, and points on other surfaces thin out upwards. A ceiling whose floor is not seen looks
    like that upside down; so an axis within 25 degrees of z up or y down is given up only for clear
    evidence.

    Parameters
    ----------
    points : float64 (N, 3)
        A `PointSample` of the cloud: finite, no point twice.
    route : float64 (K, 3), optional
        Where the craft was, in the same frame; NaN where not known.
    attitudes : float64 (K, 4), optional
        Quaternions x y z w from the axes of the craft, or of its camera, to that frame; NaN where
        not known.

    Raises
    ------
    InputError
        Where too few points have flat surroundings, or two axes are supported about equally.
    """
    surfaces = _surfaces(points)
    directions = _half_sphere(_DIRECTIONS)
    score = _level_and_plumb(surfaces, directions) * _flatness(points, directions)
    if attitudes is not None:
        score *= _steadiness(attitudes, directions)
    best = int(score.argmax())
    axis, why = _upwards(surfaces, _refined(surfaces, directions[best]), route)
    apart = np.abs(_dots(directions, axis)) <= math.cos(_APART)
    second = int((score * apart).argmax())
    other = _refined(surfaces, directions[second])
    if abs(other @ axis) > math.cos(_APART):
        other = directions[second]
    runner_up, _ = _upwards(surfaces, other, route)
    doubt = float(score[second] / score[best])
    if doubt > _EQUAL:
        raise InputError(_undecided(surfaces, axis, runner_up))
    return Up(axis, *_shares(surfaces, axis), runner_up, doubt, why)


def _surfaces(points: Float64) -> Planes:
    """Return the planes through the smallest surroundings of which enough are flat.

    Raises
    ------
    InputError
        Where too few are flat, whatever their size.
    """
    best, most = None, 0.0
    for neighbours, part in _SURROUNDINGS:
        some = points[: len(points) // part]
        if part > 1 and len(some) < 4 * neighbours:
            break
        found = planes(some, neighbours)
        trusted = float(found.trust.sum())
        if trusted > most:
            best, most = found, trusted
        if most >= _ENOUGH:
            break
    if best is None or most < _FEWEST:
        raise InputError(
            f"`up` auto: found {most:.0f} points with flat surroundings among {len(points):,}, "
            f"expected at least {_FEWEST:.0f}; say which axis points up: {', '.join(UP_AXES)}"
        )
    return best


def _undecided(surfaces: Planes, *axes: Float64) -> str:
    supported = " and ".join(
        f"{describe(axis)}, by {sum(_shares(surfaces, axis)):.0%} of the points with flat "
        "surroundings"
        for axis in axes
    )
    choice = " or ".join(f"`up` {nearest_axis(axis)[0]}" for axis in axes)
    return f"`up` auto: two axes are supported about equally, {supported}; expected {choice}"


def _half_sphere(count: int) -> Float64:
    """Return unit vectors (count, 3) spread evenly over a half sphere, along a spiral."""
    z = (np.arange(count) + 0.5) / count
    turn = np.arange(count) * (math.pi * (3 - math.sqrt(5)))
    radius = np.sqrt(1 - z * z)
    return np.column_stack((radius * np.cos(turn), radius * np.sin(turn), z))


def _level_and_plumb(surfaces: Planes, directions: Float64) -> Float64:
    """Return for each direction (D, 3) the share of planes that are level, plus half that of plumb.

    Ground and roofs may slope: they count in full up to 15 degrees, and less up to 45.
    """
    from scipy.spatial import cKDTree

    _, nearest = cKDTree(np.concatenate((directions, -directions))).query(surfaces.normals)
    votes = np.bincount(nearest % len(directions), surfaces.trust, len(directions))
    along = np.abs(_dots(directions, directions))
    shares = _level(along, 15, 45) + _plumb(along, 0, 15) / 2
    return np.asarray(np.einsum("dn,n->d", shares, votes / votes.sum()))


def _flatness(points: Float64, directions: Float64) -> Float64:
    """Return the cloud's median extent over that along each direction (D, 3), at most 20."""
    low, high = np.percentile(_dots(points[: len(directions)], directions), [10, 90], axis=0)
    extent = high - low
    usual = np.median(extent)
    return np.asarray(usual / np.maximum(extent, usual / 20))


def _steadiness(attitudes: Float64, directions: Float64) -> Float64:
    """Return how steadily the craft keeps its attitude if it turns about each direction (D, 3).

    Seen from the craft, a direction wanders. The mean of the unit vectors seen is shorter than 1 by
    half the mean square of the angles (radians) between them and their mean.
    """
    from scipy.spatial.transform import Rotation

    known = np.linalg.norm(attitudes, axis=1) > 0
    if not known.any():
        return np.ones(len(directions))
    mean = Rotation.from_quat(attitudes[known]).as_matrix().mean(axis=0)
    seen = np.linalg.norm(_dots(directions, mean.T), axis=1)
    return np.asarray(np.exp((seen - 1) / _TILT**2))


def _refined(surfaces: Planes, axis: Float64) -> Float64:
    """Return the axis near this one that best fits the normals of level and plumb planes."""
    normals = surfaces.normals
    for _ in range(20):
        along = np.abs(_dots(normals, axis))
        weight = surfaces.trust * (_level(along, 0, 25) - _plumb(along, 0, 15))
        if weight.any():
            axis = np.linalg.eigh(np.einsum("n,ni,nj->ij", weight, normals, normals))[1][:, 2]
    whole = np.round(axis)
    return whole if np.linalg.norm(axis - whole) < _ROUNDING else axis


def _shares(surfaces: Planes, axis: Float64) -> tuple[float, float]:
    """Return the shares of planes, weighted by trust, level and plumb within 15 degrees."""
    along = np.abs(_dots(surfaces.normals, axis))
    level, plumb = _level(along, 15, 15), _plumb(along, 15, 15)
    total = float(surfaces.trust.sum())
    return float((surfaces.trust * level).sum()) / total, float(
        (surfaces.trust * plumb).sum()
    ) / total


def _upwards(surfaces: Planes, axis: Float64, route: Float64 | None) -> tuple[Float64, str]:
    """Return the axis or its opposite, whichever points up, and the reason."""
    # Without evidence, the side of the customary axes is up.
    axis = axis if (_CUSTOMARY @ axis).sum() >= 0 else -axis
    heights, along = _dots(surfaces.points, axis), np.abs(_dots(surfaces.normals, axis))
    level = surfaces.trust * _level(along, 15, 30)

    def share_below(height: float) -> float:
        return float(level[heights < height].sum()) / (float(level.sum()) or 1.0)

    flown = np.empty(0) if route is None else _dots(route[np.isfinite(route).all(axis=1)], axis)
    if len(flown):
        below = share_below(float(np.median(flown)))
        if abs(2 * below - 1) > _EVEN:
            up = axis if below > 0.5 else -axis
            return up, f"the craft flew above {max(below, 1 - below):.0%} of the level ones"
    low, high = np.percentile(heights, [10, 90])
    below = share_below(float(low + high) / 2)
    evidence = 2 * below - 1 + _tail(heights[along < math.cos(_APART)]) / 2
    near = _CUSTOMARY @ axis > math.cos(_OUT_OF_PLUMB)
    if evidence < 0 and -evidence < _CUSTOM[near].sum():
        why = "the scene leaves open which way is up, and most recordings have z up or y down"
        return axis, why
    up, below = (axis, below) if evidence >= 0 else (-axis, 1 - below)
    return up, f"{below:.0%} of the level ones lie in the lower half of the scene"


def _dots(vectors: Float64, others: Float64) -> Float64:
    """Return the dot products of vectors (N, 3) with one (3,) or several (M, 3), without BLAS."""
    return np.asarray(np.einsum("ni,...i->n...", vectors, others))


def _tail(heights: Float64) -> float:
    """Return how much farther heights (N,) reach above their median than below it, from -1 to 1."""
    if not len(heights):
        return 0.0
    low, middle, high = np.percentile(heights, [10, 50, 90]).tolist()
    return float((high + low - 2 * middle) / (high - low)) if high > low else 0.0


def _level(along: Float64, full: float, none: float) -> Float64:
    """Return weights of planes by how level they are: 1 up to `full` degrees, 0 from `none` on.

    `along` is the cosine of the angle between the normal and the vertical, 0 to 1.
    """
    return _ramp(along, math.cos(math.radians(none)), math.cos(math.radians(full)))


def _plumb(along: Float64, full: float, none: float) -> Float64:
    """Return weights of planes by how plumb they are, as `_level`."""
    return _ramp(-along, -math.sin(math.radians(none)), -math.sin(math.radians(full)))


def _ramp(values: Float64, zero: float, one: float) -> Float64:
    """Return a linear ramp from 0 at `zero` to 1 at `one`, or a step where these are equal."""
    if zero == one:
        return np.asarray(values >= one, dtype=np.float64)
    return np.asarray(np.clip((values - zero) / (one - zero), 0.0, 1.0))
