"""Patches as records: all that a map knows of a patch, side by side in memory.

Columns suit code that reads one property of all patches. Code that moves whole patches, as a
growing map does, uses records: by their fields, or as rows of 8-byte words where it need not know
what they hold.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from mlscli.maps.cells import cell_of, key_of
from mlscli.maps.columns import COLUMNS
from mlscli.maps.grid import Grid
from mlscli.maps.surface_map import SurfaceMap
from mlscli.runtime.arrays import Array, Float32, Float64, Int32, UInt8, UInt32, UInt64
from mlscli.runtime.kernels import kernel

PATCH = np.dtype(
    [
        # The packed key of the cell.
        ("cell", np.uint64),
        ("height", np.float64),
        ("depth", np.float64),
        ("top", np.float64),
        ("bottom", np.float64),
        ("mean", np.float64),
        ("variance", np.float64),
        ("count", np.uint32),
        ("region", np.int32),
        ("first_keyframe", np.int32),
        ("last_keyframe", np.int32),
        ("noise", np.float32),
        # So wide that a record has no padding: records can be compared bytewise.
        ("origin", np.uint16),
        ("moved", np.uint16),
    ]
)
WORDS = PATCH.itemsize // 8


def records_of(surface: SurfaceMap) -> Array:
    """Return the patches of a map as records, (P,)."""
    records = np.empty(surface.size, PATCH)
    _put_together(records, *surface.columns.values())
    return records


def columns_of(records: Array) -> dict[str, Any]:
    """Return the columns of records by name, for `SurfaceMap.of`; patches keep their order."""
    return dict(zip(COLUMNS, _taken_apart(np.asarray(records)), strict=True))


def surface_of(records: Array, grid: Grid) -> SurfaceMap:
    """Return the map of records, which must be in the file's order; it has no route."""
    return SurfaceMap.of(grid, columns_of(records))


def rows_in(records: Array) -> UInt64:
    """Return a view of records as rows of words, uint64 (P, WORDS)."""
    return records.view(np.uint64).reshape(-1, WORDS)


def records_in(rows: UInt64) -> Array:
    """Return a view of rows of words as records, (P,)."""
    return rows.view(PATCH).reshape(-1)


def points_of(rows: UInt64) -> int:
    """Return how many measured points rows hold."""
    return int(counted(records_in(rows)))


@kernel
def counted(records: Any) -> int:
    """Return how many measured points records hold."""
    points = 0
    for i in range(len(records)):
        points += records[i]["count"]
    return points


@kernel
def _put_together(
    records: Any,
    ix: Int32,
    iy: Int32,
    height: Float64,
    depth: Float64,
    top: Float64,
    bottom: Float64,
    mean: Float64,
    variance: Float64,
    noise: Float32,
    count: UInt32,
    origin: UInt8,
    moved: UInt8,
    region: Int32,
    first: Int32,
    last: Int32,
) -> None:
    """Write columns into records.

    Parameters
    ----------
    records : PATCH (P,)
        Receives the patches.
    ix, iy : int32 (P,)
    height, depth, top, bottom, mean, variance : float64 (P,)
    noise : float32 (P,)
    count : uint32 (P,)
    origin, moved : uint8 (P,)
    region : int32 (P,)
        As in `SurfaceMap`.
    first, last : int32 (P,)
        The first and the last keyframe.
    """
    for i in range(len(records)):
        patch = records[i]
        patch.cell = key_of(ix[i], iy[i])
        patch.height, patch.depth = height[i], depth[i]
        patch.top, patch.bottom = top[i], bottom[i]
        patch.mean, patch.variance, patch.noise = mean[i], variance[i], noise[i]
        patch["count"], patch.origin, patch.region = count[i], origin[i], region[i]
        patch.moved = moved[i]
        patch.first_keyframe, patch.last_keyframe = first[i], last[i]


@kernel
def _taken_apart(records: Any) -> Any:
    """Return the columns of records, in the order of `COLUMNS`."""
    size = len(records)
    ix, iy = np.empty(size, np.int32), np.empty(size, np.int32)
    height, depth = np.empty(size), np.empty(size)
    top, bottom = np.empty(size), np.empty(size)
    mean, variance = np.empty(size), np.empty(size)
    noise = np.empty(size, np.float32)
    count, region = np.empty(size, np.uint32), np.empty(size, np.int32)
    origin, moved = np.empty(size, np.uint8), np.empty(size, np.uint8)
    first, last = np.empty(size, np.int32), np.empty(size, np.int32)
    for i in range(size):
        patch = records[i]
        ix[i], iy[i] = cell_of(patch.cell)
        height[i], depth[i] = patch.height, patch.depth
        top[i], bottom[i] = patch.top, patch.bottom
        mean[i], variance[i], noise[i] = patch.mean, patch.variance, patch.noise
        count[i], region[i] = patch["count"], patch.region
        origin[i], moved[i] = patch.origin, patch.moved
        first[i], last[i] = patch.first_keyframe, patch.last_keyframe
    measured = top, bottom, mean, variance, noise, count
    return ix, iy, height, depth, *measured, origin, moved, region, first, last
