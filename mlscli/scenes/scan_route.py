"""The route through a scan: a survey from above, and rings in the free space that shows the rest.

Free space is looked for in boxes: those far enough from every point, with points below, so that
none lies under the ground. Where a craft could be, it would turn once round, on a ring, its
camera outwards. Rings are chosen one after the other, each where it sees the most of what is not
yet seen, until the next would see next to nothing (greedy covering, as in planning the next best
view: Connolly 1985, doi:10.1109/ROBOT.1985.1087372). The survey is left out where what lies under
cover sees nearly all: indoors.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from mlscli.runtime.arrays import Bool, Float64, Int64
from mlscli.scenes.discs import in_sight, sights
from mlscli.scenes.noise import Chances
from mlscli.scenes.route import CameraPoses, poses_along, survey
from mlscli.scenes.scans import Scan
from mlscli.scenes.surfaces import Leg

# Boxes in which free space is looked for, positions in it, points looked at, and rings, at most.
_BOXES, _PLACES, _LOOKED_AT, _RINGS = 2_000_000, 500, 3000, 150
# A craft keeps so many boxes away from every point.
_CLEARANCE = 2.0
# A ring adds at least this share of the scan, the survey that one.
_ADDS, _SURVEY_ADDS = 0.002, 0.1
_SIDES = 6
_TILT = 80.0


class _Places(NamedTuple):
    """Places where a craft could be.

    Attributes
    ----------
    position : float64 (P, 3)
    clearance : float64 (P,)
        Distance of the nearest point, in the unit of the scan.
    covered : bool (P,)
        Whether points lie above.
    """

    position: Float64
    clearance: Float64
    covered: Bool


def find_legs(scan: Scan, height: float, reach: float, field_of_view: float) -> list[Leg]:
    """Return the legs of a route that shows what of a scan can be shown.

    Parameters
    ----------
    scan : Scan
    height : float
        Height of the survey above the scan's top, in the unit of the scan.
    reach : float
        How far the camera sees.
    field_of_view : float
        The whole angle of the cone that the camera sees, in degrees.
    """
    lanes = survey(scan, height)
    above = poses_along(lanes, height)
    points = _looked_at(scan)
    from_above = _seen_by_cameras(scan, points, above, reach, field_of_view)
    places = _places(scan)
    shown = sights(points, places.position, reach, scan.discs)
    seen = shown[_most_showing(shown, places.covered, np.zeros(len(points), np.bool_))].any(axis=0)
    flown = (from_above & ~seen).mean() >= _SURVEY_ADDS
    legs = lanes if flown else []
    chosen = _most_showing(shown, np.ones(len(shown), np.bool_), from_above & flown)
    for place in _tour(places.position[chosen]):
        legs += _ring(places.position[chosen][place], places.clearance[chosen][place] / 2)
    return legs


def _looked_at(scan: Scan) -> Float64:
    """Return some points, spread evenly over the area of the scan."""
    area = np.minimum(scan.radius, 4 * scan.spacing) ** 2
    keys = Chances(0).of("looked at").exponential(size=len(area)) / np.maximum(area, 1e-300)
    return scan.xyz[np.sort(np.argsort(keys, kind="stable")[:_LOOKED_AT])]


def _seen_by_cameras(
    scan: Scan, points: Float64, poses: CameraPoses, reach: float, field_of_view: float
) -> Bool:
    """Return which points (N, 3) at least one camera sees, bool (N,)."""
    cosine = math.cos(math.radians(min(field_of_view, 360.0) / 2))
    seen = np.zeros(len(points), dtype=np.bool_)
    for position, direction in zip(poses.position, poses.direction, strict=True):
        away = points - position
        far = np.sqrt((away * away).sum(axis=1))
        chosen = np.flatnonzero(~seen & (far <= reach) & (away @ direction >= cosine * far))
        seen[in_sight(points, chosen, position, scan.discs, len(chosen))] = True
    return seen


def _places(scan: Scan) -> _Places:
    """Return places spread over the free space, each the freest around."""
    from scipy.ndimage import distance_transform_edt

    low, high = scan.bounds
    side = max(1.5 * scan.spacing, float(np.prod(high - low + scan.spacing) / _BOXES) ** (1 / 3))
    margin = 4 * math.ceil(_CLEARANCE)
    shape = tuple(((high - low) / side).astype(np.int64) + 1 + 2 * margin)
    at = ((scan.solid - low) / side).astype(np.int64) + margin
    taken = np.zeros(shape, dtype=np.bool_)
    taken[tuple(at.T)] = True
    clearance = distance_transform_edt(~taken)
    below = np.logical_or.accumulate(taken, axis=2)
    above = np.logical_or.accumulate(taken[:, :, ::-1], axis=2)[:, :, ::-1]
    free = np.flatnonzero((clearance >= _CLEARANCE) & below)
    block = 3
    while True:
        best = _freest(free, clearance.ravel(), shape, block)
        if len(best) <= _PLACES:
            break
        block += 1
    index = np.column_stack(np.unravel_index(best, shape))
    position = low + (index - margin + 0.5) * side
    return _Places(position, clearance.ravel()[best] * side, above.ravel()[best])


def _freest(free: Int64, clearance: Float64, shape: tuple[int, ...], block: int) -> Int64:
    """Return of each block of boxes the free one that is farthest from all points."""
    index = np.column_stack(np.unravel_index(free, shape)) // block
    counts = np.array(shape) // block + 1
    label = (index[:, 0] * counts[1] + index[:, 1]) * counts[2] + index[:, 2]
    order = np.lexsort((free, -clearance[free], label))
    first = np.unique(label[order], return_index=True)[1]
    return free[order[first]]


def _most_showing(shown: Bool, allowed: Bool, seen: Bool) -> list[int]:
    """Return places, each the one that shows most of what those before do not.

    Parameters
    ----------
    shown : bool (P, N)
        Which points each place shows.
    allowed : bool (P,)
        The places to choose from.
    seen : bool (N,)
        Which points are seen anyhow.
    """
    left = shown[:, ~seen] & allowed[:, None]
    chosen: list[int] = []
    while len(chosen) < min(_RINGS, len(left)):
        gain = left.sum(axis=1)
        best = int(gain.argmax())
        if gain[best] < max(1, _ADDS * len(seen)):
            break
        chosen.append(best)
        left = left[:, ~left[best]]
    return chosen


def _tour(positions: Float64) -> list[int]:
    """Return an order of positions (N, 3): from the lowest on, always to the nearest left."""
    left = list(range(len(positions)))
    order: list[int] = []
    while left:
        if order:
            away = np.linalg.norm(positions[left] - positions[order[-1]], axis=1)
            place = int(away.argmin())
        else:
            place = int(positions[:, 2].argmin())
        order.append(left.pop(place))
    return order


def _ring(centre: Float64, radius: float) -> list[Leg]:
    """Return the legs of a ring around a centre (3,), the camera outwards."""
    angles = np.arange(_SIDES + 1) * (2 * math.pi / _SIDES)
    corners = centre + radius * np.column_stack(
        (np.cos(angles), np.sin(angles), np.zeros(_SIDES + 1))
    )
    ends = corners.tolist()
    return [Leg((*start,), (*end,), _TILT, -90.0) for start, end in pairwise(ends)]
