"""The exact truth: the map computed from a scene's surfaces instead of measured points.

In each cell, surfaces that lie in one plane count together:

- level or sloping ones are present where they cover at least half of the cell, with the heights of
  the part that they cover;
- upright ones are present at the heights at which at least half a cell's side of them runs through
  the cell: not in a window.

These parts become patches by the rule for points, as if points lay evenly on them: linked by
`gap_size`, horizontal or vertical by their spread. Texture, noise and flight have no influence.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from mlscli.errors import InputError, UsageError
from mlscli.maps.cells import pack, unpack
from mlscli.maps.patches import linked, runs, shapes_of
from mlscli.maps.surface_map import SurfaceMap
from mlscli.runtime.arrays import Float64, Int64, UInt64
from mlscli.runtime.kernels import inner, kernel
from mlscli.runtime.sorting import sort_along
from mlscli.scenes.footprints import Footprints, cells_spanned, footprints
from mlscli.scenes.surfaces import Scene, scene_from_json, scene_to_json
from mlscli.version import __version__

MAX_TRUTH_CELLS = 50_000_000
# Half, less a margin for rounding: a wall counts in a cell in whose middle it ends.
_HALF = 0.5 - 1e-6


def truth(
    scene: Scene, cell_size: float, gap_size: float, thickness: float, frame_id: str = "map"
) -> SurfaceMap:
    """Return the true map of a scene.

    Parameters
    ----------
    scene : Scene
    cell_size, gap_size, thickness : float
        As in `SurfaceMap`, in the unit of the scene.
    frame_id : str
        Name of the map frame.

    Returns
    -------
    SurfaceMap
        All patches are measured, with a count of 1, by keyframe 0, whose row of the route is NaN.
        ``meta["scene"]`` holds the surfaces, for `truth_from_meta`.

    Raises
    ------
    UsageError
        Where a length is out of range, or the cells are too many.
    """
    _check(scene, cell_size, gap_size, thickness)
    flat, walls = footprints(scene.surfaces, cell_size)
    keys, low, high, mean, variance, area = (
        np.concatenate(pair)
        for pair in zip(_covered(flat), _standing(walls, cell_size), strict=True)
    )
    order = np.lexsort((high, low, keys))
    keys, low, high = keys[order], low[order], high[order]
    start = linked(runs(keys), low, high, gap_size)
    first = start[:-1]
    bottom, top = low[first], np.maximum.reduceat(high, first) if len(first) else high[:0]
    average, spread = pool(start, area[order], mean[order], variance[order])
    average = np.clip(average, bottom, top)
    height, depth = shapes_of(top, bottom, average, spread, thickness)
    ix, iy = unpack(keys[first])
    zeros = np.zeros(len(ix), dtype=np.int32)
    return SurfaceMap(
        cell_size,
        gap_size,
        thickness,
        ix=ix,
        iy=iy,
        height=height + 0.0,
        depth=depth + 0.0,
        top=top + 0.0,
        bottom=bottom + 0.0,
        mean=average + 0.0,
        variance=spread,
        noise=np.full(len(ix), np.nan, dtype=np.float32),
        count=np.ones(len(ix), dtype=np.uint32),
        origin=np.zeros(len(ix), dtype=np.uint8),
        moved=np.zeros(len(ix), dtype=np.uint8),
        region=np.full(len(ix), -1, dtype=np.int32),
        first_keyframe=zeros,
        last_keyframe=zeros,
        frame_id=frame_id,
        route=np.full((1, 4), np.nan),
        meta={
            "program": f"mls {__version__}",
            "sources": [scene.name],
            "scene": scene_to_json(scene),
        },
    ).sorted()


def truth_from_meta(
    meta: Mapping[str, Any], cell_size: float, gap_size: float, thickness: float
) -> SurfaceMap:
    """Return the truth of the scene that a truth map's meta holds, on another grid.

    Parameters
    ----------
    meta : mapping
        ``meta`` of a map that `truth` returned.
    cell_size, gap_size, thickness : float
        As in `truth`.

    Raises
    ------
    InputError
        Where the meta holds no scene.
    UsageError
        As `truth`.
    """
    try:
        scene = scene_from_json(meta["scene"])
        if not scene.surfaces:
            raise ValueError("it has no surfaces")
    except (KeyError, ValueError, OverflowError) as error:
        raise InputError(f"meta: holds no scene as mls synth writes it: {error}") from None
    return truth(scene, cell_size, gap_size, thickness)


def _check(scene: Scene, cell_size: float, gap_size: float, thickness: float) -> None:
    for name, length, least in (
        ("cell size", cell_size, "above 0"),
        ("gap size", gap_size, "of 0 or more"),
        ("thickness", thickness, "of 0 or more"),
    ):
        if not math.isfinite(length) or length < 0 or (name == "cell size" and length == 0):
            raise UsageError(f"the truth's {name} is {length:g}; expected a length {least}")
    spanned = cells_spanned(scene.surfaces, cell_size)
    farthest = max(abs(float(bound)) for bounds in scene.bounds for bound in bounds[:2])
    if spanned > MAX_TRUTH_CELLS or farthest / cell_size >= 2**31 - 2:
        raise UsageError(
            f"the truth's cell size is {cell_size:g}, which makes {spanned:.3g} cells of "
            f"{scene.name}; expected one that makes at most {MAX_TRUTH_CELLS}, all within int32"
        )


def _covered(parts: Footprints) -> tuple[UInt64, Float64, Float64, Float64, Float64, Float64]:
    """Return the level and sloping surfaces that are present, by cell and plane.

    Returns
    -------
    keys : uint64 (G,)
        Packed keys of the cells.
    low, high, mean, variance : float64 (G,)
        Of the heights, as in `Footprints`.
    area : float64 (G,)
        Area of the surface itself, not of its projection, in areas of a cell.
    """
    order, start = _by_cell_and_plane(parts)
    parts, first = parts.take(order), start[:-1]
    keys = pack(parts.ix, parts.iy)[first]
    if not len(first):
        none = np.empty(0)
        return keys, none, none, none, none, none
    area = np.add.reduceat(parts.share, first)
    low, high = np.minimum.reduceat(parts.low, first), np.maximum.reduceat(parts.high, first)
    mean, variance = pool(start, parts.share, parts.mean, parts.variance)
    there = area >= _HALF
    return (
        keys[there],
        low[there],
        high[there],
        mean[there],
        variance[there],
        (np.minimum(area, 1.0) * parts.slant[first])[there],
    )


def _standing(
    parts: Footprints, cell_size: float
) -> tuple[UInt64, Float64, Float64, Float64, Float64, Float64]:
    """Return the upright surfaces that are present, as `_covered` does."""
    order, start = _by_cell_and_plane(parts)
    parts = parts.take(order)
    group, low, high, side = _stretches(start, parts.low, parts.high, parts.share, parts.rise)
    keys = pack(parts.ix, parts.iy)[start[group]]
    return keys, low, high, (low + high) / 2, (high - low) ** 2 / 12, side / cell_size


def _by_cell_and_plane(parts: Footprints) -> tuple[Int64, Int64]:
    """Return indices (F,) that sort parts by cell and plane, and where groups start, (G + 1,)."""
    keys = pack(parts.ix, parts.iy)
    order = np.lexsort((parts.plane, keys))
    _, number = np.unique(keys, return_inverse=True)
    planes = int(parts.plane.max(initial=0)) + 1
    return order, runs((number.reshape(-1) * planes + parts.plane)[order])


def pool(
    start: Int64, weight: Float64, mean: Float64, variance: Float64
) -> tuple[Float64, Float64]:
    """Return the weighted mean and variance of each group of parts.

    Parameters
    ----------
    start : int64 (G + 1,)
        The parts of group g are ``start[g]`` to ``start[g + 1]``; no group is empty.
    weight, mean, variance : float64 (F,)
        Weight, mean and variance of each part.

    Returns
    -------
    mean, variance : float64 (G,)
    """
    if len(start) == 1:
        return np.empty(0), np.empty(0)
    first = start[:-1]
    total = np.add.reduceat(weight, first)
    pooled = np.add.reduceat(weight * mean, first) / total
    apart = mean - np.repeat(pooled, np.diff(start))
    return pooled, np.add.reduceat(weight * (variance + apart * apart), first) / total


@kernel
def _stretches(
    start: Int64, low: Float64, high: Float64, share: Float64, rise: Float64
) -> tuple[Int64, Float64, Float64, Float64]:
    """Return the ranges of height in which the parts of a group are half a cell's side long.

    Parameters
    ----------
    start : int64 (G + 1,)
        The parts of group g are ``start[g]`` to ``start[g + 1]``.
    low, high : float64 (F,)
        Lowest and highest height of each part.
    share : float64 (F,)
        Length of each part, in sides of a cell.
    rise : float64 (F,)
        By how much its lower and its upper edge rise within it.

    Returns
    -------
    group : int64 (T,)
        The group of each range.
    low, high : float64 (T,)
        Its ends.
    side : float64 (T,)
        Area of the parts within it, divided by the side of a cell.
    """
    found = 0
    group = np.empty(4 * len(low), dtype=np.int64)
    ends = np.empty((3, 4 * len(low)))
    for g in range(len(start) - 1):
        begin, end = start[g], start[g + 1]
        marks = np.empty(4 * (end - begin))
        for i in range(begin, end):
            at = 4 * (i - begin)
            marks[at], marks[at + 1] = low[i], low[i] + rise[i]
            marks[at + 2], marks[at + 3] = high[i] - rise[i], high[i]
        sort_along(marks, marks)
        reached = -np.inf
        for m in range(len(marks) - 1):
            bottom, top = marks[m], marks[m + 1]
            if top == bottom:
                continue
            # Between marks the length is linear in height.
            first = last = 0.0
            for i in range(begin, end):
                if low[i] <= bottom and high[i] >= top:
                    first += share[i] * _part_at(bottom, low[i], high[i], rise[i])
                    last += share[i] * _part_at(top, low[i], high[i], rise[i])
            if max(first, last) < _HALF:
                continue
            crossing = bottom
            if min(first, last) < _HALF:
                crossing += (top - bottom) * (_HALF - first) / (last - first)
            if first < _HALF:
                bottom, first = crossing, _HALF
            elif last < _HALF:
                top, last = crossing, _HALF
            if bottom != reached:
                group[found] = g
                ends[0, found], ends[2, found] = bottom, 0.0
                found += 1
            ends[1, found - 1] = reached = top
            ends[2, found - 1] += (first + last) / 2 * (top - bottom)
    return group[:found], ends[0, :found], ends[1, :found], ends[2, :found]


@inner
def _part_at(height: float, low: float, high: float, rise: float) -> float:
    """Return which part of its length an upright part has at a height between its ends."""
    if rise == 0.0:
        return 1.0
    begun = min(max((height - low) / rise, 0.0), 1.0)
    ended = min(max((height - high + rise) / rise, 0.0), 1.0)
    return begun - ended
