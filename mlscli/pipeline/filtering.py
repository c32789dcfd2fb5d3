"""The points of a stage, filtered again where points are added or removed.

A point is filtered again only if a point was added or removed within the distance up to which the
stage looked when it last filtered the point: others cannot change its outcome. All points added or
removed in one cell are represented by their bounding rectangle.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from mlscli.keyframes.batches import Points
from mlscli.maps.cells import CellSet, key_of, pack
from mlscli.maps.kept_rows import KeptRows
from mlscli.maps.rows import copied, merged
from mlscli.pipeline.pipeline import Pipeline
from mlscli.pipeline.stages.ordering import cells_of
from mlscli.pipeline.stages.stage import PointStage
from mlscli.runtime.arrays import ONE, ZERO, Bool, Float32, Float64, Int32, UInt64
from mlscli.runtime.kernels import inner, kernel
from mlscli.runtime.sorting import place_of

# The words of a row: the packed cell; the point as the stage reads it, its keyframe and sight in
# halves of words; where the stage places it (a height of NaN: dropped); the square of how far the
# stage looked (inf: not yet filtered); its noise as the stage reads it and leaves it, in halves.
_CELL, _X, _Y, _Z, _SEEN, _MORE_SEEN, _TO_X, _TO_Y, _TO_Z, _LOOKED, _NOISE = range(11)
_WORDS = 11
# The halves.
_READ_NOISE, _LEFT_NOISE = 2 * _NOISE, 2 * _NOISE + 1


class Outcome(NamedTuple):
    """What a stage has made of points.

    Attributes
    ----------
    cells : CellSet
        All cells in which what the stage has placed there can differ from before.
    rows : uint64 (N, _WORDS)
        All points that it has placed in these cells, ascending by cell.
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
        self._rows = KeptRows(_WORDS)

    def add(self, pipeline: Pipeline, points: Points) -> Outcome:
        """Add points, and return the outcome in the cells where it changes."""
        new = _rows_of(points, pipeline.cell_size)
        cells = CellSet.of_keys(new[:, _CELL])
        rows = merged(self._rows.extract(cells), new)
        self._rows.put(cells, rows)
        return self._filtered(pipeline, Outcome(cells, rows), new[:0], new)

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
        before, rows = self._rows.extract(given.cells), _passed_on(given.rows)
        self._rows.put(given.cells, rows)
        outcome = self._filtered(pipeline, Outcome(given.cells, rows), before, rows)
        return outcome, len(rows) - len(before)

    def kept(self) -> Points:
        """Return all points that the stage has not dropped, as it left them."""
        return kept(self._rows.whole())

    def kept_near(self, cells: CellSet, cell_size: float) -> Points:
        """Return all points that the stage has placed in `cells`, and others beside them."""
        # What is placed in a cell comes from less than half the reach away.
        reach = 0 if self._stage is None else self._stage.reach(cell_size)
        return kept(self._rows.extract(cells.widened(-(-reach // 2))))

    def _filtered(
        self, pipeline: Pipeline, given: Outcome, removed: UInt64, added: UInt64
    ) -> Outcome:
        """Filter again all points whose outcome the rows removed or added can change."""
        if self._stage is None:
            return given
        cell_size = pipeline.cell_size
        reach = self._stage.reach(cell_size)
        # What is placed in a cell comes from less than half the reach away.
        near = self._rows.extract(given.cells.widened(2 * reach))
        changed = np.concatenate((removed, added))
        asked = _asked(near, near.view(np.float64), changed, changed.view(np.float64), reach)
        xyz, looked, noise = pipeline.evaluate_points(self._stage, _as_read(near), asked)
        views = near.view(np.float64), near.view(np.float32)
        cells, places = _noted(near, *views, asked, xyz, looked, noise, cell_size)
        self._rows.put(CellSet.of_keys(cells), near)
        keys = given.cells.keys, _places(removed, removed.view(np.float64), cell_size), places
        changes = CellSet.of_keys(np.concatenate(keys))
        return Outcome(changes, _placed(near, views[0], changes.keys, cell_size))


def kept(rows: UInt64) -> Points:
    """Return the points that a stage has not dropped, as it left them."""
    size = _count_kept(rows.view(np.float64))
    xyz, keyframe = np.empty((size, 3)), np.empty(size, dtype=np.int32)
    points = Points(
        xyz, keyframe, np.empty((size, 3), dtype=np.float32), np.empty(size, dtype=np.float32)
    )
    _unpack_kept(rows.view(np.float64), rows.view(np.int32), rows.view(np.float32), *points)
    return points


@kernel
def _count_kept(floats: Float64) -> int:
    """Return how many of the rows, viewed as float64, a stage has not dropped."""
    kept = 0
    for i in range(len(floats)):
        kept += not np.isnan(floats[i, _TO_Z])
    return kept


@kernel
def _unpack_kept(
    floats: Float64,
    ints: Int32,
    halves: Float32,
    xyz: Float64,
    keyframe: Int32,
    sight: Float32,
    noise: Float32,
) -> None:
    """Write the points of rows that a stage has not dropped, as it left them, into arrays.

    Parameters
    ----------
    floats, ints, halves
        The rows, viewed as float64, int32 and float32.
    xyz, keyframe, sight, noise
        Of `Points`, with room for them.
    """
    n = 0
    for i in range(len(floats)):
        if np.isnan(floats[i, _TO_Z]):
            continue
        for axis in range(3):
            xyz[n, axis] = floats[i, _TO_X + axis]
            sight[n, axis] = halves[i, 2 * _SEEN + 1 + axis]
        keyframe[n], noise[n] = ints[i, 2 * _SEEN], halves[i, _LEFT_NOISE]
        n += 1


def _as_read(rows: UInt64) -> Points:
    """Return the points of rows as the stage reads them."""
    halves = rows.view(np.float32)
    columns = (
        rows.view(np.float64)[:, _X : _Z + 1],
        rows.view(np.int32)[:, 2 * _SEEN],
        halves[:, 2 * _SEEN + 1 : 2 * _SEEN + 4],
        halves[:, _READ_NOISE],
    )
    return Points(*map(np.ascontiguousarray, columns))


def _rows_of(points: Points, cell_size: float) -> UInt64:
    """Return points as rows, ascending by cell, not yet filtered."""
    rows = np.empty((points.size, _WORDS), dtype=np.uint64)
    floats = rows.view(np.float64)
    rows[:, _CELL] = pack(*cells_of(points.xyz, cell_size))
    floats[:, _X : _Z + 1] = floats[:, _TO_X : _TO_Z + 1] = points.xyz
    rows.view(np.int32)[:, 2 * _SEEN] = points.keyframe
    halves = rows.view(np.float32)
    halves[:, 2 * _SEEN + 1 : 2 * _SEEN + 4] = points.sight
    halves[:, _READ_NOISE] = halves[:, _LEFT_NOISE] = points.noise
    floats[:, _LOOKED] = np.inf
    return rows[np.argsort(rows[:, _CELL], kind="stable")]


def _without_dropped(rows: UInt64) -> UInt64:
    dropped = np.isnan(rows.view(np.float64)[:, _TO_Z])
    return rows[~dropped] if dropped.any() else rows


def _passed_on(rows: UInt64) -> UInt64:
    """Return the rows of an outcome as the next stage reads them, without dropped points."""
    rows = _without_dropped(rows).copy()
    floats = rows.view(np.float64)
    floats[:, _X : _Z + 1] = floats[:, _TO_X : _TO_Z + 1]
    floats[:, _LOOKED] = np.inf
    halves = rows.view(np.float32)
    halves[:, _READ_NOISE] = halves[:, _LEFT_NOISE]
    return rows


@inner
def _place_of(rows: UInt64, floats: Float64, i: int, cell_size: float) -> Any:
    """Return the packed cell in which a stage has placed a point; its own where dropped."""
    x, y = floats[i, _TO_X], floats[i, _TO_Y]
    if np.isnan(floats[i, _TO_Z]) or (x == floats[i, _X] and y == floats[i, _Y]):
        return rows[i, _CELL]
    return key_of(int(np.floor(x / cell_size)), int(np.floor(y / cell_size)))


@kernel
def _places(rows: UInt64, floats: Float64, cell_size: float) -> UInt64:
    """Return the packed cell in which a stage has placed each point; `floats` are the rows."""
    places = np.empty(len(rows), dtype=np.uint64)
    for i in range(len(rows)):
        places[i] = _place_of(rows, floats, i, cell_size)
    return places


def _placed(rows: UInt64, floats: Float64, cells: UInt64, cell_size: float) -> UInt64:
    """Return the rows that are placed in some cells, ascending by where they are."""
    placed, ascend = _chosen(rows, floats, cells, cell_size)
    return placed if ascend else placed[np.argsort(placed[:, _CELL], kind="stable")]


@kernel
def _chosen(rows: UInt64, floats: Float64, cells: UInt64, cell_size: float) -> tuple[UInt64, bool]:
    """Return the rows that are placed in some cells, and whether they ascend by where they are.

    Parameters
    ----------
    rows : uint64 (N, _WORDS)
    floats
        The rows, viewed as float64.
    cells : uint64 (C,)
        Packed keys, ascending.
    cell_size : float

    Returns
    -------
    placed : uint64 (M, _WORDS)
        The rows, in their order, with the cells in which they are placed.
    ascend : bool
    """
    placed, ascend = np.empty_like(rows), True
    size = at = ZERO
    for i in range(len(rows)):
        place = _place_of(rows, floats, i, cell_size)
        # Mostly the places ascend, as few points are moved.
        if at > 0 and cells[at - 1] >= place:
            at = place_of(cells, place)
        while at < len(cells) and cells[at] < place:
            at += 1
        if at < len(cells) and cells[at] == place:
            copied(rows, i, ONE, placed, size)
            placed[size, _CELL] = place
            ascend &= size == 0 or placed[size - 1, _CELL] <= place
            size += 1
    return placed[:size], ascend


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
    rows: UInt64,
    floats: Float64,
    halves: Float32,
    asked: Bool,
    xyz: Float64,
    looked: Float64,
    noise: Float32,
    cell_size: float,
) -> tuple[UInt64, UInt64]:
    """Write a stage's results for the points asked for into their rows.

    Parameters
    ----------
    rows : uint64 (N, _WORDS)
    floats, halves
        The rows, viewed as float64 and float32.
    asked : bool (N,)
        The points asked for.
    xyz, looked, noise
        What became of the points, as in `Evaluated`.
    cell_size : float

    Returns
    -------
    cells : uint64 (C,)
        Packed keys of the cells in which something was written.
    places : uint64 (M,)
        Packed keys of the cells in which points were or are placed that are new, or whose outcome
        has changed.
    """
    cells, places = np.empty(len(rows), dtype=np.uint64), np.empty(2 * len(rows), dtype=np.uint64)
    noted = size = 0
    for i in range(len(rows)):
        if not asked[i]:
            continue
        if noted == 0 or cells[noted - 1] != rows[i, _CELL]:
            cells[noted] = rows[i, _CELL]
            noted += 1
        differs = floats[i, _LOOKED] == np.inf
        places[size] = _place_of(rows, floats, i, cell_size)
        for axis in range(3):
            before, after = floats[i, _TO_X + axis], xyz[i, axis]
            differs |= not _same(before, after)
            floats[i, _TO_X + axis] = after
        differs |= not _same(halves[i, _LEFT_NOISE], noise[i])
        halves[i, _LEFT_NOISE] = noise[i]
        floats[i, _LOOKED] = looked[i]
        if differs:
            places[size + 1] = _place_of(rows, floats, i, cell_size)
            size += 2
    return cells[:noted], places[:size]


@inner
def _same(one: float, other: float) -> bool:
    """Return whether two numbers are equal, or both NaN."""
    return bool(one == other or (np.isnan(one) and np.isnan(other)))
