"""The columns of a map: their names, types and order."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import accumulate
from typing import Any

import numpy as np

from mlscli.runtime.arrays import Array, frozen

COLUMNS: Mapping[str, np.dtype[Any]] = {
    "ix": np.dtype(np.int32),
    "iy": np.dtype(np.int32),
    "height": np.dtype(np.float64),
    "depth": np.dtype(np.float64),
    "top": np.dtype(np.float64),
    "bottom": np.dtype(np.float64),
    "mean": np.dtype(np.float64),
    "variance": np.dtype(np.float64),
    "noise": np.dtype(np.float32),
    "count": np.dtype(np.uint32),
    "origin": np.dtype(np.uint8),
    "moved": np.dtype(np.uint8),
    "region": np.dtype(np.int32),
    "first_keyframe": np.dtype(np.int32),
    "last_keyframe": np.dtype(np.int32),
}
STATISTICS = ("top", "bottom", "mean", "variance")

UNMEASURED: Mapping[str, float] = {
    **dict.fromkeys((*STATISTICS, "noise"), np.nan),
    **dict.fromkeys(("count", "moved"), 0),
    **dict.fromkeys(("region", "first_keyframe", "last_keyframe"), -1),
}
"""What all inserted patches hold alike, by column."""

# Where the columns begin in a block of memory for one patch, and the length of the block.
_OFFSETS = tuple(accumulate((dtype.itemsize for dtype in COLUMNS.values()), initial=0))


# The columns whose values have 1, 4 and 8 bytes, and unsigned integers of as many.
_BARE: Sequence[tuple[Any, Sequence[str]]] = [
    (kind, [name for name, dtype in COLUMNS.items() if dtype.itemsize == np.dtype(kind).itemsize])
    for kind in (np.uint8, np.uint32, np.uint64)
]


def bare(columns: Mapping[str, Array]) -> list[tuple[Array, ...]]:
    """Return columns as unsigned integers, a tuple for those of each size.

    So a kernel that moves values is compiled for few types, and called for few columns at once.
    """
    return [tuple(_viewed(columns[name], kind) for name in names) for kind, names in _BARE]


def _viewed(column: Array, kind: Any) -> Array:
    if not column.flags.c_contiguous:
        column = frozen(column.copy())
    return column.view(kind)


def new_columns(size: int) -> dict[str, Any]:
    """Return columns by name, for `size` patches, not initialised.

    They share one block of memory: one large allocation is faster than many small ones.
    """
    # A multiple of 64, so that each column is aligned.
    room = -(-size // 64) * 64
    block = np.empty(room * _OFFSETS[-1], dtype=np.uint8)
    return {
        name: np.ndarray(size, dtype, block, room * offset)
        for (name, dtype), offset in zip(COLUMNS.items(), _OFFSETS, strict=False)
    }
