"""Visibility: the first keyframe with a point in its cone and range, and no surface in between.

Two coarse grids in x and y save tests: one lists, for each of its squares, the surfaces that reach
into it, so that a ray is tested only against surfaces on its way; the other lists the cameras.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from mlscli.runtime.arrays import Float64, Int32, Int64, repeated
from mlscli.runtime.kernels import inner, kernel
from mlscli.runtime.threads import in_ranges
from mlscli.scenes.surfaces import Scene, edges

# A ray ends this share of its length before the point, so that surfaces that meet in an edge do not
# hide points on it.
_SHORT_OF_END = 1e-7


class Squares(NamedTuple):
    """Surfaces or cameras by the squares of a coarse grid that they reach into.

    Attributes
    ----------
    x, y, side : float
        Least x and y of the grid, and the side of its squares, in the unit of the scene.
    columns, rows : int
        How many squares there are along x and along y.
    start : int64 (columns * rows + 1,)
        The members of square ``s = column * rows + row`` are ``start[s]`` to ``start[s + 1]``.
    members : int32 (M,)
        Indices of surfaces or cameras, ascending in each square.
    """

    x: float
    y: float
    side: float
    columns: int
    rows: int
    start: Int64
    members: Int32


class Obstacles(NamedTuple):
    """Surfaces, prepared for intersection with rays.

    Attributes
    ----------
    corner, normal : float64 (S, 3)
        As in `Surface`.
    to_u, to_v : float64 (S, 3)
        Their dot products with the vector from the corner to a point are the point's u and v on
        the surface, 0 to 1 along its edges.
    start : int64 (S + 1,)
        The openings of surface s are ``start[s]`` to ``start[s + 1]``.
    openings : float64 (O, 4)
        Least and greatest u, least and greatest v.
    squares : Squares
        The surfaces by squares.
    """

    corner: Float64
    normal: Float64
    to_u: Float64
    to_v: Float64
    start: Int64
    openings: Float64
    squares: Squares


def first_seen(
    scene: Scene,
    points: Float64,
    surface: Int32,
    cameras: Float64,
    directions: Float64,
    cosine: float,
    reach: float,
) -> Int32:
    """Return the number of the first camera that sees each point, int32 (N,); -1: none.

    Parameters
    ----------
    scene : Scene
        Its surfaces hide points, except through their openings.
    points : float64 (N, 3)
        Points on the surfaces, in the unit of the scene.
    surface : int32 (N,)
        Index of the surface that each point is on, which does not hide the point.
    cameras, directions : float64 (K, 3)
        Positions of the cameras, in the order of time, and unit vectors along which they look.
    cosine : float
        Cosine of half the field of view.
    reach : float
        How far a camera sees, in the unit of the scene.
    """
    walls = _walls(scene)
    # Squares as wide as a camera sees: a point's square and the eight around it hold all cameras
    # that may see it.
    nearby = _squares(cameras[:, :2], cameras[:, :2], reach)
    first = np.empty(len(points), dtype=np.int32)

    def work(begin: int, end: int) -> None:
        here = slice(begin, end)
        first[here] = _first_seen(
            points[here], surface[here], cameras, directions, cosine, reach, nearby, walls
        )

    in_ranges(len(points), work)
    return first


def _walls(scene: Scene) -> Obstacles:
    """Return the surfaces of a scene, upright or not, as obstacles."""
    corner, along, across = edges(scene.surfaces)
    normal = np.cross(along, across)
    square = (normal * normal).sum(axis=1)[:, None]
    counts = [len(surface.openings) for surface in scene.surfaces]
    openings = [
        (part.a_low / length, part.a_high / length, part.b_low / width, part.b_high / width)
        for surface in scene.surfaces
        for length, width in [surface.lengths]
        for part in surface.openings
    ]
    corners = np.stack([corner, corner + along, corner + across, corner + along + across])
    low, high = corners.min(axis=0)[:, :2], corners.max(axis=0)[:, :2]
    extent = float((high.max(axis=0) - low.min(axis=0)).max())
    # About as many squares as surfaces.
    side = extent / math.ceil(math.sqrt(len(counts)))
    return Obstacles(
        np.ascontiguousarray(corner),
        normal,
        np.cross(across, normal) / square,
        np.cross(normal, along) / square,
        np.concatenate(([0], np.cumsum(counts))).astype(np.int64),
        np.array(openings, dtype=np.float64).reshape(-1, 4),
        _squares(low, high, side),
    )


def _squares(low: Float64, high: Float64, side: float) -> Squares:
    """Sort things into squares by their extents.

    Parameters
    ----------
    low, high : float64 (M, 2)
        Least and greatest x and y of each thing.
    side : float
        Side of the squares; larger where there would be too many.
    """
    x, y = low.min(axis=0).tolist()
    far_x, far_y = high.max(axis=0).tolist()
    # At most about 1024 squares along each axis.
    side = max(side, (far_x - x) / 1024, (far_y - y) / 1024)
    columns, rows = int((far_x - x) / side) + 1, int((far_y - y) / side) + 1
    begin = ((low - (x, y)) / side).astype(np.int64)
    end = ((high - (x, y)) / side).astype(np.int64)
    wide, deep = (end - begin + 1).T
    member, place = repeated(wide * deep)
    column = begin[member, 0] + place // deep[member]
    square = column * rows + begin[member, 1] + place % deep[member]
    order = np.argsort(square, kind="stable")
    start = np.searchsorted(square[order], np.arange(columns * rows + 1))
    return Squares(x, y, side, columns, rows, start, member[order].astype(np.int32))


@kernel
def _first_seen(
    points: Float64,
    surface: Int32,
    cameras: Float64,
    directions: Float64,
    cosine: float,
    reach: float,
    nearby: Any,
    walls: Any,
) -> Int32:
    """Return the number of the first camera that sees each point, int32 (N,); -1: none.

    Parameters
    ----------
    points : float64 (N, 3)
    surface : int32 (N,)
    cameras, directions : float64 (K, 3)
    cosine, reach : float
        As in `first_seen`.
    nearby : Squares
        The cameras by squares whose side is at least `reach`.
    walls : Obstacles
        All surfaces.
    """
    first = np.empty(len(points), dtype=np.int32)
    for i in range(len(points)):
        x, y, z = points[i]
        best = len(cameras)
        column = math.floor((x - nearby.x) / nearby.side)
        row = math.floor((y - nearby.y) / nearby.side)
        for c in range(max(column - 1, 0), min(column + 2, nearby.columns)):
            for r in range(max(row - 1, 0), min(row + 2, nearby.rows)):
                square = c * nearby.rows + r
                for m in range(nearby.start[square], nearby.start[square + 1]):
                    k = nearby.members[m]
                    if k >= best:
                        break
                    dx, dy, dz = x - cameras[k, 0], y - cameras[k, 1], z - cameras[k, 2]
                    far = math.sqrt(dx * dx + dy * dy + dz * dz)
                    ahead = dx * directions[k, 0] + dy * directions[k, 1] + dz * directions[k, 2]
                    if (
                        far <= reach
                        and ahead >= cosine * far
                        and not _hidden(cameras[k], dx, dy, dz, surface[i], walls)
                    ):
                        best = k
        first[i] = best if best < len(cameras) else -1
    return first


@inner
def _hidden(camera: Float64, dx: float, dy: float, dz: float, own: int, walls: Any) -> bool:
    """Return whether a surface hides a point from a camera.

    Parameters
    ----------
    camera : float64 (3,)
        Position of the camera.
    dx, dy, dz : float
        From the camera to the point.
    own : int
        Index of the surface that the point is on, which does not hide it.
    walls : Obstacles
        All surfaces.
    """
    squares = walls.squares
    x, y = camera[0] - squares.x, camera[1] - squares.y
    side, margin = squares.side, 1e-9 * squares.side
    first = min(max(math.floor(min(x, x + dx) / side), 0), squares.columns - 1)
    last = min(max(math.floor(max(x, x + dx) / side), 0), squares.columns - 1)
    for column in range(first, last + 1):
        # The part of the ray that lies in this column of squares, as shares of its length.
        enter, leave = 0.0, 1.0
        if dx != 0.0:
            one = (column * side - margin - x) / dx
            other = ((column + 1) * side + margin - x) / dx
            enter, leave = max(enter, min(one, other)), min(leave, max(one, other))
        if enter > leave:
            continue
        begin, end = y + enter * dy, y + leave * dy
        low = max(math.floor((min(begin, end) - margin) / side), 0)
        high = min(math.floor((max(begin, end) + margin) / side), squares.rows - 1)
        for row in range(low, high + 1):
            square = column * squares.rows + row
            for m in range(squares.start[square], squares.start[square + 1]):
                wall = squares.members[m]
                if wall != own and _meets(camera, dx, dy, dz, wall, walls):
                    return True
    return False


@inner
def _meets(camera: Float64, dx: float, dy: float, dz: float, wall: int, walls: Any) -> bool:
    """Return whether a ray from a camera meets a surface outside its openings.

    Parameters
    ----------
    camera : float64 (3,)
        Position of the camera.
    dx, dy, dz : float
        From the camera to the end of the ray.
    wall : int
        Index of the surface.
    walls : Obstacles
        All surfaces.
    """
    normal, corner = walls.normal[wall], walls.corner[wall]
    slope = normal[0] * dx + normal[1] * dy + normal[2] * dz
    if slope == 0.0:
        return False
    to_x, to_y, to_z = corner[0] - camera[0], corner[1] - camera[1], corner[2] - camera[2]
    t = (normal[0] * to_x + normal[1] * to_y + normal[2] * to_z) / slope
    if not 0.0 < t < 1.0 - _SHORT_OF_END:
        return False
    px, py, pz = t * dx - to_x, t * dy - to_y, t * dz - to_z
    to_u, to_v = walls.to_u[wall], walls.to_v[wall]
    u = px * to_u[0] + py * to_u[1] + pz * to_u[2]
    v = px * to_v[0] + py * to_v[1] + pz * to_v[2]
    if not (0.0 <= u <= 1.0 and 0.0 <= v <= 1.0):
        return False
    for o in range(walls.start[wall], walls.start[wall + 1]):
        opening = walls.openings[o]
        if opening[0] < u < opening[1] and opening[2] < v < opening[3]:
            return False
    return True
