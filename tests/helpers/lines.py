"""Through which voxels lines pass, in exact fractions, from the words of the rule.

Slow, and without a traversal: where a line crosses borders of voxels is computed for each border
by itself, and the voxel between two crossings is the one that holds the place halfway.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from decimal import Decimal, localcontext
from fractions import Fraction
from itertools import pairwise

import numpy as np

from mlscli.keyframes.batches import Points
from mlscli.maps.free_space import FreeSpace
from mlscli.runtime.arrays import Float64

Voxel = tuple[int, int, int]
PARTS = 65536
"""To so many parts of a voxel's side the ends of lines are rounded."""


def passed(craft: Sequence[float], point: Sequence[float], cell_size: float) -> set[Voxel]:
    """Return the voxels that a line from the craft to a cell before the point passes through."""
    if not all(map(math.isfinite, craft)):
        return set()
    begin, end = ([Fraction(value) for value in place] for place in (craft, point))
    size = Fraction(cell_size)
    length = _root(sum(((b - a) ** 2 for a, b in zip(begin, end, strict=True)), Fraction()))
    if length <= size:
        return set()
    shorter = [b - (b - a) * size / length for a, b in zip(begin, end, strict=True)]
    sides = size, size, size / 2
    first, last = (
        [
            Fraction(round(value / side * PARTS), PARTS)
            for value, side in zip(place, sides, strict=True)
        ]
        for place in (begin, shorter)
    )
    return set(between(first, last))


def between(first: Sequence[Fraction], last: Sequence[Fraction]) -> Iterable[Voxel]:
    """Yield the voxels of side 1 that a line passes through."""
    crossings = {Fraction(0), Fraction(1)}
    for a, b in zip(first, last, strict=True):
        low, high = min(a, b), max(a, b)
        if low < high:
            borders = range(math.floor(low) + 1, math.ceil(high))
            crossings |= {(border - a) / (b - a) for border in borders}
    if list(first) == list(last):
        return
    for one, other in pairwise(sorted(crossings)):
        middle = [a + (b - a) * (one + other) / 2 for a, b in zip(first, last, strict=True)]
        if not any(value.denominator == 1 for value in middle):
            x, y, z = map(math.floor, middle)
            yield x, y, z


def _root(square: Fraction) -> Fraction:
    with localcontext() as context:
        context.prec = 60
        root = (Decimal(square.numerator) / Decimal(square.denominator)).sqrt()
    return Fraction(root)


def counted(points: Points, route: Float64, cell_size: float) -> dict[Voxel, int]:
    """Return how many lines pass through each voxel, 255 at most."""
    counts: Counter[Voxel] = Counter()
    for xyz, keyframe in zip(points.xyz.tolist(), points.keyframe.tolist(), strict=True):
        counts.update(passed(route[keyframe, 1:].tolist(), xyz, cell_size))
    return {voxel: min(count, 255) for voxel, count in counts.items()}


def free_space_of(counts: dict[Voxel, int]) -> FreeSpace:
    """Return free space with these counts."""
    voxels = sorted(counts)
    cells = sorted({voxel[:2] for voxel in voxels})
    per_cell = Counter(voxel[:2] for voxel in voxels)
    ix, iy = np.array(cells, dtype=np.int32).reshape(-1, 2).T.copy()
    return FreeSpace(
        ix,
        iy,
        np.cumsum([0, *(per_cell[cell] for cell in cells)]).astype(np.int64),
        np.array([voxel[2] for voxel in voxels], dtype=np.int32),
        np.array([counts[voxel] for voxel in voxels], dtype=np.uint8),
    )


def counts_of(free: FreeSpace) -> dict[Voxel, int]:
    """Return free space as counts by voxel."""
    rows = zip(free.voxels.tolist(), free.lines.tolist(), strict=True)
    return {(x, y, z): count for (x, y, z), count in rows}
