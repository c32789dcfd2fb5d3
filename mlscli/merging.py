"""Maps put together: measured groups that touch become one, inserted patches give way.

Groups merge by [bottom, top], as single linkage over all their points would have it; their
statistics by the formula of T. F. Chan, G. H. Golub and R. J. LeVeque, *Algorithms for Computing
the Sample Variance*, The American Statistician 37, 1983 (doi:10.1080/00031305.1983.10483115).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from mlscli.cells import pack
from mlscli.kernels import kernel
from mlscli.patches import distance, linked, runs, upright, within_gap
from mlscli.surface_map import MEASURED, SurfaceMap
from mlscli.typing import Array, Bool, Float64, Int64


def merge_maps(one: SurfaceMap, other: SurfaceMap) -> SurfaceMap:
    """Return the map of both; see `SurfaceMap.merge`."""
    shift = np.where(other.origin == MEASURED, len(one.route), 0).astype(np.int32)
    other = replace(
        other,
        first_keyframe=other.first_keyframe + shift,
        last_keyframe=other.last_keyframe + shift,
    )
    measured, from_one, from_other = link(one, other)
    of_one = _apart(_inserted(one), measured.take(from_other))
    of_other = _apart(_inserted(other), measured.take(from_one))
    inserted = _yield_to_higher(of_one, of_other).union(_yield_to_higher(of_other, of_one, True))
    merged = measured.union(inserted)
    return replace(
        merged,
        region=np.full(merged.size, -1, dtype=np.int32),
        route=np.concatenate((one.route, other.route)),
    )


def add_measured(surface: SurfaceMap, new: SurfaceMap) -> SurfaceMap:
    """Add the measured patches `new` to a growing map (thesis, section 4.1, step 4).

    They merge with measured patches only, undo corrections made to those, and delete inserted
    patches within `gap_size`. Keyframes of both count from the same route.
    """
    measured, _, touched = link(surface, new)
    return measured.union(_apart(_inserted(surface), measured.take(touched)))


def link(one: SurfaceMap, other: SurfaceMap) -> tuple[SurfaceMap, Bool, Bool]:
    """Link the measured patches of two maps by [bottom, top].

    Returns
    -------
    measured : SurfaceMap
        The linked patches; one that met no other stays as it was, with its correction.
    from_one, from_other : bool (P,)
        Which of them hold patches of the one map, and of the other.
    """
    mine, others = one.take(one.origin == MEASURED), other.take(other.origin == MEASURED)
    both = {
        name: np.concatenate((column, others.columns[name]))
        for name, column in mine.columns.items()
    }
    is_other = np.repeat([False, True], [mine.size, others.size])
    # Ends beyond the first two keep the order of equal groups from depending on the maps' order.
    order = np.lexsort(
        (both["mean"], both["count"], both["top"], both["bottom"], both["iy"], both["ix"])
    )
    both = {name: column[order] for name, column in both.items()}
    is_other = is_other[order]
    cells = runs(pack(both["ix"], both["iy"]))
    start = linked(cells, both["bottom"], both["top"], one.gap_size)
    first = start[:-1]
    merged: dict[str, Any] = {name: column[first] for name, column in both.items()}
    top, mean, variance, count = _chan(
        start, both["top"], both["bottom"], both["mean"], both["variance"], both["count"]
    )
    several = np.diff(start) > 1
    height, depth = upright(top, merged["bottom"], mean, variance, one.thickness)
    merged |= {
        "top": top,
        "mean": mean,
        "variance": variance,
        "count": count,
        "height": np.where(several, height, merged["height"]),
        "depth": np.where(several, depth, merged["depth"]),
    }
    if len(first):
        merged["first_keyframe"] = np.minimum.reduceat(both["first_keyframe"], first)
        merged["last_keyframe"] = np.maximum.reduceat(both["last_keyframe"], first)
        from_other = np.logical_or.reduceat(is_other, first)
        from_one = np.logical_or.reduceat(~is_other, first)
    else:
        from_other = from_one = np.zeros(0, dtype=np.bool_)
    # Groups of a cell are disjoint: in this order they are sorted by height, too.
    return replace(one, **merged), from_one, from_other


@kernel
def _chan(
    start: Int64, top: Float64, bottom: Float64, mean: Float64, variance: Float64, count: Array
) -> tuple[Float64, Float64, Float64, Array]:
    """Return top, mean, variance and count of each run of groups."""
    groups = len(start) - 1
    tops, means, variances = np.empty((3, groups))
    counts = np.empty(groups, dtype=np.uint32)
    for g in range(groups):
        i = start[g]
        lowest, highest, average, points = bottom[i], top[i], mean[i], float(count[i])
        spread = variance[i]
        for i in range(start[g] + 1, start[g + 1]):
            highest = max(highest, top[i])
            total = points + count[i]
            apart = mean[i] - average
            squares = spread * points + variance[i] * count[i]
            spread = (squares + apart * apart * points * count[i] / total) / total
            average = average + apart * count[i] / total
            points = total
        tops[g], variances[g], counts[g] = highest, spread, np.uint32(points)
        means[g] = min(max(average, lowest), highest)
    return tops, means, variances, counts


def _inserted(surface: SurfaceMap) -> SurfaceMap:
    return surface.take(surface.origin != MEASURED)


def _apart(inserted: SurfaceMap, measured: SurfaceMap) -> SurfaceMap:
    """Return the inserted patches that are more than `gap_size` from all measured heights."""
    near = within_gap(
        pack(inserted.ix, inserted.iy),
        inserted.low_end,
        inserted.height,
        pack(measured.cells.ix, measured.cells.iy),
        measured.cells.start,
        measured.bottom,
        measured.top,
        inserted.gap_size,
    )
    return inserted.take(~near)


def _yield_to_higher(mine: SurfaceMap, others: SurfaceMap, equal: bool = False) -> SurfaceMap:
    """Return the inserted patches that no higher one of the other map meets.

    Of two at one height, that of the lower origin, then of the greater depth, stays; of two that
    are the same, the one for which `equal` is False.
    """
    stays = np.ones(mine.size, dtype=np.bool_)
    keys, cells = pack(mine.ix, mine.iy), pack(others.ix, others.iy)
    begin, end = np.searchsorted(cells, keys), np.searchsorted(cells, keys, side="right")
    low, other_low = mine.low_end, others.low_end
    for i in np.flatnonzero(end > begin):
        for j in range(begin[i], end[i]):
            apart = distance(low[i], mine.height[i], other_low[j], others.height[j])
            if apart <= mine.gap_size:
                ranks = [
                    (which.height[k], -int(which.origin[k]), which.depth[k])
                    for which, k in ((mine, i), (others, j))
                ]
                stays[i] &= ranks[0] > ranks[1] or (ranks[0] == ranks[1] and not equal)
    return mine.take(stays)
