"""What was seen through: sight lines from the craft to points.

A sight line runs from where the craft was, if that is known, to a point as the stages on points
left it. It passes through a patch where it crosses the patch's height in the patch's cell; on the
edge of two cells it passes through neither. As points have errors, a line ends a cell before its
point, and the point must lie at least half a cell above or below the patch. Only points in cells
near the patch's count, near in x and in y: what a patch is judged by stays within a reach.

One line may be wrong: two are enough to show that a patch is none. This rule is new; that space
that was looked through is free is from H. Moravec and A. Elfes, *High Resolution Maps from Wide
Angle Sonar*, ICRA 1985 (doi:10.1109/ROBOT.1985.1087316).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from mlscli.keyframes.batches import Points
from mlscli.maps.cells import CellSet
from mlscli.maps.neighbours import sought
from mlscli.maps.order import OccupiedCells
from mlscli.pipeline.stages.ordering import Ordered, cells_of, order_by_cell
from mlscli.runtime.arrays import Array, Bool, Float64, Int32, Int64, UInt64, frozen
from mlscli.runtime.kernels import inner, kernel
from mlscli.runtime.threads import in_ranges

# So many sight lines through a patch show that it is none.
_ENOUGH = 2

# More than the relative error of a few roundings.
_ROUNDING = 2.0**-45

# Up to so many pairs of a patch and a point are looked at one by one.
_FEW = 2**18

# How much work a patch is: some thousand sight lines.
_WEIGHT = 16.0


class Sights:
    """The sight lines of points.

    Parameters
    ----------
    route : float64 (K, 4)
        Time, x, y, z of the craft for each keyframe; NaN where not known.
    near : callable
        Returns all points in a set of cells, as the stages on points left them; others, too, if
        that is less work.

    Attributes
    ----------
    asked : list of uint64 (C,)
        Packed keys of the cells in which somebody asked what was seen through.
    known : bool
        Whether the position of the craft is known in any keyframe.
    cells : CellSet or None
        Where it counts what was seen; None, as at first: everywhere.
    """

    def __init__(self, route: Float64, near: Callable[[CellSet], Points]) -> None:
        self.asked: list[UInt64] = []
        self.cells: CellSet | None = None
        self.known = bool(np.isfinite(route[:, 1:]).all(axis=1).any())
        self._position = frozen(np.ascontiguousarray(route[:, 1:]))
        self._near = near
        self._points: Points | None = None
        self._ordered: Ordered | None = None

    def pass_through(
        self, ix: Int32, iy: Int32, z: Float64, cell_size: float, farthest: int
    ) -> Bool:
        """Return through which patches enough sight lines pass, bool (N,).

        Parameters
        ----------
        ix, iy : int32 (N,)
            The cells of the patches.
        z : float64 (N,)
            Their heights.
        cell_size : float
            Side of a cell, in the unit of the recording.
        farthest : int
            How many cells away, in x and in y, a point's sight line still counts.
        """
        enough = np.zeros(len(ix), dtype=np.bool_)
        if not len(ix):
            return enough
        asked = CellSet.of(ix, iy)
        self.asked.append(asked.keys)
        if not self.known:
            return enough
        around = _Around(
            ix.min() * cell_size, (ix.max() + 1.0) * cell_size,
            iy.min() * cell_size, (iy.max() + 1.0) * cell_size,
            z.min(), z.max(), cell_size,
        )  # fmt: skip
        points = self._near(asked.widened(farthest))
        able = _able(points.xyz, points.keyframe, self._position, around)
        seen = points.xyz, points.keyframe, self._position, cell_size, farthest, enough
        if len(ix) * len(able) <= _FEW:
            # To order so few points would cost more.
            _look_along(ix, iy, z, able, *seen)
            return enough
        if 2 * len(able) < points.size:
            points = points.take(able)
            seen = points.xyz, points.keyframe, *seen[2:]
        ordered = self._by_cell(points, cell_size)

        def look(begin: int, end: int) -> None:
            _look(begin, end, ix, iy, z, ordered.cells, ordered.order, ordered.z, *seen)

        in_ranges(len(ix), look, weight=_WEIGHT)
        return enough

    def _by_cell(self, points: Points, cell_size: float) -> Ordered:
        """Return the order of points by cell; it is kept for the next call."""
        if points is not self._points or self._ordered is None:
            self._points = points
            self._ordered = order_by_cell(*cells_of(points.xyz, cell_size), points.xyz[:, 2])
        return self._ordered


class _Around(NamedTuple):
    """What holds all patches that are asked about, in the unit of the recording.

    Attributes
    ----------
    west, east, south, north : float
        Edges of cells.
    low, high : float
        The least and the greatest height.
    cell_size : float
    """

    west: float
    east: float
    south: float
    north: float
    low: float
    high: float
    cell_size: float


@kernel
def _able(xyz: Float64, keyframe: Int32, position: Float64, around: _Around) -> Int64:
    """Return the numbers of points whose sight lines can pass through a patch, int64 (A,).

    Parameters
    ----------
    xyz, keyframe, position
        As in `_look`.
    around : _Around
        Of the patches. Lines that pass it by are left out, but for some.
    """
    able = np.empty(len(xyz), dtype=np.int64)
    size = 0
    for i in range(len(xyz)):
        craft_z, point_z = position[keyframe[i], 2], xyz[i, 2]
        # Where the craft's position is not known, no comparison holds.
        falls = craft_z > around.low and point_z < around.high
        if not (falls or (craft_z < around.high and point_z > around.low)):
            continue
        craft_x, point_x = position[keyframe[i], 0], xyz[i, 0]
        craft_y, point_y = position[keyframe[i], 1], xyz[i, 1]
        # More than the rounding of a place on the line.
        wide = around.cell_size + (abs(craft_x) + abs(point_x)) * _ROUNDING
        deep = around.cell_size + (abs(craft_y) + abs(point_y)) * _ROUNDING
        if (
            min(craft_x, point_x) < around.east + wide
            and max(craft_x, point_x) > around.west - wide
            and min(craft_y, point_y) < around.north + deep
            and max(craft_y, point_y) > around.south - deep
        ):
            able[size] = i
            size += 1
    return able[:size]


@kernel
def _look_along(
    ix: Int32,
    iy: Int32,
    z: Float64,
    able: Int64,
    xyz: Float64,
    keyframe: Int32,
    position: Float64,
    cell_size: float,
    farthest: int,
    enough: Bool,
) -> None:
    """Find through which patches enough sight lines pass, along each line; as `_look`.

    Parameters
    ----------
    ix, iy, z, xyz, keyframe, position, cell_size, farthest, enough
        As in `_look`; of all patches.
    able : int64 (A,)
        The numbers of the points that can count.
    """
    votes = np.zeros(len(ix), dtype=np.int64)
    for at in able:
        x, y = np.floor(xyz[at, 0] / cell_size), np.floor(xyz[at, 1] / cell_size)
        for n in range(len(ix)):
            if (
                abs(xyz[at, 2] - z[n]) >= cell_size / 2
                and abs(x - ix[n]) <= farthest
                and abs(y - iy[n]) <= farthest
            ):
                votes[n] += _passes(position, keyframe[at], xyz, at, ix[n], iy[n], z[n], cell_size)
    for n in range(len(ix)):
        enough[n] = votes[n] >= _ENOUGH


@kernel
def _look(
    begin: int,
    end: int,
    ix: Int32,
    iy: Int32,
    z: Float64,
    cells: OccupiedCells,
    order: Array,
    heights: Float64,
    xyz: Float64,
    keyframe: Int32,
    position: Float64,
    cell_size: float,
    farthest: int,
    enough: Bool,
) -> None:
    """Find through which patches, `begin` to `end`, enough sight lines pass.

    Parameters
    ----------
    begin, end : int
        Range of patches.
    ix, iy : int32 (N,)
        Their cells.
    z : float64 (N,)
        Their heights.
    cells, order, heights
        As `order_by_cell` returns them for the points.
    xyz : float64 (M, 3)
        The points.
    keyframe : int32 (M,)
        Their keyframes.
    position : float64 (K, 3)
        Where the craft was in each keyframe; NaN where not known.
    cell_size : float
        In the unit of the recording.
    farthest : int
        In cells.
    enough : bool (N,)
        Receives True for these patches.
    """
    half = cell_size / 2
    for n in range(begin, end):
        east, south = np.int64(ix[n]) + farthest, np.int64(iy[n]) - farthest
        votes = 0
        there = sought(cells.ix, cells.iy, -1, np.int64(ix[n]) - farthest, south)
        while votes < _ENOUGH and there < len(cells.ix) and cells.ix[there] <= east:
            if abs(np.int64(cells.iy[there]) - iy[n]) > farthest:
                # On to where the square of cells begins in this column, or in the next.
                beyond = cells.iy[there] > iy[n]
                there = sought(cells.ix, cells.iy, -1, np.int64(cells.ix[there]) + beyond, south)
                continue
            for i in range(cells.start[there], cells.start[there + 1]):
                if abs(heights[i] - z[n]) >= half:
                    at = order[i]
                    votes += _passes(position, keyframe[at], xyz, at, ix[n], iy[n], z[n], cell_size)
            there += 1
        enough[n] = votes >= _ENOUGH


@inner
def _passes(
    position: Float64,
    keyframe: int,
    xyz: Float64,
    point: int,
    ix: int,
    iy: int,
    z: float,
    cell_size: float,
) -> bool:
    """Return whether a point's sight line passes through a height in a cell, a cell before it.

    Parameters
    ----------
    position, xyz
        As in `_look`.
    keyframe, point : int
        The numbers of the keyframe and the point.
    ix, iy : int
        The cell.
    z : float
        The height, which is not the point's.
    cell_size : float
        In the unit of the recording.
    """
    # Numbers, no rows of arrays: to make those costs more than the rest.
    craft_z, point_z = position[keyframe, 2], xyz[point, 2]
    # Where the craft's position is not known, no comparison holds.
    if not (craft_z - z) * (z - point_z) > 0.0:
        return False
    dz = point_z - craft_z
    share = (z - craft_z) / dz
    dx = xyz[point, 0] - position[keyframe, 0]
    x = position[keyframe, 0] + share * dx
    if not (ix * cell_size < x < (ix + 1) * cell_size):
        return False
    dy = xyz[point, 1] - position[keyframe, 1]
    y = position[keyframe, 1] + share * dy
    if not (iy * cell_size < y < (iy + 1) * cell_size):
        return False
    return bool((1.0 - share) * np.sqrt(dx * dx + dy * dy + dz * dz) >= cell_size)
