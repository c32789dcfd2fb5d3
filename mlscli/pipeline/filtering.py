"""The points of a stage, filtered again where points are added or removed.

A point is filtered again only if a point was added or removed within the distance up to which the
stage looked when it last filtered the point: others cannot change its outcome. All points added or
removed in one cell are represented by their bounding rectangle.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mlscli.keyframes.batches import Points
from mlscli.maps.cells import CellSet, key_of
from mlscli.maps.rows import merged
from mlscli.maps.tiled_rows import TiledRows
from mlscli.pipeline.pipeline import Pipeline
from mlscli.pipeline.stages.ordering import cells_of
from mlscli.pipeline.stages.stage import PointStage
from mlscli.runtime.arrays import Bool, Float64, Int32, UInt64
from mlscli.runtime.kernels import inner, kernel

# The words of a row: the packed cell; the point as the stage reads it; the height that the stage
# gives it (NaN: dropped); the square of how far the stage looked (inf: not yet filtered).
_CELL, _X, _Y, _Z, _KEYFRAME, _HEIGHT, _LOOKED = range(7)
_WORDS = 7


class Outcome(NamedTuple):
    """What a stage has made of points.

    Attributes
    ----------
    cells : CellSet
        All cells in which a point or its outcome can differ from before.
    rows : uint64 (N, _WORDS)
        All points in these cells, ascending by cell.
    """

    cells: CellSet
    rows: UInt64


class FilteredPoints:
    """The points that a stage reads, and what it makes of them.

    Parameters
    ----------
    stage : PointStage or None
        None: the points stay as they are.
    """

    def __init__(self, stage: PointStage | None) -> None:
        self._stage = stage
        self._tiles = TiledRows(_WORDS)

    def add(self, pipeline: Pipeline, points: Points) -> Outcome:
        """Add points, and return the outcome in the cells where it changes."""
        new = _rows_of(points, pipeline.cell_size)
        cells = CellSet.of_keys(new[:, _CELL])
        rows = merged(self._tiles.extract(cells), new)
        self._tiles.put(cells, rows)
        return self._filtered(pipeline, Outcome(cells, rows), new)

    def replace(self, pipeline: Pipeline, given: Outcome) -> tuple[Outcome, int]:
        """Replace the points in some cells, and return the outcome in the cells where it changes.

        Parameters
        ----------
        pipeline : Pipeline
        given : Outcome
            The outcome of the stage before, which is the input of this stage in these cells.

        Returns
        -------
        outcome : Outcome
            All cells in which it changes.
        more : int
            How many more points this stage reads than before.
        """
        before, rows = self._tiles.extract(given.cells), _passed_on(given.rows)
        self._tiles.put(given.cells, rows)
        changed = np.concatenate((before, rows))
        return self._filtered(pipeline, Outcome(given.cells, rows), changed), len(rows) - len(
            before
        )

    def _filtered(self, pipeline: Pipeline, given: Outcome, changed: UInt64) -> Outcome:
        """Filter again all points whose outcome the rows added or removed can change."""
        if self._stage is None:
            return given
        reach = self._stage.reach(pipeline.cell_size)
        near = self._tiles.extract(given.cells.widened(2 * reach))
        asked = _asked(near, near.view(np.float64), changed, changed.view(np.float64), reach)
        height, looked = pipeline.evaluate_points(self._stage, _as_read(near), asked)
        cells, outcome = _noted(near, near.view(np.float64), asked, height, looked)
        self._tiles.put(CellSet.of_keys(cells), near)
        keys = np.concatenate((outcome[:, _CELL], given.cells.keys))
        return Outcome(CellSet.of_keys(keys), outcome)


def kept(rows: UInt64) -> Points:
    """Return the points that a stage has not dropped, as it left them."""
    floats = rows.view(np.float64)
    floats = floats[~np.isnan(floats[:, _HEIGHT])]
    xyz = np.ascontiguousarray(floats[:, [_X, _Y, _HEIGHT]])
    return Points(xyz, floats.view(np.int64)[:, _KEYFRAME].astype(np.int32))


def _as_read(rows: UInt64) -> Points:
    xyz = np.ascontiguousarray(rows.view(np.float64)[:, _X : _Z + 1])
    return Points(xyz, rows[:, _KEYFRAME].astype(np.int32))


def _rows_of(points: Points, cell_size: float) -> UInt64:
    """Return points as rows, ascending by cell, not yet filtered."""
    rows = np.empty((points.size, _WORDS), dtype=np.uint64)
    _fill(rows, rows.view(np.float64), *points, *cells_of(points.xyz, cell_size))
    return rows[np.argsort(rows[:, _CELL], kind="stable")]


@kernel
def _fill(
    rows: UInt64, floats: Float64, xyz: Float64, keyframe: Int32, ix: Int32, iy: Int32
) -> None:
    """Write points into rows.

    Parameters
    ----------
    rows : uint64 (N, _WORDS)
        Receives the points, in the order given.
    floats : float64 (N, _WORDS)
        A view of `rows`.
    xyz : float64 (N, 3)
        Coordinates.
    keyframe : int32 (N,)
        The number of each point's keyframe.
    ix, iy : int32 (N,)
        Cell indices of the points.
    """
    for i in range(len(rows)):
        rows[i, _CELL] = key_of(ix[i], iy[i])
        floats[i, _X], floats[i, _Y], floats[i, _Z] = xyz[i, 0], xyz[i, 1], xyz[i, 2]
        rows[i, _KEYFRAME] = keyframe[i]
        floats[i, _HEIGHT], floats[i, _LOOKED] = xyz[i, 2], np.inf


def _passed_on(rows: UInt64) -> UInt64:
    """Return the rows of a stage as the next one reads them, without dropped points."""
    floats = rows.view(np.float64)
    floats = floats[~np.isnan(floats[:, _HEIGHT])]
    floats[:, _Z] = floats[:, _HEIGHT]
    floats[:, _LOOKED] = np.inf
    return floats.view(np.uint64)


@kernel
def _asked(rows: UInt64, floats: Float64, changed: UInt64, places: Float64, reach: int) -> Bool:
    """Return which points a stage must filter again, bool (N,), given those added or removed.

    Rows ascend by cell, and a stage looks at cells within its reach only. The points added or
    removed in one cell are represented by their bounding rectangle: to test them one by one would
    cost more in dense clouds than it saves. `floats` and `places` are `rows` and `changed` viewed
    as float64.
    """
    asked: Bool = floats[:, _LOOKED] == np.inf
    if asked.all():
        return asked
    begin = 0
    while begin < len(changed):
        left, right, lower, upper = np.inf, -np.inf, np.inf, -np.inf
        end = begin
        while end < len(changed) and changed[end, _CELL] == changed[begin, _CELL]:
            left, right = min(left, places[end, _X]), max(right, places[end, _X])
            lower, upper = min(lower, places[end, _Y]), max(upper, places[end, _Y])
            end += 1
        x = int(changed[begin, _CELL] >> np.uint64(32))
        y = int(changed[begin, _CELL] & np.uint64(0xFFFFFFFF))
        lowest, highest = max(y - reach, 0), min(y + reach, 2**32 - 1)
        for column in range(max(x - reach, 0), min(x + reach, 2**32 - 1) + 1):
            first = np.uint64(column) << np.uint64(32) | np.uint64(lowest)
            last = np.uint64(column) << np.uint64(32) | np.uint64(highest)
            i = _first_from(rows, first)
            while i < len(rows) and rows[i, _CELL] <= last:
                dx = max(0.0, max(left - floats[i, _X], floats[i, _X] - right))
                dy = max(0.0, max(lower - floats[i, _Y], floats[i, _Y] - upper))
                asked[i] |= dx * dx + dy * dy <= floats[i, _LOOKED]
                i += 1
        begin = end
    return asked


@inner
def _first_from(rows: UInt64, cell: np.uint64) -> int:
    """Return the first row that does not come before a cell."""
    begin, end = 0, len(rows)
    while begin < end:
        middle = (begin + end) // 2
        if rows[middle, _CELL] < cell:
            begin = middle + 1
        else:
            end = middle
    return begin


@kernel
def _noted(
    rows: UInt64, floats: Float64, asked: Bool, height: Float64, looked: Float64
) -> tuple[UInt64, UInt64]:
    """Write a stage's results for the points asked for into their rows.

    Returns
    -------
    cells : uint64 (C,)
        Packed keys of the cells in which something was written.
    outcome : uint64 (N, _WORDS)
        All rows of those cells in which a point is new or its outcome has changed.
    """
    cells, outcome = np.empty(len(rows), dtype=np.uint64), np.empty_like(rows)
    noted = size = 0
    i = 0
    while i < len(rows):
        begin, cell = i, rows[i, _CELL]
        any_asked = differs = False
        while i < len(rows) and rows[i, _CELL] == cell:
            if asked[i]:
                any_asked = True
                before = floats[i, _HEIGHT]
                same = before == height[i] or (np.isnan(before) and np.isnan(height[i]))
                differs |= not same or floats[i, _LOOKED] == np.inf
                floats[i, _HEIGHT], floats[i, _LOOKED] = height[i], looked[i]
            i += 1
        if any_asked:
            cells[noted] = cell
            noted += 1
        if differs:
            for row in range(begin, i):
                for word in range(rows.shape[1]):
                    outcome[size, word] = rows[row, word]
                size += 1
    return cells[:noted], outcome[:size]
