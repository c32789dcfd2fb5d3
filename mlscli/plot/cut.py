"""A line across a map: the cells that it runs through, their patches, and the space between."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from mlscli.errors import UsageError
from mlscli.maps.cells import on_grid, pack
from mlscli.maps.space import FREE, space_at
from mlscli.maps.surface_map import SurfaceMap
from mlscli.queries.levels import levels_at
from mlscli.runtime.arrays import Bool, Float64, Int32, Int64, repeated

# The cells of longer cuts would be narrower than a pixel.
MAX_SECTION_CELLS = 200_000


class Cut(NamedTuple):
    """The cells that a line runs through, in order, and the patches in them.

    Attributes
    ----------
    ix, iy : int32 (S,)
        Indices of the cells.
    edge : float64 (S + 1,)
        Distances along the line at which cell s begins and ends: ``edge[s]``, ``edge[s + 1]``.
    step : int64 (M,)
        The cell of each patch met, its number along the line, ascending.
    patch : int64 (M,)
        Indices of these patches in the map; those of one cell follow one another from below.
    """

    ix: Int32
    iy: Int32
    edge: Float64
    step: Int64
    patch: Int64

    @property
    def begin(self) -> Float64:
        """Where the cell of each patch begins along the line, float64 (M,)."""
        return self.edge[self.step]

    @property
    def end(self) -> Float64:
        """Where the cell of each patch ends along the line, float64 (M,)."""
        return self.edge[self.step + 1]


class Spaces(NamedTuple):
    """Parts of the plane of a cut, each over one cell.

    Attributes
    ----------
    begin, end : float64 (N,)
        Distances along the line; `begin` ascends.
    low, high : float64 (N,)
        Heights.
    """

    begin: Float64
    end: Float64
    low: Float64
    high: Float64


class Clearance(NamedTuple):
    """The narrowest place of a stretch between two levels.

    Attributes
    ----------
    along : float
        Where along the line.
    low, high : float
        The heights between which it is clear.
    """

    along: float
    low: float
    high: float


def cut(surface: SurfaceMap, start: tuple[float, float], end: tuple[float, float]) -> Cut:
    """Return what a line meets.

    Parameters
    ----------
    surface : SurfaceMap
    start, end : tuple of float
        x and y of the line's ends, in the unit of the map.

    Raises
    ------
    UsageError
        Where the line has no length, leaves the grid, or runs through too many cells.
    """
    line = np.array([start, end], dtype=np.float64)
    length = math.dist(start, end)
    words = in_words(start, end)
    if not 0 < length < math.inf or not on_grid(line, surface.cell_size).all():
        raise UsageError(f"`section` {words}: expected two different places on the grid")
    if length / surface.cell_size > MAX_SECTION_CELLS:
        raise UsageError(
            f"`section` {words}: runs through {length / surface.cell_size:.3g} cells; "
            f"expected at most {MAX_SECTION_CELLS}"
        )
    crossings = [np.array([0.0, 1.0])]
    for a, b in line.T / surface.cell_size:
        edges = np.arange(math.ceil(min(a, b)), math.floor(max(a, b)) + 1)
        crossings.append((edges - a) / (b - a) if a != b else np.empty(0))
    share = np.unique(np.clip(np.concatenate(crossings), 0, 1))
    middle = line[0] + (share[:-1, None] + share[1:, None]) / 2 * (line[1] - line[0])
    cell = np.floor(middle / surface.cell_size).astype(np.int32)
    levels = levels_at(surface, middle)
    step, _ = repeated(np.diff(levels.start))
    return Cut(cell[:, 0], cell[:, 1], share * length, step, levels.patch)


def in_words(*places: tuple[float, float], between: str = ",") -> str:
    """Return coordinates as text, with nine digits: those of UTM to the centimetre."""
    return between.join(f"{number:.9g}" for place in places for number in place)


def between_levels(surface: SurfaceMap, met: Cut) -> Spaces:
    """Return the spaces between a patch and the next one above it."""
    over = np.flatnonzero(met.step[1:] == met.step[:-1]) + 1
    floor, ceiling = surface.height[met.patch[over - 1]], surface.low_end[met.patch[over]]
    return Spaces(met.begin[over], met.end[over], floor, ceiling)


def seen_through(surface: SurfaceMap, met: Cut) -> Spaces | None:
    """Return what is free, see `space_at`; None where the map does not say."""
    space = surface.free
    if space is None:
        return None
    half = surface.cell_size / 2
    keys, sought = pack(space.ix, space.iy), pack(met.ix, met.iy)
    begin, end = (space.start[np.searchsorted(keys, sought, side)] for side in ("left", "right"))
    step, place = repeated(end - begin)
    iz = space.iz[begin[step] + place].astype(np.float64)
    across = [(index[step] + 0.5) * surface.cell_size for index in (met.ix, met.iy)]
    free = space_at(surface, np.column_stack((*across, (iz + 0.5) * half))) == FREE
    step, iz = step[free], iz[free]
    # Voxels on top of each other are one space.
    ends = np.append((np.diff(step) > 0) | (np.diff(iz) > 1), [True] * bool(len(iz)))
    first, last = np.flatnonzero(np.append([True], ends[:-1])[: len(ends)]), np.flatnonzero(ends)
    step = step[last]
    return Spaces(met.edge[step], met.edge[step + 1], iz[first] * half, (iz[last] + 1) * half)


def earth(surface: SurfaceMap, met: Cut, bottom: float) -> Spaces:
    """Return what lies beneath the ground, down to a height.

    The lowest patch of a cell is ground, unless it hangs: it was seen through what is beneath, or
    it belongs to a stretch that ends on both sides high above the lowest patch beside it.
    """
    lowest = np.flatnonzero(np.append([True], met.step[1:] != met.step[:-1])[: len(met.step)])
    low = surface.low_end[met.patch[lowest]]
    ground = ~_hanging(low, max(surface.gap_size, surface.cell_size))
    free = seen_through(surface, met)
    if free is not None:
        beneath = np.full(len(met.edge), np.inf)
        np.minimum.at(beneath, np.searchsorted(met.edge, free.begin), free.low)
        ground &= ~(beneath[met.step[lowest]] < low - surface.cell_size)
    kept = lowest[ground]
    return Spaces(met.begin[kept], met.end[kept], np.full(len(kept), bottom), low[ground])


def _hanging(low: Float64, step: float) -> Bool:
    """Return which of the lowest ends along a line lie between lower ones, with steps beside."""
    starts = np.flatnonzero(np.abs(np.diff(low, prepend=np.inf)) > step)
    if len(starts) < 3:
        return np.zeros(len(low), dtype=np.bool_)
    rises = low[starts[1:]] > low[starts[1:] - 1]
    hangs = np.zeros(len(starts), dtype=np.bool_)
    hangs[1:-1] = rises[:-1] & ~rises[1:]
    return np.repeat(hangs, np.diff(np.append(starts, len(low))))


def stretches(spaces: Spaces) -> Iterator[list[int]]:
    """Yield stretches of spaces that open into one another: indices, in order along the cut."""
    begin, end, floor, ceiling = spaces
    open_runs: list[list[int]] = []
    for space in range(len(begin)):
        for run in [run for run in open_runs if end[run[-1]] < begin[space]]:
            open_runs.remove(run)
            yield run
        for run in open_runs:
            last = run[-1]
            overlap = min(ceiling[last], ceiling[space]) - max(floor[last], floor[space])
            if end[last] == begin[space] and overlap > 0:
                run.append(space)
                break
        else:
            open_runs.append([space])
    yield from open_runs


def narrowest(spaces: Spaces, run: list[int]) -> Clearance:
    """Return the narrowest place of a stretch; of several, the one next to its middle.

    From one space to the next it is clear between the higher floor and the lower ceiling.
    """
    begin, end, low, high = (part[run] for part in spaces)
    along = np.concatenate(((begin + end) / 2, end[:-1]))
    floor = np.concatenate((low, np.maximum(low[1:], low[:-1])))
    ceiling = np.concatenate((high, np.minimum(high[1:], high[:-1])))
    middle = (begin[0] + end[-1]) / 2
    is_joint = np.arange(len(along)) >= len(run)
    place = np.lexsort((np.abs(along - middle), is_joint, ceiling - floor))[0]
    return Clearance(float(along[place]), float(floor[place]), float(ceiling[place]))
