"""Points sorted by blocks of cells, in memory or on disk, so that areas can be read alone."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple, Protocol

import numpy as np

from mlscli.keyframes.batches import Points
from mlscli.maps.cells import GREATEST_INDEX, LEAST_INDEX, Limits, pack, unpack
from mlscli.maps.patches import runs
from mlscli.pipeline.stages.ordering import cells_of
from mlscli.runtime.arrays import Array, Bool, Float64, Int32, Int64, UInt64

# A block is 2**4 cells wide: a fraction of the margin that the default pipeline needs.
BLOCK_BITS = 4

# A point: the fields of `Points`, but no noise, of which nothing is known yet.
POINT = np.dtype([("xyz", np.float64, (3,)), ("keyframe", np.int32), ("sight", np.float32, (3,))])


class Sliceable(Protocol):
    """An array in memory, or one on disk that is read slice by slice."""

    def __getitem__(self, part: slice, /) -> Array: ...


class SortedPoints(NamedTuple):
    """Points that were added together, sorted by block.

    Attributes
    ----------
    blocks : uint64 (B,)
        Packed keys of the blocks, ascending, each once.
    start : int64 (B + 1,)
        The points of block b are ``points[start[b]:start[b + 1]]``.
    points : Sliceable
        Records, `POINT` (N,).
    """

    blocks: UInt64
    start: Int64
    points: Sliceable


class Occupied(NamedTuple):
    """Blocks that hold points.

    Attributes
    ----------
    ix, iy : int32 (B,)
        Indices of the blocks; block (0, 0) begins at cell (0, 0).
    points : int64 (B,)
        How many points each holds.
    """

    ix: Int32
    iy: Int32
    points: Int64


class PointBlocks:
    """Points by blocks of cells.

    Parameters
    ----------
    cell_size : float
        Side of a cell, in the unit of the recording.
    put : callable, optional
        Stores an array, as `Scratch.put` does; by default points stay in memory.
    shift : int
        Blocks are ``2**shift`` cells wide.
    """

    def __init__(
        self,
        cell_size: float,
        put: Callable[[Array], Sliceable] | None = None,
        shift: int = BLOCK_BITS,
    ) -> None:
        self.shift = shift
        self._cell_size = cell_size
        self._put = put or (lambda array: array)
        self._runs: list[SortedPoints] = []

    def add(self, points: Points) -> None:
        """Add points, all of them on the grid."""
        ix, iy = cells_of(points.xyz, self._cell_size)
        keys = pack(ix >> self.shift, iy >> self.shift)
        order = np.argsort(keys, kind="stable")
        keys = keys[order]
        records = np.empty(points.size, POINT)
        for name in POINT.fields or ():
            records[name] = getattr(points, name)[order]
        start = runs(keys)
        self._runs.append(SortedPoints(keys[start[:-1]], start, self._put(records)))

    @property
    def entries(self) -> int:
        """How many blocks are listed in memory, counted once for each call of `add`."""
        return sum(len(run.blocks) for run in self._runs)

    def occupied(self) -> Occupied:
        """Return the blocks that hold points."""
        keys = np.concatenate([np.empty(0, np.uint64), *(run.blocks for run in self._runs)])
        sizes = np.concatenate([np.empty(0, np.int64), *(np.diff(run.start) for run in self._runs)])
        blocks, places = np.unique(keys, return_inverse=True)
        points = np.zeros(len(blocks), dtype=np.int64)
        np.add.at(points, places, sizes)
        return Occupied(*unpack(blocks), points)

    def around(self, cells: UInt64) -> Iterator[Float64]:
        """Yield where points lie, float64 (N, 3): all those in some cells, and others nearby.

        Parameters
        ----------
        cells : uint64 (C,)
            Packed keys of the cells.
        """
        ix, iy = unpack(cells)
        blocks = np.unique(pack(ix >> self.shift, iy >> self.shift))
        for run in self._runs:
            for part in _slices(run, 0, np.isin(run.blocks, blocks, assume_unique=True)):
                yield np.ascontiguousarray(part["xyz"])

    def extract(self, limits: Limits) -> Points:
        """Return the points in the cells within limits."""
        blocks = Limits(*(None if end is None else end >> self.shift for end in limits))
        parts = [part for run in self._runs for part in _slices_within(run, blocks)]
        records = np.concatenate([np.empty(0, POINT), *parts])
        columns = [np.ascontiguousarray(records[name]) for name in POINT.fields or ()]
        points = Points._make([*columns, np.full(len(records), np.nan, dtype=np.float32)])
        return points.take(limits.contain(*cells_of(points.xyz, self._cell_size)))


def _slices_within(run: SortedPoints, limits: Limits) -> Iterator[Array]:
    """Yield the points of the blocks within limits."""
    least = LEAST_INDEX if limits.min_x is None else max(limits.min_x, LEAST_INDEX)
    greatest = GREATEST_INDEX if limits.max_x is None else min(limits.max_x, GREATEST_INDEX)
    low, high = pack(np.array([least, greatest]), np.array([LEAST_INDEX, GREATEST_INDEX]))
    first, last = (
        int(np.searchsorted(run.blocks, low)),
        int(np.searchsorted(run.blocks, high, side="right")),
    )
    return _slices(run, first, limits.contain(*unpack(run.blocks[first:last])))


def _slices(run: SortedPoints, first: int, wanted: Bool) -> Iterator[Array]:
    """Yield the points of the blocks from `first` on that are wanted, one slice for successive."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], wanted, [False])).astype(np.int8)))
    for begin, end in (edges + first).reshape(-1, 2):
        yield run.points[int(run.start[begin]) : int(run.start[end])]
