"""Merging of maps: measured patches within the gap size become one, inserted ones give way.

Measured patches merge by [bottom, top], as single linkage over all their points would have it;
their statistics are combined by the formula of T. F. Chan, G. H. Golub and R. J. LeVeque,
*Algorithms for Computing the Sample Variance*, The American Statistician 37, 1983
(doi:10.1080/00031305.1983.10483115).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import reduce
from typing import Any

import numpy as np

from mlscli.errors import UsageError, expect, expect_items
from mlscli.maps.cells import pack
from mlscli.maps.georeference import GEOREFERENCE, of_both
from mlscli.maps.grid import Grid
from mlscli.maps.order import comes_later
from mlscli.maps.patches import begins_group, distance, shape_of, within_gap
from mlscli.maps.recorded import TURN, turns_apart
from mlscli.maps.records import columns_of, records_of
from mlscli.maps.surface_map import MEASURED, SurfaceMap
from mlscli.runtime.arrays import ZERO, Array, Bool, Int64
from mlscli.runtime.kernels import inner, kernel


def merge_maps(one: SurfaceMap, other: SurfaceMap) -> SurfaceMap:
    """Merge two maps, as if the recording of `other` had followed that of `one`.

    Measured patches whose [bottom, top] come within `gap_size` become one (statistics by Chan's
    formula); all others stay as they are, but for ends that a stage moved to within `gap_size` of
    a patch that the other map measured, which go back. Inserted patches within `gap_size` of a
    patch that the other map measured are removed; where inserted patches of both maps come within
    `gap_size`, the higher stays.

    Parameters
    ----------
    one, other : SurfaceMap
        Of one frame.

    Returns
    -------
    SurfaceMap
        Its route is that of `one`, then that of `other`; no patch has a region (-1). Counts of
        free space add; where one of the maps has none, the result has none. In `meta` sources
        follow one another and counts add; what else the maps do not agree on is left out.

    Raises
    ------
    TypeError
        Where an argument is not a map.
    UsageError
        Where cell size, gap size or thickness differ, the frames have different names, the
        turns by which the recordings came into them (`mlscli.maps.recorded`) differ by more than a
        rounding, or they lie in different places on Earth (`mlscli.maps.georeference`).
    InputError
        Where the meta of a map holds no turn or georeference in this place.
    """
    expect(one, SurfaceMap, "one", "a map (SurfaceMap)")
    expect(other, SurfaceMap, "other", "a map (SurfaceMap)")
    one.grid.require_same(other.grid)
    require_same_frame(one.frame_id, one.meta, other.frame_id, other.meta)
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
        free=one.free and other.free and one.free.union(other.free),
        meta=meta_of_both(one.meta, other.meta),
    )


def linked_alone(surface: SurfaceMap) -> SurfaceMap:
    """Return a map whose measured patches that come within `gap_size` of each other became one.

    Parameters
    ----------
    surface : SurfaceMap
        Of measured patches alone, in the file's order. They may overlap.
    """
    records = records_of(surface)
    linked, _, _ = _linked(records, records[:0], surface.gap_size, surface.thickness)
    joined = replace(surface, **columns_of(linked))
    return joined.with_columns(moved=joined.beyond_points().astype(np.uint8))


def merge_all(surfaces: Sequence[SurfaceMap]) -> SurfaceMap:
    """Merge maps one after the other, see `merge_maps`.

    Parameters
    ----------
    surfaces : sequence of SurfaceMap
        One or more.
    """
    expect_items(surfaces, "surfaces", "a list of maps (SurfaceMap)")
    if not surfaces:
        raise UsageError("surfaces: expected one map or more")
    return reduce(merge_maps, surfaces)


def meta_of_both(one: Mapping[str, Any], other: Mapping[str, Any]) -> dict[str, Any]:
    """Return the meta of two flights as that of one."""
    # The turns are known to agree but for a rounding.
    both = {name: value for name, value in one.items() if name == TURN or other.get(name) == value}
    place = of_both(one, other)
    both |= {} if place is None else {GEOREFERENCE: place.to_dict()}
    for name in ("sources", "points", "keyframes", "batches"):
        together = _together(one.get(name), other.get(name))
        both |= {} if together is None else {name: together}
    return both


def _together(one: Any, other: Any) -> Any:
    """Return counts added, by name where they have names, and lists joined; None: neither."""
    if isinstance(one, list) and isinstance(other, list):
        return one + other
    if isinstance(one, int) and isinstance(other, int):
        return one + other
    if isinstance(one, dict) and isinstance(other, dict):
        names = sorted(one.keys() | other.keys())
        added = {name: _together(one.get(name, 0), other.get(name, 0)) for name in names}
        return {name: count for name, count in added.items() if count is not None}
    return None


def require_same_frame(
    frame: str, meta: Mapping[str, Any], other: str, other_meta: Mapping[str, Any]
) -> None:
    """Refuse maps that do not lie in one frame, by the names of their frames and their meta.

    Raises
    ------
    InputError, UsageError
        As `merge_maps`.
    """
    if frame != other:
        raise UsageError(f"maps of different frames do not go together: {frame!r} and {other!r}")
    apart = turns_apart(meta, other_meta)
    if apart is not None:
        raise UsageError(
            f"maps that were turned in different ways do not go together: their {TURN} differ by "
            f"{apart:.3g}; build both with the same `up`"
        )


def with_measured(records: Array, new: Array, grid: Grid) -> Array:
    """Add measured patches to those of a growing map (thesis, section 4.1, step 4).

    They merge with measured patches only, and what stages made gives way to them: they undo the
    corrections of those they merge with, and of those that were moved to within `gap_size` of
    them, and remove inserted patches within `gap_size`.

    Parameters
    ----------
    records, new : PATCH (P,)
        The patches of the map, and those to add, as records (see `mlscli.maps.records`) in the
        file's order. The keyframes of both are rows of the same route.
    grid : Grid

    Returns
    -------
    PATCH (P,)
        The patches of the grown map, in the file's order.
    """
    added: Array = _added(records, new, grid.gap_size, grid.thickness)
    return added


@kernel
def _added(records: Any, new: Any, gap_size: float, thickness: float) -> Array:
    """Return the patches with measured ones added, in the file's order."""
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
    """Return the next cell of two sets of patches, of which at most one has come to its end."""
    if j == len(others) or (i < len(records) and records[i].cell < others[j].cell):
        return records[i].cell
    return others[j].cell


@inner
def _sort_cell(records: Any, begin: int, end: int) -> None:
    """Put the patches of a cell in the file's order, by insertion sort: they are few."""
    for i in range(begin + 1, end):
        j = i
        while j > begin and _comes_later(records[j - 1], records[j]):
            _swap(records, j, j - 1)
            j -= 1


@inner
def _comes_later(one: Any, other: Any) -> bool:
    """Return whether a patch comes after another of its cell in the file's order."""
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
    """Merge the measured patches of two sets by single linkage of [bottom, top].

    Returns
    -------
    linked : PATCH (P,)
        The merged patches, ascending by cell and bottom. One that met no other keeps its
        correction, unless this brings it within `gap_size` of one that holds another set's.
    from_one, from_other : bool (P,)
        Whether each holds a patch of `records`, and one of `others`.
    """
    linked = np.empty(len(records) + len(others), dtype=records.dtype)
    from_one = np.zeros(len(linked), dtype=np.bool_)
    from_other = np.zeros(len(linked), dtype=np.bool_)
    # The patches of one cell by lower end: those of `records` are numbered first, then `others`.
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
                shape(linked, size - 1, parts, thickness)
                linked[size], parts = patch, 0
                reached = patch.top
                size += 1
            else:
                take_in(linked[size - 1], patch)
                reached = max(reached, patch.top)
            parts += 1
            from_one[size - 1] |= not is_other
            from_other[size - 1] |= is_other
        shape(linked, size - 1, parts, thickness)
    _give_way(linked[:size], from_other, gap_size, thickness)
    _give_way(linked[:size], from_one, gap_size, thickness)
    # The groups of a cell are disjoint, so this order is also that of their heights.
    return linked[:size], from_one[:size], from_other[:size]


@inner
def _give_way(measured: Any, others: Bool, gap_size: float, thickness: float) -> None:
    """Undo corrections that reach within `gap_size` of a patch which holds one of the others."""
    begin = ZERO
    for i in range(len(measured)):
        begin = i if measured[begin].cell != measured[i].cell else begin
        if others[i] or not measured[i].moved:
            continue
        low, near, j = measured[i].height - measured[i].depth, False, begin
        while j < len(measured) and measured[j].cell == measured[i].cell:
            bottom, top = measured[j].bottom, measured[j].top
            near |= others[j] and distance(low, measured[i].height, bottom, top) <= gap_size
            j += 1
        if near:
            _reshape(measured, i, thickness)


@inner
def _insert(order: Int64, size: int, number: int, records: Any, others: Any) -> int:
    """Insert the number of a patch into `order` by its lower end; return the new size."""
    place = size
    while place > 0 and _lies_below(number, order[place - 1], records, others):
        order[place] = order[place - 1]
        place -= 1
    order[place] = number
    return size + 1


@inner
def _lies_below(one: int, other: int, records: Any, others: Any) -> bool:
    """Return whether a patch is linked before another: by bottom, then top, count and mean.

    All but the bottom break ties, so that the result does not depend on the order of the maps.
    """
    mine = records[one] if one < len(records) else others[one - len(records)]
    its = records[other] if other < len(records) else others[other - len(records)]
    ends = mine.bottom, mine.top, mine["count"], mine.mean
    return ends < (its.bottom, its.top, its["count"], its.mean)


@inner
def take_in(group: Any, patch: Any) -> None:
    """Merge a patch into a group whose bottom is no higher, by Chan's formula."""
    points, count = float(group["count"]), float(patch["count"])
    total = points + count
    apart = patch.mean - group.mean
    squares = group.variance * points + patch.variance * count
    group.noise = _pooled(group.noise, points, patch.noise, count)
    group.variance = (squares + apart * apart * points * count / total) / total
    group.top = max(group.top, patch.top)
    group.mean = group.mean + apart * count / total
    group["count"] = np.uint32(total)
    group.first_keyframe = min(group.first_keyframe, patch.first_keyframe)
    group.last_keyframe = max(group.last_keyframe, patch.last_keyframe)


@inner
def _pooled(noise: float, points: float, other: float, count: float) -> float:
    """Return the mean noise of all points of two patches; of one where that of the other is NaN."""
    if noise != noise:
        return other
    if other != other:
        return noise
    return (noise * points + other * count) / (points + count)


@inner
def shape(groups: Any, number: int, parts: int, thickness: float) -> None:
    """Compute height and depth of a group of several patches; a single patch keeps its own."""
    if parts > 1:
        groups[number].mean = min(
            max(groups[number].mean, groups[number].bottom), groups[number].top
        )
        _reshape(groups, number, thickness)


@inner
def _reshape(groups: Any, number: int, thickness: float) -> None:
    """Compute height and depth of a group from its points, without corrections."""
    group = groups[number]
    group.height, group.depth = shape_of(
        group.top, group.bottom, group.mean, group.variance, thickness
    )
    group.moved = 0


def _inserted(surface: SurfaceMap) -> SurfaceMap:
    return surface.take(surface.origin != MEASURED)


def _apart(inserted: SurfaceMap, measured: SurfaceMap) -> SurfaceMap:
    """Return the inserted patches farther than `gap_size` from all measured ones of their cell."""
    near = within_gap(
        inserted.cells, inserted.low_end, inserted.height,
        measured.cells, measured.bottom, measured.top,
        inserted.gap_size,
    )  # fmt: skip
    return inserted.take(~near)


def _yield_to_higher(mine: SurfaceMap, others: SurfaceMap, equal: bool = False) -> SurfaceMap:
    """Return the inserted patches that do not give way to one of the other map.

    Of two within `gap_size` of each other the higher stays; at one height, that of the lower
    origin, then that of the greater depth. Of two equal ones, `mine` gives way if `equal` is True.
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
