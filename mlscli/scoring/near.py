"""Which points lie near other points, and near triangles: exact, by square columns of points.

Columns stand on a grid of squares in x and y; in each the points ascend by height. What lies within
a distance is looked for in the columns that the distance can reach, between two heights.
"""

from __future__ import annotations

import math
from numbers import Real
from typing import NamedTuple

import numpy as np

from mlscli.errors import InputError, UsageError, expect
from mlscli.keyframes.keyframe import require_points
from mlscli.maps.cells import GREATEST_INDEX, LEAST_INDEX, cell_of, key_of, on_grid, pack
from mlscli.pipeline.stages.ordering import cells_of, order_by_cell
from mlscli.pipeline.stages.point_grid import first_from
from mlscli.runtime.arrays import Array, Bool, Float64, Int64, UInt8, UInt64
from mlscli.runtime.kernels import inner, kernel
from mlscli.runtime.sorting import place_of
from mlscli.runtime.threads import in_ranges

# How near a flight must come to a point of a scan to have seen it, in distances.
SEEN = 3

# Outweighs the rounding of coordinates, so that no column within a distance is left out.
_MARGIN = 1 + 1e-9

# A triangle whose corner has a squared sine of no more than this is a line.
_THIN = 1e-12

_Box = tuple[int, int, int, int]


class PointColumns(NamedTuple):
    """Points by column, and by height in each.

    Attributes
    ----------
    side : float
        Side of a column, in the unit of the points.
    keys : uint64 (C,)
        Packed indices of the columns that hold points, ascending.
    start : int64 (C + 1,)
        Where the points of each column begin.
    order : uint32 (N,)
        The number of the point that comes at each place; int64 for 2^32 points or more.
    xyz : float64 (N, 3)
        The points in this order.
    """

    side: float
    keys: UInt64
    start: Int64
    order: Array
    xyz: Float64

    @classmethod
    def of(cls, xyz: Float64, side: float) -> PointColumns:
        """Return the columns of points (N, 3), all in columns whose indices int32 can hold."""
        order, cells, _ = order_by_cell(*cells_of(xyz, side), xyz[:, 2])
        return cls(side, pack(cells.ix, cells.iy), cells.start, order, xyz[order])


def checked_scan(scan: Array, within: float) -> Float64:
    """Return the points of a scan as float64 (N, 3).

    Parameters
    ----------
    scan : (N, 3), of any numbers
    within : float
        The distance at which something is compared with it, in its unit.

    Raises
    ------
    TypeError, UsageError
        Where this is no array of finite points, or the distance is not above 0, or so small that
        int32 cannot number the columns of half of it.
    InputError
        Where there are no points.
    """
    points = _checked(scan, "scan")
    expect(within, Real, "within", "a number above 0")
    if not 0 < within < math.inf:
        raise UsageError(f"`within` {within!r}: expected a number above 0")
    if not on_grid(points, within / 2).all():
        farthest = float(np.abs(points[:, :2]).max())
        raise UsageError(
            f"`within` {within:g}: too small for coordinates of up to {farthest:g}; expected at "
            f"least {farthest * 2.0**-29:.2g}"
        )
    return points


def seen_by(flight: Array, scan: Array, within: float) -> Bool:
    """Return which points of a scan a flight came near, bool (N,).

    Parameters
    ----------
    flight : (M, 3), of any numbers
        The points that the map was made of, before any filter.
    scan : (N, 3), of any numbers
        The points of the scan, in the same frame and unit.
    within : float
        The distance at which the map is scored: a point of the scan counts where one of the flight
        is within `SEEN` times this.

    Raises
    ------
    TypeError, UsageError, InputError
        As `checked_scan`, for both.
    """
    points, distance = checked_scan(scan, within), SEEN * within
    flown = _checked(flight, "flight")
    # Those beyond are far from all of the scan.
    flown = flown[on_grid(flown, distance)]
    return are_near(points, PointColumns.of(flown, distance), distance)


def _checked(points: Array, name: str) -> Float64:
    require_points(points, name)
    if not len(points):
        raise InputError(f"the {name} holds no points")
    if not np.isfinite(points).all():
        raise UsageError(f"`{name}`: not all coordinates are finite numbers")
    return np.ascontiguousarray(points, dtype=np.float64)


def are_near(xyz: Float64, others: PointColumns, distance: float) -> Bool:
    """Return which points (N, 3) have one of the others within a distance, bool (N,)."""
    near = np.empty(len(xyz), dtype=np.bool_)
    in_ranges(
        len(xyz), lambda begin, end: _are_near(xyz[begin:end], others, distance, near[begin:end])
    )
    return near


@kernel
def _are_near(xyz: Float64, others: PointColumns, distance: float, near: Bool) -> None:
    for i in range(len(xyz)):
        near[i] = is_near(xyz[i, 0], xyz[i, 1], xyz[i, 2], others, distance)


@inner
def is_near(x: float, y: float, z: float, others: PointColumns, distance: float) -> bool:
    """Return whether one of the others lies within a distance of a point."""
    xyz, start = others.xyz, others.start
    low, high = z - distance * _MARGIN, z + distance * _MARGIN
    box = box_around(x, x, y, y, distance, others.side)
    column = first_within(others.keys, 0, box)
    while column < len(start) - 1:
        for i in range(first_from(xyz, start[column], start[column + 1], low), start[column + 1]):
            if xyz[i, 2] > high:
                break
            dx, dy, dz = xyz[i, 0] - x, xyz[i, 1] - y, xyz[i, 2] - z
            if dx * dx + dy * dy + dz * dz <= distance * distance:
                return True
        column = first_within(others.keys, column + 1, box)
    return False


@inner
def box_around(
    west: float, east: float, south: float, north: float, distance: float, side: float
) -> _Box:
    """Return the box of columns within a distance of a rectangle: least and greatest ix, and iy.

    Parameters
    ----------
    west, east, south, north : float
        The rectangle.
    distance : float
        In the same unit.
    side : float
        Side of a column.
    """
    far = distance * _MARGIN
    return (
        int(max(np.floor((west - far) / side), LEAST_INDEX)),
        int(min(np.floor((east + far) / side), GREATEST_INDEX)),
        int(max(np.floor((south - far) / side), LEAST_INDEX)),
        int(min(np.floor((north + far) / side), GREATEST_INDEX)),
    )


@inner
def first_within(keys: UInt64, column: int, box: _Box) -> int:
    """Return the first of the columns, from one on, that lies in a box; their number if none does.

    Parameters
    ----------
    keys : uint64 (C,)
        Packed indices of columns, ascending.
    column : int
        The number of the column to begin with.
    box : (int, int, int, int)
        As `box_around` returns it.
    """
    if box[0] > box[1] or box[2] > box[3]:
        return len(keys)
    while column < len(keys):
        ix, iy = cell_of(keys[column])
        if ix > box[1] or (ix == box[1] and iy > box[3]):
            return len(keys)
        if box[0] <= ix and box[2] <= iy <= box[3]:
            return column
        following = max(ix + (iy > box[3]), box[0])
        column += place_of(keys[column:], key_of(following, box[2]))
    return len(keys)


def near_triangles(
    points: PointColumns, corners: Float64, group: UInt8, groups: int, distance: float
) -> Bool:
    """Return which points lie within a distance of triangles, by the triangles' group.

    Parameters
    ----------
    points : PointColumns
    corners : float64 (T, 3, 3)
        The corners of each triangle; they may coincide.
    group : uint8 (T,)
        The group of each triangle.
    groups : int
        How many groups there are.
    distance : float
        The greatest distance, inclusive, in the unit of the points.

    Returns
    -------
    bool (groups, N)
        In the order of the columns.
    """
    near = np.zeros((groups, len(points.xyz)), dtype=np.bool_)

    def mark(begin: int, end: int) -> None:
        _mark(points, corners[begin:end], group[begin:end], distance, near)

    in_ranges(len(corners), mark)
    return near


@kernel
def _mark(
    points: PointColumns, corners: Float64, group: UInt8, distance: float, near: Bool
) -> None:
    xyz, start, far = points.xyz, points.start, distance * _MARGIN
    for t in range(len(corners)):
        a, b, c = corners[t]
        west, east = min(a[0], b[0], c[0]), max(a[0], b[0], c[0])
        south, north = min(a[1], b[1], c[1]), max(a[1], b[1], c[1])
        low, high = min(a[2], b[2], c[2]) - far, max(a[2], b[2], c[2]) + far
        marks = near[group[t]]
        box = box_around(west, east, south, north, distance, points.side)
        column = first_within(points.keys, 0, box)
        while column < len(start) - 1:
            begin, end = start[column], start[column + 1]
            for i in range(first_from(xyz, begin, end, low), end):
                if xyz[i, 2] > high:
                    break
                # Another thread may mark it meanwhile: nothing but True may be written.
                if not marks[i] and _squared(xyz[i], a, b, c) <= distance * distance:
                    marks[i] = True
            column = first_within(points.keys, column + 1, box)


@inner
def _squared(point: Float64, a: Float64, b: Float64, c: Float64) -> float:
    """Return the squared distance of a point to a triangle, whose corners may coincide.

    The nearest place is inside, if the foot of the perpendicular is; else it is on an edge, as it
    is, but for rounding, in a triangle that is no more than a line.
    """
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    px, py, pz = point[0] - a[0], point[1] - a[1], point[2] - a[2]
    uu, vv = ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz
    uv = ux * vx + uy * vy + uz * vz
    pu, pv = px * ux + py * uy + pz * uz, px * vx + py * vy + pz * vz
    # The foot is a + (s u + t v) / d.
    d = uu * vv - uv * uv
    s, t = vv * pu - uv * pv, uu * pv - uv * pu
    if d > _THIN * uu * vv and s >= 0 and t >= 0 and s + t <= d:
        s, t = s / d, t / d
        x, y, z = px - s * ux - t * vx, py - s * uy - t * vy, pz - s * uz - t * vz
        return float(x * x + y * y + z * z)
    squared = _squared_to_edge(point, a, b)
    squared = min(squared, _squared_to_edge(point, b, c))
    return min(squared, _squared_to_edge(point, c, a))


@inner
def _squared_to_edge(point: Float64, a: Float64, b: Float64) -> float:
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    px, py, pz = point[0] - a[0], point[1] - a[1], point[2] - a[2]
    length, along = ux * ux + uy * uy + uz * uz, px * ux + py * uy + pz * uz
    t = min(1.0, max(0.0, along / length)) if length > 0 else 0.0
    x, y, z = px - t * ux, py - t * uy, pz - t * uz
    return float(x * x + y * y + z * z)
