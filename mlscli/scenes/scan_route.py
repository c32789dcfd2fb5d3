"""The route through a scan: a survey from above, and rings where the rest is seen.

A ring is a small circle in free space, the camera outwards: it shows all around, from positions
that differ. Rings are chosen one after the other, each where most is seen of what is not yet seen,
until the next would add next to nothing: greedy covering, the usual way to plan views (Scott, Roth
and Rivest 2003, doi:10.1145/641865.641868). The craft flies to the nearest by the shortest way
through free space; where none is known, another flight begins.

The survey is left out indoors: where rings under cover, below something of the scan, see more than
the survey, and nearly all that it sees. Then the craft stays below the scan's top.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np

from mlscli.errors import UsageError
from mlscli.runtime.arrays import Bool, Float64
from mlscli.scenes.discs import in_frame, in_sight, sights
from mlscli.scenes.flight import Craft
from mlscli.scenes.free_space import Places, find_places
from mlscli.scenes.noise import Chances
from mlscli.scenes.route import CameraPoses, poses_along, survey
from mlscli.scenes.scans import Scan
from mlscli.scenes.surfaces import Leg

# How many points are looked at to choose rings by, and how many rings there are at most.
_LOOKED_AT, _RINGS = 1500, 200
# A ring adds at least this share of the scan, the survey that one.
_ADDS, _SURVEY_ADDS = 0.002, 0.1
_SIDES = 6
# How far the camera looks up from straight down, within the scan: nearly level.
_TILT = 80.0


def find_route(scan: Scan, craft: Craft, lanes: bool | None = None) -> CameraPoses:
    """Return the poses of a flight that shows what of a scan can be shown.

    Parameters
    ----------
    scan : Scan
        With legs of its own, only these are flown, after the survey if asked for.
    craft : Craft
        How it flies, and what its camera sees.
    lanes : bool or None
        Whether the scan is surveyed from above. None: not indoors, nor where the scan has legs.

    Raises
    ------
    UsageError
        Where a value is out of range, or nothing is seen from any place.
    """
    height, reach = craft.above(scan), craft.reach(scan)
    if scan.legs:
        return poses_along([*(survey(scan, height) if lanes else ()), *scan.legs], height)
    over = survey(scan, height) if lanes is not False else []
    points = _evenly(scan)
    from_above = np.zeros(len(points), dtype=np.bool_)
    if over:
        from_above = _seen(scan, points, poses_along(over, height), craft)
    places = find_places(scan)
    # As far as from the survey to the bottom: what is seen from farther away is seen badly.
    shown = sights(points, places.position, reach / 2, scan.discs)
    shown &= _by_rings(points, places.position, craft.field_of_view)
    if lanes is None:
        inside = _most_showing(shown[places.covered], np.zeros_like(from_above))
        within = shown[places.covered][inside].any(axis=0)
        adds = (from_above & ~within).mean()
        if adds < _SURVEY_ADDS and from_above.sum() < within.sum():
            over, from_above = [], np.zeros_like(from_above)
    if not over:
        # Nor does a craft rise above a scan that it does not survey.
        shown &= (places.position[:, 2] <= scan.bounds[1][2])[:, None]
    legs = [*over, *_tour(places, _most_showing(shown, from_above), height)]
    if not legs:
        raise UsageError(
            f"{scan.name}: found no place within it from where something is seen; fly a `survey` "
            "over it, give the route by `legs`, or widen the `range`"
        )
    return poses_along(legs, height)


def share_seen(scan: Scan, poses: CameraPoses, craft: Craft) -> float:
    """Return the share of a scan's area that at least one camera sees, 0 to 1, from a sample."""
    return float(_seen(scan, _evenly(scan), poses, craft).mean())


def _evenly(scan: Scan) -> Float64:
    """Return points spread evenly over the area of a scan, float64 (M, 3)."""
    keys = Chances(0).of("looked at").exponential(size=len(scan.xyz)) / scan.area
    return scan.xyz[np.sort(np.argsort(keys, kind="stable")[:_LOOKED_AT])]


def _seen(scan: Scan, points: Float64, poses: CameraPoses, craft: Craft) -> Bool:
    """Return which points (N, 3) at least one camera sees, bool (N,)."""
    seen, reach = np.zeros(len(points), dtype=np.bool_), craft.reach(scan)
    for position, direction in zip(poses.position, poses.direction, strict=True):
        ahead = in_frame(points, position, direction, craft.cosine, reach)
        left = ahead[~seen[ahead]]
        seen[in_sight(points, left, position, scan.discs, len(left))] = True
    return seen


def _by_rings(points: Float64, positions: Float64, field_of_view: float) -> Bool:
    """Return which points lie neither too high nor too low for rings' cameras, bool (P, N)."""
    up = points[:, 2] - positions[:, 2, None]
    level = np.linalg.norm(points[:, :2] - positions[:, None, :2], axis=2)
    elevation = np.degrees(np.arctan2(up, level))
    return np.asarray(np.abs(elevation - (_TILT - 90)) <= field_of_view / 2)


def _most_showing(shown: Bool, seen: Bool) -> list[int]:
    """Return places, each the one that shows most of what those before do not.

    Parameters
    ----------
    shown : bool (P, N)
        Which points each place shows.
    seen : bool (N,)
        Which points are seen anyhow.
    """
    left = shown[:, ~seen]
    chosen: list[int] = []
    while len(chosen) < min(_RINGS, len(left)):
        gain = left.sum(axis=1)
        best = int(gain.argmax())
        if gain[best] < max(1, _ADDS * len(seen)):
            break
        chosen.append(best)
        left = left[:, ~left[best]]
    return chosen


def _tour(places: Places, chosen: list[int], widest: float) -> list[Leg]:
    """Return the legs of a flight to the chosen places, a ring at each of at most a radius."""
    if not chosen:
        return []
    from scipy.sparse.csgraph import dijkstra

    far, before = dijkstra(places.ways, indices=chosen, return_predecessors=True)
    apart = np.linalg.norm(places.position[chosen][:, None] - places.position[chosen], axis=2)
    # A place to which no way leads comes after all others.
    apart = np.where(np.isfinite(far[:, chosen]), far[:, chosen], 1e9 + apart)
    left, here = list(range(1, len(chosen))), 0
    legs = _ring(places, chosen[0], widest)
    while left:
        there = left.pop(int(apart[here][left].argmin()))
        way = _way(before[here], chosen[here], chosen[there])
        ends = places.position[way].tolist()
        legs += [Leg((*a,), (*b,), _TILT) for a, b in pairwise(ends)]
        legs += _ring(places, chosen[there], widest)
        here = there
    return legs


def _way(before: Any, start: int, end: int) -> list[int]:
    """Return the places on the way from start to end, by the place before each; none if no way."""
    way = [end]
    while way[-1] != start:
        if before[way[-1]] < 0:
            return []
        way.append(int(before[way[-1]]))
    return way[::-1]


def _ring(places: Places, place: int, widest: float) -> list[Leg]:
    """Return the legs of a ring around a place, as wide as half its clearance, or `widest`."""
    radius = min(float(places.clearance[place]) / 2, widest)
    angles = np.arange(_SIDES + 1) * (2 * math.pi / _SIDES)
    around = np.column_stack((np.cos(angles), np.sin(angles), np.zeros(_SIDES + 1)))
    ends = (places.position[place] + radius * around).tolist()
    return [Leg((*a,), (*b,), _TILT, -90.0) for a, b in pairwise(ends)]
