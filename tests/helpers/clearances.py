"""What a craft meets along a piece, by the rule's words: plain loops over all patches and voxels.

Distances are found by halving intervals, not by geometry: they are convex along a piece.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from itertools import product
from typing import NamedTuple

import numpy as np

from mlscli.maps.surface_map import ARTIFICIAL, MEASURED, SurfaceMap
from mlscli.queries.clearance import BLOCKED, DOUBTFUL, FITS, NEVER_SEEN

Place = tuple[float, float, float]
Lines = dict[tuple[int, int, int], int]


class Found(NamedTuple):
    """What is found of a piece: as in `Clearance`."""

    verdict: int
    distance: float
    seen: float


def lines_of(surface: SurfaceMap) -> Lines:
    if surface.free is None:
        return {}
    voxels = map(tuple, surface.free.voxels.tolist())
    return dict(zip(voxels, surface.free.lines.tolist(), strict=True))


def least_along(value: Callable[[float], float]) -> float:
    """Return the least of a convex function of 0 to 1."""
    low, high = 0.0, 1.0
    for _ in range(200):
        one, other = low + (high - low) / 3, high - (high - low) / 3
        if value(one) <= value(other):
            high = other
        else:
            low = one
    return min(value(0.0), value(1.0), value(low))


def piece_against_map(
    surface: SurfaceMap, a: Place, b: Place, width: float, height: float, least: int
) -> Found:
    """Return what the rule says of a straight piece from a to b."""
    side, lines = surface.cell_size, lines_of(surface)
    low, high = min(a[2], b[2]) - height / 2, max(a[2], b[2]) + height / 2
    verdict, nearest = FITS, math.inf
    for n in range(surface.size):
        x, y = surface.ix[n] * side, surface.iy[n] * side
        patch = surface.take(np.array([n]))
        bottom, top, core = ends(patch)

        def aside(t: float, x: float = x, y: float = y) -> float:
            dx = max(x - mix(a, b, t, 0), mix(a, b, t, 0) - (x + side), 0.0)
            dy = max(y - mix(a, b, t, 1), mix(a, b, t, 1) - (y + side), 0.0)
            return math.hypot(dx, dy)

        gap = least_along(aside) - width / 2
        rise = max(bottom - high, low - top)
        far = math.hypot(gap, rise) if gap > 0 and rise > 0 else max(gap, rise)
        lowest, highest = (max(bottom, low), min(top, high)) if rise < 0 else (bottom, top)
        first = math.floor(lowest / (side / 2)) - (patch.depth[0] == 0)
        last = math.floor(highest / (side / 2))
        cell = int(patch.ix[0]), int(patch.iy[0])
        through = all(lines.get((*cell, iz), 0) >= least for iz in range(first, last + 1))
        artificial, middle = patch.origin[0] == ARTIFICIAL, (x + side / 2, y + side / 2)
        if artificial and through:
            continue
        nearest = min(nearest, far)
        if far >= 0:
            continue
        if artificial:
            verdict = max(verdict, NEVER_SEEN)
        elif not through and meets_core(a, b, middle, core, width, height, side):
            verdict = BLOCKED
        else:
            verdict = max(verdict, DOUBTFUL)
    blank, seen = looked(surface, lines, a, b, width, height, least)
    return Found(max(verdict, NEVER_SEEN) if blank else verdict, nearest, seen)


def mix(a: Place, b: Place, t: float, axis: int) -> float:
    return a[axis] + t * (b[axis] - a[axis])


def ends(patch: SurfaceMap) -> tuple[float, float, tuple[float, float]]:
    """Return the ends of the outer obstacle of a patch, and those of its core."""
    reference = patch.top[0] if patch.depth[0] > 0 else patch.mean[0]
    variance = patch.height_variance[0] - (patch.height[0] - reference) ** 2
    bound = patch.cell_size / 2 if math.isnan(variance) else 2 * math.sqrt(max(variance, 0.0))
    low, high = float(patch.height[0] - patch.depth[0]), float(patch.height[0])
    points = [] if patch.origin[0] != MEASURED else [float(patch.bottom[0]), float(patch.top[0])]
    outer = min([low, *points]) - bound, max([high, *points]) + bound
    if patch.depth[0] == 0:
        return *outer, (low + bound, high - bound)
    middle = (low + high) / 2
    return *outer, (min(low + bound, middle), max(high - bound, middle))


def meets_core(
    a: Place,
    b: Place,
    middle: tuple[float, float],
    core: tuple[float, float],
    width: float,
    height: float,
    side: float,
) -> bool:
    radius = max(width, side) / 2

    def short(t: float) -> float:
        x, y, z = (mix(a, b, t, axis) for axis in range(3))
        off = math.hypot(x - middle[0], y - middle[1]) - radius
        return max(off, core[0] - (z + height / 2), (z - height / 2) - core[1])

    return core[0] - height / 2 <= core[1] + height / 2 and least_along(short) < 0


def looked(
    surface: SurfaceMap, lines: Lines, a: Place, b: Place, width: float, height: float, least: int
) -> tuple[bool, float]:
    """Return whether the space of a piece was never seen, and the share of it that is open."""
    side, half = surface.cell_size, surface.cell_size / 2
    bottom = math.floor((min(a[2], b[2]) - height / 2) / half)
    top = max(bottom, math.ceil((max(a[2], b[2]) + height / 2) / half) - 1)
    craft = {
        (*cell, iz) for cell in cells_of(a, b, width / 2, side) for iz in range(bottom, top + 1)
    }
    open_ = {voxel for voxel, count in lines.items() if count >= least}
    explained = {
        (ix + dx, iy + dy, iz + dz)
        for ix, iy, iz in taken(surface, half)
        for dx, dy, dz in product((-1, 0, 1), (-1, 0, 1), range(-2, 3))
    }

    def is_blank(ix: int, iy: int, iz: int) -> bool:
        return (ix, iy, iz) not in open_ and (ix, iy, iz) not in explained

    share = len(craft & open_) / len(craft)
    runs = any(
        all(is_blank(ix, iy, iz - back + step) for step in range(6))
        for ix, iy, iz in craft
        for back in range(6)
    )
    plates = any(
        all(
            is_blank(ix - i + di, iy - j + dj, iz - k + dk)
            for di, dj, dk in product(range(3), range(3), range(2))
        )
        for ix, iy, iz in craft
        for i, j, k in product(range(3), range(3), range(2))
    )
    return runs or plates or share < 0.5, share


def cells_of(a: Place, b: Place, radius: float, side: float) -> Iterator[tuple[int, int]]:
    """Yield the cells that a disc reaches into on its way."""
    ranges = (
        range(
            math.floor((min(a[axis], b[axis]) - radius) / side) - 1,
            math.floor((max(a[axis], b[axis]) + radius) / side) + 2,
        )
        for axis in (0, 1)
    )
    for ix, iy in product(*ranges):
        x, y = ix * side, iy * side

        def aside(t: float, x: float = x, y: float = y) -> float:
            dx = max(x - mix(a, b, t, 0), mix(a, b, t, 0) - (x + side), 0.0)
            dy = max(y - mix(a, b, t, 1), mix(a, b, t, 1) - (y + side), 0.0)
            return math.hypot(dx, dy)

        if least_along(aside) < radius:
            yield ix, iy


def taken(surface: SurfaceMap, half: float) -> Iterator[tuple[int, int, int]]:
    """Yield the voxels into which measured patches reach, as large as they may be."""
    for n in np.flatnonzero(surface.origin == MEASURED).tolist():
        bottom, top, _ = ends(surface.take(np.array([n])))
        for iz in range(math.floor(bottom / half), math.floor(top / half) + 1):
            yield int(surface.ix[n]), int(surface.iy[n]), iz
