"""Maps put together: measured groups that touch become one, inserted patches give way.

Groups merge by [bottom, top], as single linkage over all their points would have it; their
statistics by the formula of T. F. Chan, G. H. Golub and R. J. LeVeque, *Algorithms for Computing
the Sample Variance*, The American Statistician 37, 1983 (doi:10.1080/00031305.1983.10483115).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from mlscli.errors import expect
from mlscli.maps.cells import pack
from mlscli.maps.grid import Grid
from mlscli.maps.order import comes_later
from mlscli.maps.patches import begins_group, distance, shape_of, within_gap
from mlscli.maps.records import columns_of, records_of
from mlscli.maps.surface_map import MEASURED, SurfaceMap
from mlscli.runtime.arrays import ZERO, Array, Bool, Int64
from mlscli.runtime.kernels import inner, kernel


def merge_maps(one: SurfaceMap, other: SurfaceMap) -> SurfaceMap:
    """Return the map of both: as if the other's recording had followed the one's.

    Measured groups whose [bottom, top] come within `gap_size` become one (statistics by Chan's
    formula); the others stay as they are. Inserted patches within `gap_size` of what the other
    map measured go; of two inserted ones that meet, one from each map, the higher stays.

    Parameters
    ----------
    one, other : SurfaceMap
        The frame and the meta of the one are kept. The other's keyframes are numbered on from the
        one's route; regions are numbered no more (-1).

    Returns
    -------
    SurfaceMap

    Raises
    ------
    UsageError
        Where cell size, gap size or thickness differ.
    """
    expect(one, SurfaceMap, "one", "a map (SurfaceMap)")
    expect(other, SurfaceMap, "other", "a map (SurfaceMap)")
    one.grid.require_same(other.grid)
    shift = np.where(other.origin == MEASURED, len(one.route), 0).astype(np.int32)
    other = replace(
        other,
        first_keyframe=other.first_keyframe + shift,
        last_keyframe=other.last_keyframe + shift,
    )
    linked, from_one, from_other = _linked(
        records_of(one), records_of(other), one.gap_size, one.thickness
    )
    measured = replace(one, **columns_of(linked))
    of_one = _apart(_inserted(one), measured.take(from_other))
    of_other = _apart(_inserted(other), measured.take(from_one))
    inserted = _yield_to_higher(of_one, of_other).union(_yield_to_higher(of_other, of_one, True))
    merged = measured.union(inserted)
    return replace(
        merged,
        region=np.full(merged.size, -1, dtype=np.int32),
        route=np.concatenate((one.route, other.route)),
    )


def with_measured(records: Array, new: Array, grid: Grid) -> Array:
    """Add measured patches to those of a growing map (thesis, section 4.1, step 4).

    They merge with measured patches only, undo corrections made to those, and delete inserted
    patches within `gap_size`. Both are given as records, in the order of maps; keyframes of both
    count from the same route.
    """
    added: Array = _added(records, new, grid.gap_size, grid.thickness)
    return added


@kernel
def _added(records: Any, new: Any, gap_size: float, thickness: float) -> Array:
    """Return the patches with measured ones added, in the order of maps."""
    measured, _, touched = _linked(records, new, gap_size, thickness)
    together = np.empty(len(records) + len(measured), dtype=records.dtype)
    size = i = first = ZERO
    while i < len(records) or first < len(measured):
        cell = _next_cell(records, i, measured, first)
        begin, last = size, first
        while last < len(measured) and measured[last].cell == cell:
            together[size] = measured[last]
            last += 1
            size += 1
        while i < len(records) and records[i].cell == cell:
            if records[i].origin != MEASURED:
                near = False
                low = records[i].height - records[i].depth
                for j in range(first, last):
                    if touched[j]:
                        bottom, top = measured[j].bottom, measured[j].top
                        near |= distance(low, records[i].height, bottom, top) <= gap_size
                if not near:
                    together[size] = records[i]
                    size += 1
            i += 1
        _sort_cell(together, begin, size)
        first = last
    return together[:size]


@inner
def _next_cell(records: Any, i: int, others: Any, j: int) -> Any:
    """Return the lower of the cells that come next in two lots of patches, of which one may end."""
    if j == len(others) or (i < len(records) and records[i].cell < others[j].cell):
        return records[i].cell
    return others[j].cell


@inner
def _sort_cell(records: Any, begin: int, end: int) -> None:
    """Sort the patches of a cell as maps have them, by insertion: they are few."""
    for i in range(begin + 1, end):
        j = i
        while j > begin and _comes_later(records[j - 1], records[j]):
            _swap(records, j, j - 1)
            j -= 1


@inner
def _comes_later(one: Any, other: Any) -> bool:
    """Tell whether a patch comes after another of its cell in the order of maps."""
    return comes_later(
        one.height, one.depth, one.origin, one["count"],
        other.height, other.depth, other.origin, other["count"],
    )  # fmt: skip


@inner
def _swap(records: Any, i: int, j: int) -> None:
    both = np.empty(1, dtype=records.dtype)
    both[0] = records[i]
    records[i] = records[j]
    records[j] = both[0]


@kernel
def _linked(
    records: Any, others: Any, gap_size: float, thickness: float
) -> tuple[Array, Bool, Bool]:
    """Link the measured ones of two lots of patches by [bottom, top].

    Returns
    -------
    linked : Array
        One that met no other stays as it was, with its correction.
    from_one, from_other : bool (P,)
        Which of them hold patches of the one lot, and of the other.
    """
    linked = np.empty(len(records) + len(others), dtype=records.dtype)
    from_one = np.zeros(len(linked), dtype=np.bool_)
    from_other = np.zeros(len(linked), dtype=np.bool_)
    # The patches of one cell, ascending: those of the first count from 0, the others from there on.
    order = np.empty(len(linked), dtype=np.int64)
    size = i = j = ZERO
    while i < len(records) or j < len(others):
        cell = _next_cell(records, i, others, j)
        several = ZERO
        while i < len(records) and records[i].cell == cell:
            if records[i].origin == MEASURED:
                several = _insert(order, several, i, records, others)
            i += 1
        while j < len(others) and others[j].cell == cell:
            if others[j].origin == MEASURED:
                several = _insert(order, several, len(records) + j, records, others)
            j += 1
        reached, parts = 0.0, 0
        for at in order[:several]:
            is_other = at >= len(records)
            patch = others[at - len(records)] if is_other else records[at]
            if at == order[0] or begins_group(patch.bottom, reached, gap_size):
                _shape(linked, size - 1, parts, thickness)
                linked[size], parts = patch, 0
                reached = patch.top
                size += 1
            else:
                _take_in(linked[size - 1], patch)
                reached = max(reached, patch.top)
            parts += 1
            from_one[size - 1] |= not is_other
            from_other[size - 1] |= is_other
        _shape(linked, size - 1, parts, thickness)
    # Groups of a cell are disjoint: in this order they are sorted by height, too.
    return linked[:size], from_one[:size], from_other[:size]


@inner
def _insert(order: Int64, size: int, number: int, records: Any, others: Any) -> int:
    """Put the number of a patch where its lower end belongs; return how many these are then."""
    place = size
    while place > 0 and _lies_below(number, order[place - 1], records, others):
        order[place] = order[place - 1]
        place -= 1
    order[place] = number
    return size + 1


@inner
def _lies_below(one: int, other: int, records: Any, others: Any) -> bool:
    """Tell whether a patch is linked before another.

    Ends beyond the lower one keep the order of equal groups from depending on that of the maps.
    """
    mine = records[one] if one < len(records) else others[one - len(records)]
    its = records[other] if other < len(records) else others[other - len(records)]
    ends = mine.bottom, mine.top, mine["count"], mine.mean
    return ends < (its.bottom, its.top, its["count"], its.mean)


@inner
def _take_in(group: Any, patch: Any) -> None:
    """Make a group one with a patch that begins no lower (Chan's formula)."""
    points, count = float(group["count"]), float(patch["count"])
    total = points + count
    apart = patch.mean - group.mean
    squares = group.variance * points + patch.variance * count
    group.variance = (squares + apart * apart * points * count / total) / total
    group.top = max(group.top, patch.top)
    group.mean = group.mean + apart * count / total
    group["count"] = np.uint32(total)
    group.first_keyframe = min(group.first_keyframe, patch.first_keyframe)
    group.last_keyframe = max(group.last_keyframe, patch.last_keyframe)


@inner
def _shape(groups: Any, number: int, parts: int, thickness: float) -> None:
    """Give a group of several patches its height and depth; a single one keeps its own."""
    if parts < 2:
        return
    group = groups[number]
    group.mean = min(max(group.mean, group.bottom), group.top)
    group.height, group.depth = shape_of(
        group.top, group.bottom, group.mean, group.variance, thickness
    )


def _inserted(surface: SurfaceMap) -> SurfaceMap:
    return surface.take(surface.origin != MEASURED)


def _apart(inserted: SurfaceMap, measured: SurfaceMap) -> SurfaceMap:
    """Return the inserted patches that are more than `gap_size` from all measured heights."""
    near = within_gap(
        *inserted.cells, inserted.low_end, inserted.height,
        *measured.cells, measured.bottom, measured.top,
        inserted.gap_size,
    )  # fmt: skip
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
