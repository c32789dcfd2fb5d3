"""Evidence against the vertical that the user named: told only where it is strong.

- The coordinates of a map projection have z up.
- Attitudes, those of cameras or of a craft: where they agree with the vertical, nothing else
  counts; where they contradict it, that is told.
- Floors and walls: another axis of the recording, or one at most 25 degrees from it, as cameras
  look down a little, has most flat surroundings level or plumb, walls among them, and not the
  vertical that was named. A facade alone, a slope or a pipe do not look like that.
- A craft that flew below all that it saw: so it looks if the map is upside down.
"""

from __future__ import annotations

import math

import numpy as np

from mlscli.errors import InputError
from mlscli.geometry.attitudes import likelihoods
from mlscli.geometry.evidence import Evidence, dots, half_sphere
from mlscli.geometry.sides import Scene
from mlscli.geometry.up import axis_named
from mlscli.geometry.vertical import CONTRADICTS, find_up, has_z_up, lost_with, of_craft
from mlscli.keyframes.keyframe import Axes
from mlscli.runtime.arrays import Float64

_DIRECTIONS = 1000
# Verticals farther apart than this contradict each other.
_OTHER = math.radians(45)
# Of axes that are known, attitudes tell more exactly: a map this far out of plumb is tipped.
_TIPPED = math.radians(30)
# Attitudes speak if another vertical is so much less likely than theirs, as a logarithm.
_SPEAKS = 3.5
# Floors and walls: the least trust in all; the least shares of level and plumb ones, and of plumb
# ones; the least flatness; by how much they must be likelier than with the vertical named, as a
# logarithm; and the greatest share of level and plumb ones with that, of those with the other; or
# by how much they must be likelier, than with that and than with any at all.
_TRUSTED, _SUPPORT, _WALLS, _FLATNESS = 25.0, 0.65, 0.25, 1.6
_LIKELIER, _SUPPORTED, _FLATTER, _FLATTEST = 0.7, 0.85, 2.0, 1.5
# What a route says that lies below all around it, see `Scene.flown`.
_BELOW = -2.0
# How far the other may be from an axis of the recording.
_OUT_OF_PLUMB = math.radians(25)


def objection(
    up: str,
    points: Float64,
    route: Float64 | None = None,
    attitudes: Float64 | None = None,
    axes: Axes = "unknown",
) -> str:
    """Return what speaks strongly against a vertical, as a line for the user; empty: nothing.

    Parameters
    ----------
    up : str
        The axis that is taken to point up, one of `UP_AXES`.
    points, route, attitudes, axes
        As for `mlscli.geometry.vertical.find_up`, in the frame of the recording.
    """
    named = axis_named(up)
    if has_z_up(points, attitudes, axes):
        if up == "z":
            return ""
        return f"`up` {up} is doubtful, try `up` z: the coordinates are those of a map projection"
    attitudes = of_craft(attitudes, axes, points, route)
    half = half_sphere(_DIRECTIONS)
    directions = np.concatenate((half, -half))
    said = likelihoods(attitudes, axes, directions)
    if _speak(said, axes, directions):
        if lost_with(named, attitudes, axes) < CONTRADICTS:
            return ""
    else:
        evidence = Evidence(points)
        if evidence.trusted < _TRUSTED:
            return ""
        below = Scene(evidence.all_surfaces, named).flown(route).weight < _BELOW
        if not below and not _floors_and_walls_contradict(evidence, half, named):
            return ""
    try:
        found = find_up(points, route, attitudes, axes)
    except InputError:
        return ""
    if found.axis @ named > math.cos(_OTHER if axes == "unknown" else _TIPPED):
        return ""
    return f"`up` {up} is doubtful, try `up` auto: it seems that {found.finding}"


def _speak(said: Float64, axes: Axes, directions: Float64) -> bool:
    """Return whether attitudes say anything about the vertical; `said` (D,) of `directions`.

    Those of unknown axes may not: a craft that does not turn, or attitudes that were never set.
    """
    if axes != "unknown":
        return bool(said.any())
    elsewhere = np.abs(dots(directions, directions[int(said.argmax())])) < math.cos(_OTHER)
    return bool(said.max() - said[elsewhere].max() > _SPEAKS)


def _floors_and_walls_contradict(evidence: Evidence, half: Float64, named: Float64) -> bool:
    """Return whether floors and walls say that not the vertical named is it, but another."""
    said = evidence.of_points(half)
    other = evidence.fitted(half[int(said.argmax())])
    if np.abs(other).max() < math.cos(_OUT_OF_PLUMB) or abs(other @ named) > math.cos(_OTHER):
        return False
    of_level, of_plumb = evidence.shares(other)
    support = of_level + of_plumb
    here, there = evidence.of_points(np.stack((named, other))).tolist()
    elsewhere = float(said[np.abs(dots(half, other)) < math.cos(_OTHER)].max())
    # Walls at right angles make floors and walls of either.
    is_flat = there - here > _FLATTER and there - elsewhere > _FLATTEST
    return bool(
        support > _SUPPORT
        and of_plumb > _WALLS
        and evidence.flatness(other[np.newaxis])[0] > _FLATNESS
        and there - here > _LIKELIER
        and (is_flat or sum(evidence.shares(named)) < _SUPPORTED * support)
    )
