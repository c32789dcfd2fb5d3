"""Footprints of surfaces in cells: exact areas and heights, from rectangles clipped to cells."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from mlscli.runtime.arrays import Array, Bool, Float64, Int64
from mlscli.runtime.kernels import inner, kernel
from mlscli.scenes.surfaces import Surface, edges


class Footprints(NamedTuple):
    """Parts of surfaces, each within one cell.

    Attributes
    ----------
    ix, iy : int64 (F,)
        Indices of the cell.
    plane : int64 (F,)
        Number of the plane that the surface lies in: surfaces in one plane count together.
    share : float64 (F,)
        Of a level or sloping part, its area seen from above, in areas of a cell; of an upright
        one, its length seen from above, in sides of a cell.
    slant : float64 (F,)
        Area of the surface over its area seen from above; 1 for upright ones.
    low, high, mean, variance : float64 (F,)
        Lowest, highest and mean height of the part, and the variance of its heights, over its
        area (of an upright one: as if uniform between the ends); in the unit of the scene, the
        variance in its square.
    rise : float64 (F,)
        By how much the lower and the upper edge of an upright part rise within it; 0 for others.
    """

    ix: Int64
    iy: Int64
    plane: Int64
    share: Float64
    slant: Float64
    low: Float64
    high: Float64
    mean: Float64
    variance: Float64
    rise: Float64

    def take(self, which: Bool | Int64) -> Footprints:
        """Return the parts that a mask or indices choose."""
        columns: list[Any] = [column[which] for column in self]
        return Footprints(*columns)


def footprints(surfaces: Sequence[Surface], cell_size: float) -> tuple[Footprints, Footprints]:
    """Return the footprints of level or sloping surfaces, and those of upright ones."""
    planes, slants = _planes(surfaces), np.array([_slant(surface) for surface in surfaces])
    parts: list[Footprints] = []
    for upright, clip in ((False, _clip_flat), (True, _clip_upright)):
        chosen = [number for number, surface in enumerate(surfaces) if surface.upright == upright]
        owner, corner, along, across = _solid([surfaces[number] for number in chosen])
        piece, ix, iy, share, *heights = clip(corner, along, across, cell_size)
        heights += [] if upright else [np.zeros(len(ix))]
        surface = np.array(chosen, dtype=np.int64)[owner[piece]]
        parts.append(Footprints(ix, iy, planes[surface], share, slants[surface], *heights))
    return parts[0], parts[1]


def cells_spanned(surfaces: Sequence[Surface], cell_size: float) -> float:
    """Return an upper bound of how many cells the surfaces reach into, without clipping any."""
    _, along, across = edges(surfaces)
    width = (np.abs(along[:, :2]) + np.abs(across[:, :2])) / cell_size + 2
    return float(width.prod(axis=1).sum())


def _planes(surfaces: Sequence[Surface]) -> Int64:
    """Return the number of each surface's plane, int64 (S,).

    Planes are the same where normal and offset agree to nine decimals.
    """
    corner, along, across = edges(surfaces)
    normal = np.cross(along, across)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    # Of the two normals of a plane, take the one whose first component other than 0 is positive.
    rounded = np.round(normal, 9)
    first = np.take_along_axis(rounded, (rounded != 0).argmax(axis=1)[:, None], axis=1)
    normal *= np.sign(first)
    offset = (normal * corner).sum(axis=1)
    keys = np.round(np.column_stack((normal, offset)), 9) + 0.0
    _, number = np.unique(keys, axis=0, return_inverse=True)
    return np.asarray(number, dtype=np.int64).reshape(-1)


def _slant(surface: Surface) -> float:
    """Return the area of a surface over its area seen from above; 1 for an upright one."""
    return 1.0 if surface.upright else math.hypot(*surface.normal) / abs(surface.normal[2])


def _solid(surfaces: Sequence[Surface]) -> tuple[Int64, Float64, Float64, Float64]:
    """Return the surfaces as rectangles without openings.

    Returns
    -------
    owner : int64 (R,)
        Index of the surface that each rectangle is a part of.
    corner, along, across : float64 (R, 3)
        A corner of each rectangle and the edges that leave it, as in `Surface`.
    """
    parts = [_around(surface) for surface in surfaces]
    owner = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    u_low, u_high, v_low, v_high = np.array(
        [rectangle for part in parts for rectangle in part], dtype=np.float64
    ).reshape(-1, 4).T[:, :, None]  # fmt: skip
    corner, along, across = (edge[owner] for edge in edges(surfaces))
    corner = corner + u_low * along + v_low * across
    return owner, corner, (u_high - u_low) * along, (v_high - v_low) * across


def _around(surface: Surface) -> list[tuple[float, float, float, float]]:
    """Return the parts of a surface around its openings.

    They are rectangles u_low, u_high, v_low, v_high, as shares (0 to 1) of `along` and `across`.
    """
    if not surface.openings:
        return [(0.0, 1.0, 0.0, 1.0)]
    length, width = surface.lengths
    holes = [
        (part.a_low / length, part.a_high / length, part.b_low / width, part.b_high / width)
        for part in surface.openings
    ]
    cuts = sorted({0.0, 1.0, *(min(max(u, 0.0), 1.0) for hole in holes for u in hole[:2])})
    rectangles = []
    for low, high in pairwise(cuts):
        reached = 0.0
        beside = [hole[2:] for hole in holes if hole[0] < high and hole[1] > low]
        for begin, end in sorted(beside):
            if begin > reached:
                rectangles.append((low, high, reached, min(begin, 1.0)))
            reached = max(reached, end)
        if reached < 1.0:
            rectangles.append((low, high, reached, 1.0))
    return rectangles


@kernel
def _clip_flat(
    corner: Float64, along: Float64, across: Float64, cell_size: float
) -> tuple[Array, ...]:
    """Clip rectangles, seen from above, to the cells.

    Parameters
    ----------
    corner, along, across : float64 (R, 3)
        The rectangles, as `_solid` returns them.
    cell_size : float

    Returns
    -------
    rectangle, ix, iy : int64 (F,)
        The rectangle that each part is cut from, and its cell.
    share, low, high, mean, variance : float64 (F,)
        As in `Footprints`.
    """
    size = 0
    for r in range(len(corner)):
        x0, x1, y0, y1 = _cells_of(corner[r], along[r], across[r], cell_size)
        size += (x1 - x0 + 1) * (y1 - y0 + 1)
    where = np.empty((3, size), dtype=np.int64)
    values = np.empty((5, size))
    polygon, clipped = np.empty((12, 3)), np.empty((12, 3))
    found = 0
    for r in range(len(corner)):
        x0, x1, y0, y1 = _cells_of(corner[r], along[r], across[r], cell_size)
        for ix in range(x0, x1 + 1):
            for iy in range(y0, y1 + 1):
                sides = _corners(corner[r], along[r], across[r], polygon)
                for axis in range(2):
                    edge = (ix if axis == 0 else iy) * cell_size
                    sides = _cut(polygon, sides, axis, edge, 1.0, clipped)
                    sides = _cut(clipped, sides, axis, edge + cell_size, -1.0, polygon)
                area, mean, variance = _heights(polygon, sides)
                if area > 0.0:
                    where[0, found], where[1, found], where[2, found] = r, ix, iy
                    values[0, found] = area / (cell_size * cell_size)
                    lowest = highest = polygon[0, 2]
                    for i in range(1, sides):
                        lowest, highest = min(lowest, polygon[i, 2]), max(highest, polygon[i, 2])
                    values[1, found], values[2, found] = lowest, highest
                    values[3, found], values[4, found] = mean, variance
                    found += 1
    where, values = where[:, :found], values[:, :found]
    return where[0], where[1], where[2], values[0], values[1], values[2], values[3], values[4]


@inner
def _cells_of(
    corner: Float64, along: Float64, across: Float64, cell_size: float
) -> tuple[int, int, int, int]:
    """Return the least and the greatest ix, then iy, of the cells that a rectangle may reach."""
    low, high = np.empty(2), np.empty(2)
    for axis in range(2):
        low[axis] = corner[axis] + min(along[axis], 0.0) + min(across[axis], 0.0)
        high[axis] = corner[axis] + max(along[axis], 0.0) + max(across[axis], 0.0)
    return (
        math.floor(low[0] / cell_size),
        math.floor(high[0] / cell_size),
        math.floor(low[1] / cell_size),
        math.floor(high[1] / cell_size),
    )


@inner
def _corners(corner: Float64, along: Float64, across: Float64, polygon: Float64) -> int:
    """Write the corners of a rectangle to the first rows of `polygon`; return their number, 4.

    Here and in `_cut` each coordinate is computed by itself: sums of rows take seconds to compile.
    """
    for axis in range(3):
        polygon[0, axis] = corner[axis]
        polygon[1, axis] = corner[axis] + along[axis]
        polygon[2, axis] = corner[axis] + along[axis] + across[axis]
        polygon[3, axis] = corner[axis] + across[axis]
    return 4


@inner
def _cut(polygon: Float64, sides: int, axis: int, edge: float, sign: float, result: Float64) -> int:
    """Cut a convex polygon along a line ``x = edge`` or ``y = edge``.

    Parameters
    ----------
    polygon : float64 (12, 3)
        Its corners, in the first rows.
    sides : int
        How many corners it has.
    axis : int
        0: the line is ``x = edge``; 1: ``y = edge``.
    edge : float
    sign : float
        1 keeps the part with greater coordinates, -1 that with smaller ones.
    result : float64 (12, 3)
        Where the corners of that part are written.

    Returns
    -------
    int
        How many corners the part has; 0 where nothing is left.
    """
    kept = 0
    for i in range(sides):
        after = (i + 1) % sides
        inside = (polygon[i, axis] - edge) * sign
        next_inside = (polygon[after, axis] - edge) * sign
        if inside >= 0.0:
            for k in range(3):
                result[kept, k] = polygon[i, k]
            kept += 1
        if (inside > 0.0 and next_inside < 0.0) or (inside < 0.0 and next_inside > 0.0):
            way = inside / (inside - next_inside)
            for k in range(3):
                result[kept, k] = polygon[i, k] + way * (polygon[after, k] - polygon[i, k])
            result[kept, axis] = edge
            kept += 1
    return kept


@inner
def _heights(polygon: Float64, sides: int) -> tuple[float, float, float]:
    """Return the area of a polygon seen from above, and mean and variance of its heights."""
    area = first = second = 0.0
    base = polygon[0, 2]
    for i in range(1, sides - 1):
        ax, ay = polygon[i, 0] - polygon[0, 0], polygon[i, 1] - polygon[0, 1]
        bx, by = polygon[i + 1, 0] - polygon[0, 0], polygon[i + 1, 1] - polygon[0, 1]
        part = abs(ax * by - ay * bx) / 2
        # The integrals of a height and of its square over a triangle with one corner at height 0.
        one, other = polygon[i, 2] - base, polygon[i + 1, 2] - base
        area += part
        first += part * (one + other) / 3
        second += part * (one * one + other * other + one * other) / 6
    if area == 0.0:
        return 0.0, base, 0.0
    mean = first / area
    return area, base + mean, max(0.0, second / area - mean * mean)


@kernel
def _clip_upright(
    corner: Float64, along: Float64, across: Float64, cell_size: float
) -> tuple[Array, ...]:
    """Clip upright rectangles to the cells that they run through; as `_clip_flat`.

    A wall along an edge between cells belongs to the cells with the greater index.
    """
    size = 0
    for r in range(len(corner)):
        x0, x1, y0, y1 = _cells_of(corner[r], along[r], across[r], cell_size)
        size += (x1 - x0 + 1) * (y1 - y0 + 1)
    where = np.empty((3, size), dtype=np.int64)
    values = np.empty((6, size))
    found = 0
    for r in range(len(corner)):
        length = math.hypot(along[r, 0], along[r, 1])
        x0, x1, y0, y1 = _cells_of(corner[r], along[r], across[r], cell_size)
        for ix in range(x0, x1 + 1):
            for iy in range(y0, y1 + 1):
                enter, leave = 0.0, 1.0
                for axis in range(2):
                    if along[r, axis] != 0.0:
                        edge = (ix if axis == 0 else iy) * cell_size - corner[r, axis]
                        one = edge / along[r, axis]
                        other = (edge + cell_size) / along[r, axis]
                        enter, leave = max(enter, min(one, other)), min(leave, max(one, other))
                if leave > enter:
                    begin = corner[r, 2] + enter * along[r, 2]
                    end = corner[r, 2] + leave * along[r, 2]
                    low, high = min(begin, end), max(begin, end) + across[r, 2]
                    where[0, found], where[1, found], where[2, found] = r, ix, iy
                    values[0, found] = (leave - enter) * length / cell_size
                    values[1, found], values[2, found] = low, high
                    values[3, found] = (low + high) / 2
                    values[4, found] = (high - low) ** 2 / 12
                    values[5, found] = abs(end - begin)
                    found += 1
    where, values = where[:, :found], values[:, :found]
    share, low, high, mean, variance, rise = values
    return where[0], where[1], where[2], share, low, high, mean, variance, rise
