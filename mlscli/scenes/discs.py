"""Visibility in a scan: the points that a camera sees, and no disc in between.

Each point of a scan stands for a disc in the plane through its surroundings, as large as they are
(surface elements: Pfister et al. 2000, doi:10.1145/344779.344936). A ray from a camera to a point
that meets another disc on its way is hidden, as rays over a scene are by its surfaces: at any
angle, and whatever lies how far away. A disc hides nothing that is as near to its plane as the
points are from which the plane was made.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from mlscli.runtime.arrays import Bool, Float64, Int32, Int64
from mlscli.runtime.kernels import inner, kernel
from mlscli.runtime.threads import WORTHWHILE, in_ranges

# At most this many boxes for each disc, or the second in all if that is more.
_BOXES_EACH, _BOXES = 2.0, 100_000
# Into how many boxes a disc may reach on average.
_REACHED = 30.0
# The square of the greatest slope by which a disc's plane is in doubt.
_TILT = 0.25


class Discs(NamedTuple):
    """Discs, sorted into the boxes of a coarse grid that they reach into.

    Attributes
    ----------
    centre, normal : float64 (N, 3)
        Centres, in the unit of the scan, and unit normals to either side.
    radius, depth : float64 (N,)
        Radii above 0, and how near to its plane a disc hides nothing, in the unit of the scan.
    low : float64 (3,)
        The lowest corner of the grid.
    side : float
        Side of the boxes.
    shape : int64 (3,)
        How many boxes there are along x, y and z.
    start : int64 (boxes + 1,)
        The members of box ``b = (i * shape[1] + j) * shape[2] + k`` are ``start[b]`` to
        ``start[b + 1]``.
    members : int32 (M,)
        Indices of discs, ascending in each box.
    """

    centre: Float64
    normal: Float64
    radius: Float64
    depth: Float64
    low: Float64
    side: float
    shape: Int64
    start: Int64
    members: Int32


def discs(centre: Float64, normal: Float64, radius: Float64, depth: Float64) -> Discs:
    """Sort discs into boxes.

    Parameters
    ----------
    centre, normal, radius, depth
        As in `Discs`; at least one disc.
    """
    low, high = (centre - radius[:, None]).min(axis=0), (centre + radius[:, None]).max(axis=0)
    extent = high - low
    most = max(_BOXES, _BOXES_EACH * len(centre))
    side = max(2 * float(np.median(radius)), float(extent.max()) / 2**20)
    while (
        float(np.prod(np.floor(extent / side) + 1)) > most
        or float(((2 * radius / side + 1) ** 3).mean()) > _REACHED
    ):
        side *= 1.25
    shape = (extent / side).astype(np.int64) + 1
    start, members = _sorted(centre, radius, low, side, shape)
    return Discs(centre, normal, radius, depth, low, side, shape, start, members)


def sights(points: Float64, cameras: Float64, reach: float, obstacles: Discs) -> Bool:
    """Return which points are seen, in any direction, from which positions, bool (K, N).

    Parameters
    ----------
    points : float64 (N, 3)
        In the unit of the scan.
    cameras : float64 (K, 3)
        Positions.
    reach : float
        How far one sees, in the unit of the scan.
    obstacles : Discs
    """
    seen = np.zeros((len(cameras), len(points)), dtype=np.bool_)

    def work(begin: int, end: int) -> None:
        for number in range(begin, end):
            away = points - cameras[number]
            near = np.flatnonzero((away * away).sum(axis=1) <= reach * reach)
            found = in_sight(points, near, cameras[number], obstacles, len(near))
            seen[number, found] = True

    in_ranges(len(cameras), work, weight=WORTHWHILE)
    return seen


@kernel
def in_frame(
    points: Float64, camera: Float64, direction: Float64, cosine: float, reach: float
) -> Int64:
    """Return the points in a camera's cone and range, seen or not, int64 (M,).

    Parameters
    ----------
    points : float64 (N, 3)
        In the unit of the scan.
    camera, direction : float64 (3,)
        Position of the camera, and the unit vector along which it looks.
    cosine : float
        Cosine of half the field of view.
    reach : float
        How far it sees, in the unit of the scan.
    """
    found = np.empty(len(points), dtype=np.int64)
    count = 0
    for i in range(len(points)):
        dx, dy, dz = points[i, 0] - camera[0], points[i, 1] - camera[1], points[i, 2] - camera[2]
        far = math.sqrt(dx * dx + dy * dy + dz * dz)
        ahead = dx * direction[0] + dy * direction[1] + dz * direction[2]
        if far <= reach and ahead >= cosine * far:
            found[count] = i
            count += 1
    return found[:count]


@inner
def _box(place: float, low: float, side: float, count: int) -> int:
    """Return the number of the box along one axis, within the grid."""
    return min(max(math.floor((place - low) / side), 0), count - 1)


@inner
def boxes_around(
    centre: Float64, radius: float, low: Float64, side: float, shape: Any
) -> tuple[int, int, int, int, int, int]:
    """Return which boxes a disc may reach into: i, j and k of the first, and one past the last.

    Parameters
    ----------
    centre : float64 (3,)
        Centre of the disc.
    radius : float
        Its radius.
    low, side, shape
        As in `Discs`.
    """
    return (
        _box(centre[0] - radius, low[0], side, shape[0]),
        _box(centre[1] - radius, low[1], side, shape[1]),
        _box(centre[2] - radius, low[2], side, shape[2]),
        _box(centre[0] + radius, low[0], side, shape[0]) + 1,
        _box(centre[1] + radius, low[1], side, shape[1]) + 1,
        _box(centre[2] + radius, low[2], side, shape[2]) + 1,
    )


@kernel
def _sorted(
    centre: Float64, radius: Float64, low: Float64, side: float, shape: Int64
) -> tuple[Int64, Int32]:
    """Return `start` and `members` of all boxes; both, and the parameters, are as in `Discs`."""
    count = np.zeros(1 + shape[0] * shape[1] * shape[2], dtype=np.int64)
    for n in range(len(centre)):
        a, b, c, d, e, f = boxes_around(centre[n], radius[n], low, side, shape)
        for i in range(a, d):
            for j in range(b, e):
                for k in range(c, f):
                    count[1 + (i * shape[1] + j) * shape[2] + k] += 1
    start = np.cumsum(count)
    members, place = np.empty(start[-1], dtype=np.int32), start.copy()
    for n in range(len(centre)):
        a, b, c, d, e, f = boxes_around(centre[n], radius[n], low, side, shape)
        for i in range(a, d):
            for j in range(b, e):
                for k in range(c, f):
                    box = (i * shape[1] + j) * shape[2] + k
                    members[place[box]] = n
                    place[box] += 1
    return start, members


@kernel
def in_sight(points: Float64, chosen: Int64, camera: Float64, obstacles: Any, most: int) -> Int64:
    """Return the first `most` of the chosen points that a camera sees, int64 (M,).

    Parameters
    ----------
    points : float64 (N, 3)
        In the unit of the scan.
    chosen : int64 (C,)
        Indices of points, in the order in which they are looked for.
    camera : float64 (3,)
        Position of the camera.
    obstacles : Discs
    most : int
        Where so many are seen, the search ends.
    """
    found = np.empty(min(most, len(chosen)), dtype=np.int64)
    count = 0
    for i in chosen:
        if count == len(found):
            break
        if not _hidden(camera, points[i], obstacles):
            found[count] = i
            count += 1
    return found[:count]


@inner
def _hidden(camera: Float64, point: Float64, discs: Any) -> bool:
    """Return whether a disc hides a point (3,) from a camera (3,).

    The ray is followed from the point through the boxes that it crosses, one after the other
    (Amanatides and Woo 1987).
    """
    low, side, shape = discs.low, discs.side, discs.shape
    # The part of the ray within the grid, as shares of its length from the point to the camera.
    leave = 1.0
    for axis in range(3):
        along = camera[axis] - point[axis]
        if along > 0.0:
            leave = min(leave, (low[axis] + side * shape[axis] - point[axis]) / along)
        elif along < 0.0:
            leave = min(leave, (low[axis] - point[axis]) / along)
    i = _box(point[0], low[0], side, shape[0])
    j = _box(point[1], low[1], side, shape[1])
    k = _box(point[2], low[2], side, shape[2])
    step_x, next_x, every_x = _pace(point[0], camera[0], low[0], side, i)
    step_y, next_y, every_y = _pace(point[1], camera[1], low[1], side, j)
    step_z, next_z, every_z = _pace(point[2], camera[2], low[2], side, k)
    while True:
        box = (i * shape[1] + j) * shape[2] + k
        for m in range(discs.start[box], discs.start[box + 1]):
            if _meets(camera, point, discs.members[m], discs):
                return True
        if next_x <= next_y and next_x <= next_z:
            if next_x > leave:
                return False
            i, next_x = i + step_x, next_x + every_x
        elif next_y <= next_z:
            if next_y > leave:
                return False
            j, next_y = j + step_y, next_y + every_y
        else:
            if next_z > leave:
                return False
            k, next_z = k + step_z, next_z + every_z
        if not (0 <= i < shape[0] and 0 <= j < shape[1] and 0 <= k < shape[2]):
            return False


@inner
def _pace(begin: float, end: float, low: float, side: float, box: int) -> tuple[int, float, float]:
    """Return how a ray runs along one axis: step, and shares of its length to and between borders.

    Parameters
    ----------
    begin, end : float
        Where it begins and ends.
    low, side : float
        As in `Discs`.
    box : int
        Number of the box in which it begins.
    """
    if end > begin:
        return 1, (low + (box + 1) * side - begin) / (end - begin), side / (end - begin)
    if end < begin:
        return -1, (low + box * side - begin) / (end - begin), side / (begin - end)
    return 0, math.inf, math.inf


@inner
def _meets(camera: Float64, point: Float64, disc: int, discs: Any) -> bool:
    """Return whether a disc hides a point (3,) from a camera (3,)."""
    nx, ny, nz = discs.normal[disc, 0], discs.normal[disc, 1], discs.normal[disc, 2]
    x = point[0] - discs.centre[disc, 0]
    y = point[1] - discs.centre[disc, 1]
    z = point[2] - discs.centre[disc, 2]
    dx, dy, dz = camera[0] - point[0], camera[1] - point[1], camera[2] - point[2]
    height, slope = nx * x + ny * y + nz * z, nx * dx + ny * dy + nz * dz
    size, depth = discs.radius[disc] * discs.radius[disc], discs.depth[disc]
    # As the plane is known, it may be tilted by its depth at the disc's edge: by half at most.
    tilted = min(depth * depth / size, _TILT) * (x * x + y * y + z * z)
    if height * height <= max(depth * depth, tilted) or slope == 0.0:
        return False
    t = -height / slope
    if not 0.0 < t < 1.0:
        return False
    x, y, z = x + t * dx, y + t * dy, z + t * dz
    return bool(x * x + y * y + z * z <= size)
