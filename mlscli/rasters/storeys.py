"""The storeys of a map, for a robot that drives: each cell free, occupied or unknown.

A storey is a floor that hangs together, however uneven, with one patch for each cell. It is grown
from a patch of middle height; always the patch next that is nearest to that one in height. So a
bridge and the ground beneath it are two storeys, also where ramps join them; each goes on into the
other as far as no cell would have two floors.

A ragged map falls into many floors that hang together nowhere. Those of nearly one height, of which
none lies above another, are one storey; and a floor is a storey of its own only where a robot can
turn on enough of it, and where it lies above or below another, or is about as large as the largest.
"""

from __future__ import annotations

import heapq
import math
from typing import NamedTuple

import numpy as np

from mlscli.maps.space import FREE, OCCUPIED, UNKNOWN
from mlscli.maps.surface_map import ARTIFICIAL, SurfaceMap
from mlscli.rasters.extent import Extent
from mlscli.rasters.robot import Limits, Robot
from mlscli.rasters.standing import Floor, floor_of
from mlscli.runtime.arrays import Bool, Float64, Int64, UInt8
from mlscli.runtime.kernels import kernel

LEAST_SHARE = 0.05
"""A floor with less than this share of the cells of the largest is no storey of its own."""

LEAST_OF_ALL = 0.01
"""Nor is one with less than this share of all patches that can be stood on: few are many enough."""

MOST_CLASHES = 0.1
"""Floors of nearly one height are joined where at most this share of what one adds lies
above or below the other."""

LEAST_ROOM = 0.03
"""A storey has at least this share of the room to turn that the one with most of it has."""

LEAST_ABOVE = 0.15
"""At least this share of its cells lies above or below other storeys, ..."""

LARGE = 0.5
"""... unless it has this share of the room to turn of the one with most."""


class Storey(NamedTuple):
    """A floor, and what a robot on it finds around.

    Attributes
    ----------
    space : uint8 (H, W)
        `UNKNOWN`, `FREE` or `OCCUPIED` for each cell, row by row along x, from low y up.
    floor : float64 (H, W)
        The height on which it stands; NaN where it cannot.
    """

    space: UInt8
    floor: Float64


class Storeys(NamedTuple):
    """The storeys of a map, from the lowest up.

    Attributes
    ----------
    extent : Extent
        The cells that all of them cover.
    limits : Limits
        What the robot takes, in the unit of the map.
    storeys : list of Storey
        By the middle height of their floors.
    left_out : int
        Cells in which a robot can stand on a patch that is on no storey: too small a floor.
    """

    extent: Extent
    limits: Limits
    storeys: list[Storey]
    left_out: int


def storeys_of(surface: SurfaceMap, robot: Robot | None = None) -> Storeys:
    """Return the storeys of a map.

    A cell is free where the robot can stand on the storey's floor. It is occupied where it holds
    something that is no such floor and begins lower than the robot is high: a wall, a step, what is
    too steep or has no room above, or the ground far below. It is unknown where it holds nothing
    lower than that, or nothing that is certain: artificial patches are neither floor nor obstacle.
    Where two cells of a storey touch and the step between them is too high, the higher one is
    occupied.

    Parameters
    ----------
    surface : SurfaceMap
    robot : Robot, optional

    Raises
    ------
    UsageError
        Where the map is empty, or too wide for a raster.
    """
    limits = (Robot() if robot is None else robot).limits(surface)
    extent = Extent.of_map(surface)
    floor = floor_of(surface, limits)
    growing = _Growing(surface, extent, limits, floor)
    levels = growing.large(growing.joined(_without_parts(growing.levels())))
    levels.sort(key=growing.middle)
    held = np.zeros(surface.size, dtype=np.bool_)
    for level in levels:
        held[level[level >= 0]] = True
    cell = np.repeat(np.arange(len(surface.cells.ix)), np.diff(surface.cells.start))
    left_out = len(np.unique(cell[floor.stands & ~held]))
    storeys = (growing.storey(level) for level in levels)
    kept = [storey for storey in storeys if np.isfinite(storey.floor).any()]
    return Storeys(extent, limits, kept, left_out)


class _Growing:
    """Finds the floors of a map; a floor is the patch of each occupied cell, int64 (C,), or -1."""

    def __init__(self, surface: SurfaceMap, extent: Extent, limits: Limits, floor: Floor) -> None:
        self._surface, self._extent, self._limits, self._floor = surface, extent, limits, floor
        cells = surface.cells
        self._cell = np.repeat(np.arange(len(cells.ix)), np.diff(cells.start))
        # The connected part of each patch; of those that cannot be stood on, the patch itself.
        self._label = _parts(floor.links, floor.stands)
        self._row, self._column = cells.iy - extent.min_y, cells.ix - extent.min_x

    def levels(self) -> list[Int64]:
        """Return the floors, the largest connected parts first."""
        found: list[Int64] = []
        waiting = self._floor.stands.copy()
        of_all = max(1, math.ceil(LEAST_OF_ALL * np.count_nonzero(waiting)))
        least = of_all
        while (part := _largest_part(self._floor.links, waiting, least)) is not None:
            level = self._grow(part)
            new = level[level >= 0]
            new = new[waiting[new]]
            if len(new) < least:
                # A floor that winds over itself: what of it is left is too little.
                waiting[part] = False
                continue
            waiting[new] = False
            found.append(level)
            if len(found) == 1:
                least = max(of_all, math.ceil(LEAST_SHARE * np.count_nonzero(level >= 0)))
        return found

    def joined(self, levels: list[Int64]) -> list[Int64]:
        """Return floors put together where they are about as high, and none lies above another.

        Each is as high, on average, as the nearest floor of the other, but for the robot's height.
        Small floors, which are none of their own, join them where there is no more than a step.

        Parameters
        ----------
        levels : list of int64 (C,)
            The largest first.
        """
        height, cell = self._surface.height, self._cell
        most = self._limits.rise(self._surface.cell_size)
        waiting, found = list(levels), []
        alone = self._floor.stands.copy()
        for level in levels:
            alone[level[level >= 0]] = False
        while waiting:
            level, waiting = self._gathered(waiting)
            nearest = self._nearest(level)
            label = _parts(self._floor.links, alone)
            patch = np.flatnonzero(alone)
            size = np.bincount(label[patch], minlength=len(alone))
            fits = patch[level[cell[patch]] < 0]
            once = np.unique(np.column_stack((label[fits], cell[fits])), axis=0)
            total = np.bincount(
                label[fits], np.abs(height[fits] - nearest[cell[fits]]), minlength=len(alone)
            )
            whole = np.bincount(once[:, 0], minlength=len(alone)) == size
            new = fits[(whole & (total <= most * size))[label[fits]]]
            # Of two floors that meet in a cell, the lower.
            new = new[np.diff(cell[new], prepend=-1) > 0]
            level[cell[new]] = new
            alone[new] = False
            found.append(level)
        return found

    def _gathered(self, levels: list[Int64]) -> tuple[Int64, list[Int64]]:
        """Return the first floor with those that it is one with, and the others."""
        level, *waiting = levels
        level = level.copy()
        before = len(levels)
        while len(waiting) < before:
            before, others = len(waiting), []
            nearest = self._nearest(level)
            for other in waiting:
                own = (other >= 0) & (level != other)
                apart = np.abs(self._surface.height[other[own]] - nearest[own])
                clashes = np.count_nonzero(own & (level >= 0))
                if apart.sum() > self._limits.headroom * len(apart) or clashes > MOST_CLASHES * len(
                    apart
                ):
                    others.append(other)
                else:
                    level = np.where(own & (level < 0), other, level)
            waiting = others
        return level, waiting

    def large(self, levels: list[Int64]) -> list[Int64]:
        """Return the floors that are storeys of their own, the one with most room first.

        A ragged map has floors that are none: a table, a shelf, what is left of noise.
        """
        room = np.array([self._room(level) for level in levels])
        if not room.any():
            room = np.array([np.count_nonzero(level >= 0) for level in levels])
        kept: list[Int64] = []
        for number in np.argsort(-room, kind="stable").tolist():
            level, share = levels[number], room[number] / room.max()
            if share >= LARGE or (share >= LEAST_ROOM and self._above(level, kept) >= LEAST_ABOVE):
                kept.append(level)
        return kept

    def _room(self, level: Int64) -> int:
        """Return on how many cells of a floor a robot can turn: all those around are floor, too."""
        from scipy.ndimage import binary_erosion

        cells = self._surface.cells
        floor = self._extent.place(level >= 0, cells.ix, cells.iy, False)
        return int(np.count_nonzero(binary_erosion(floor, np.ones((3, 3)))))

    @staticmethod
    def _above(level: Int64, others: list[Int64]) -> float:
        """Return the share of a floor's own cells that lie above or below others."""
        own = level >= 0
        for other in others:
            own &= level != other
        above = np.zeros_like(own)
        for other in others:
            above |= own & (other >= 0)
        return np.count_nonzero(above) / max(1, int(np.count_nonzero(own)))

    def middle(self, level: Int64) -> float:
        """Return the middle height of a floor."""
        return float(np.median(self._surface.height[level[level >= 0]]))

    def _grow(self, part: Int64) -> Int64:
        """Return the floor that grows from a connected part."""
        height = self._surface.height
        level = np.full(len(self._surface.cells.ix), -1, dtype=np.int64)
        whole = np.flatnonzero(self._label == self._label[part[0]])
        if np.all(np.diff(self._cell[whole]) > 0):
            # It has one patch for each cell, in whatever order they are taken.
            level[self._cell[whole]] = whole
            return level
        middle = np.partition(height[part], len(part) // 2)[len(part) // 2]
        seed = part[np.argmax(height[part] == middle)]
        _flood(seed, self._floor.links, self._floor.stands, self._cell, height, level)
        return level

    def _nearest(self, level: Int64) -> Float64:
        """Return the floor's height nearest to each occupied cell, float64 (C,)."""
        from scipy.ndimage import distance_transform_edt

        known = level >= 0
        heights = np.full((self._extent.height, self._extent.width), np.nan)
        heights[self._row[known], self._column[known]] = self._surface.height[level[known]]
        rows, columns = distance_transform_edt(
            np.isnan(heights), return_distances=False, return_indices=True
        )
        nearest: Float64 = heights[rows[self._row, self._column], columns[self._row, self._column]]
        return nearest

    def storey(self, level: Int64) -> Storey:
        """Return the storey of a floor."""
        surface, extent = self._surface, self._extent
        cells = surface.cells
        known = level >= 0
        reference = surface.height[level] if known.all() else self._nearest(level)
        certain = surface.origin != ARTIFICIAL
        low = np.where(certain, surface.low_end, np.inf)
        lowest = np.minimum.reduceat(low, cells.start[:-1])
        space = np.where(lowest < reference + self._limits.headroom, OCCUPIED, UNKNOWN)
        doubtful = self._floor.doubtful[level]
        space = np.where(known, np.where(doubtful, UNKNOWN, FREE), space).astype(np.uint8)
        heights = np.where(known, reference, np.nan)
        raster = extent.place(space, cells.ix, cells.iy, UNKNOWN)
        floor = extent.place(heights, cells.ix, cells.iy, np.nan)
        edges = _edges(floor, self._limits.rise(surface.cell_size))
        raster[edges & (raster == FREE)] = OCCUPIED
        floor[raster == OCCUPIED] = np.nan
        return Storey(raster, floor)


def _without_parts(levels: list[Int64]) -> list[Int64]:
    """Return floors without those of which another has every patch."""
    kept: list[Int64] = []
    for level in sorted(levels, key=lambda level: -np.count_nonzero(level >= 0)):
        known = level >= 0
        if not any(np.array_equal(level[known], larger[known]) for larger in kept):
            kept.append(level)
    return kept


def _edges(floor: Float64, rise: float) -> Bool:
    """Return the cells from which a floor falls off by more than a step to a cell that touches.

    Parameters
    ----------
    floor : float64 (H, W)
    rise : float
        By how much the floors of cells that share an edge may differ; twice that across corners.
    """
    edges = np.zeros(floor.shape, dtype=np.bool_)
    height, width = floor.shape
    for dy, dx in ((0, 1), (1, 0), (1, 1), (1, -1)):
        here = slice(0, height - dy), slice(max(0, -dx), width - max(0, dx))
        there = slice(dy, height), slice(max(0, dx), width - max(0, -dx))
        down = floor[here] - floor[there]
        edges[here] |= down > rise * (dx * dx + dy)
        edges[there] |= -down > rise * (dx * dx + dy)
    return edges


def _largest_part(links: Int64, among: Bool, least: int) -> Int64 | None:
    """Return the patches of the largest connected part of some, int64 (N,), in the map's order.

    None where none has at least `least` patches. Of parts as large, that with the first patch.
    """
    label = _parts(links, among)
    sizes = np.bincount(label[among], minlength=1)
    if sizes.max() < least:
        return None
    part: Int64 = np.flatnonzero(among & (label == sizes.argmax()))
    return part


@kernel
def _parts(links: Int64, among: Bool) -> Int64:
    """Return the first patch of the connected part of each, int64 (P,), where it is among some."""
    label = np.arange(len(among))
    for patch in range(len(among)):
        for side in range(4):
            other = links[patch, side]
            if among[patch] and other >= 0 and among[other]:
                one, two = patch, other
                while label[one] != one:
                    label[one] = label[label[one]]
                    one = label[one]
                while label[two] != two:
                    label[two] = label[label[two]]
                    two = label[two]
                label[max(one, two)] = min(one, two)
    for patch in range(len(among)):
        label[patch] = label[label[patch]]
    return label


@kernel
def _flood(
    seed: int, links: Int64, stands: Bool, cell: Int64, height: Float64, level: Int64
) -> None:
    """Grow a floor from a seed: always the patch next whose height is nearest to the seed's.

    Parameters
    ----------
    seed : int
    links : int64 (P, 4)
    stands : bool (P,)
    cell : int64 (P,)
        The number of each patch's cell.
    height : float64 (P,)
    level : int64 (C,)
        The floor: the patch of each cell, -1 where there is none; changed in place.
    """
    heap = [(0.0, seed)]
    waits = stands.copy()
    while heap:
        _, patch = heapq.heappop(heap)
        if level[cell[patch]] >= 0:
            continue
        level[cell[patch]] = patch
        for side in range(4):
            other = links[patch, side]
            if other >= 0 and waits[other] and level[cell[other]] < 0:
                waits[other] = False
                heapq.heappush(heap, (abs(height[other] - height[seed]), other))
