"""What must bear out the closing of a gap: walls that run along it, surfaces that end at it.

Two ends that find each other are weak evidence: so do walls that face each other, and the eaves on
both sides of a lane. These rules ask for more. They are new, and read only what a pass reads.

A **wall** is closed along a line only where it runs along that line at both ends. From each end,
cells are counted behind it and to both sides of it, as far as they follow one another and hold a
vertical patch that overlaps or touches the end, up to a number in each direction. Where twice the
cells behind are fewer than those to both sides, the wall runs across the gap. If the gap is wide,
there must be as many cells behind each end as the gap has, or that number.

A **surface** is closed over a wide gap only where both ends are level with each other and each is
the edge of a level surface: of the five cells behind and beside it (straight behind, to both sides,
and the corners between these), enough hold a patch that is level with it. And nothing may lie more
than `gap_size` below what would close the gap: what was seen there was seen through it. A narrow
gap is closed on slopes, too, and where nothing else was seen in it, whatever its ends are. Where
something was, maybe at another height, its ends must be edges as well: single outliers above a
surface find each other.

A **hole** in a column of a wall, if it is a high one, is filled only where enough of the eight
cells around hold a vertical patch that covers more than half of its height.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mlscli.maps.neighbours import is_at, sought
from mlscli.maps.order import OccupiedCells
from mlscli.maps.patches import distance
from mlscli.pipeline.stages.gaps import Intervals, Lines, between
from mlscli.runtime.arrays import Bool, Float64, Int32, Int64
from mlscli.runtime.kernels import inner, kernel


class Support(NamedTuple):
    """What the end of a gap needs to be the edge of a surface.

    Attributes
    ----------
    level : float
        Heights that differ by no more belong together.
    needed : int
        Of the five cells behind and beside an end, so many must hold a patch that belongs to it.
    """

    level: float
    needed: int


@kernel
def run_along(
    pairs: Int64,
    lines: Lines,
    across: Lines,
    certain: int,
    start: Int64,
    low: Float64,
    high: Float64,
    farthest: int,
) -> Bool:
    """Return at which gaps a wall runs along the lines at both ends, bool (G,).

    Parameters
    ----------
    pairs, lines, across, certain
        As in `Gaps`.
    start : int64 (C + 1,)
        Where the intervals of each cell begin: those of vertical patches.
    low, high : float64 (P,)
        Lower and upper ends of the intervals.
    farthest : int
        So many cells are counted at most in each direction.
    """
    holds = np.empty(len(pairs), dtype=np.bool_)
    walls = start, low, high
    for n in range(len(pairs)):
        cell, near, there, far = pairs[n]
        width = lines.position[there] - lines.position[cell] - 1
        needed = min(width, farthest) if width > certain else 0
        holds[n] = _runs_on(
            cell, near, lines.before, lines, across, walls, farthest, needed
        ) and _runs_on(there, far, lines.after, lines, across, walls, farthest, needed)
    return holds


@inner
def _runs_on(
    cell: int,
    i: int,
    following: Int32,
    lines: Lines,
    across: Lines,
    walls: tuple[Int64, Float64, Float64],
    farthest: int,
    needed: int,
) -> bool:
    """Return whether a wall runs on behind one end of a gap, not across.

    Parameters
    ----------
    cell, i : int
        Cell and interval of the end.
    following : int32 (C,)
        The cell that follows each one on its line, away from the gap; -1: none.
    lines, across, farthest
        As in `run_along`.
    walls : tuple
        Its `start`, `low` and `high`.
    needed : int
        There must be so many cells behind.
    """
    behind = _row(cell, i, following, lines.position, walls, farthest)
    beside = _row(cell, i, across.before, across.position, walls, farthest)
    beside += _row(cell, i, across.after, across.position, walls, farthest)
    return (behind >= needed) & (2 * behind >= beside)


@inner
def _row(
    cell: int,
    i: int,
    following: Int32,
    position: Int32,
    walls: tuple[Int64, Float64, Float64],
    farthest: int,
) -> int:
    """Return how many cells that follow a cell in a row hold an interval that meets one of its own.

    Parameters
    ----------
    cell, i : int
        The cell, and its interval.
    following : int32 (C,)
        The cell that follows each one on its line, in the direction of the row; -1: none.
    position : int32 (C,)
        Position of each cell along its line.
    walls, farthest
        As in `_runs_on`.
    """
    start, low, high = walls
    count, there = 0, following[cell]
    while count < farthest and there >= 0 and abs(position[there] - position[cell]) == count + 1:
        meets = False
        for j in range(start[there], start[there + 1]):
            meets |= distance(low[i], high[i], low[j], high[j]) == 0
        if not meets:
            break
        count += 1
        there = following[there]
    return count


@kernel
def are_surfaces(
    pairs: Int64,
    lines: Lines,
    across: Lines,
    certain: int,
    cells: OccupiedCells,
    height: Float64,
    narrow: Support,
    wide: Support,
    deepest: float,
) -> Bool:
    """Return which gaps are empty and narrow, or in a surface, a level one if wide; bool (G,).

    Parameters
    ----------
    pairs, lines, across, certain
        As in `Gaps`.
    cells : OccupiedCells
        The occupied cells, and where their patches begin.
    height : float64 (P,)
        The heights of all patches.
    narrow, wide : Support
        What the ends of gaps need, those that are surely closed and wider ones.
    deepest : float
        A patch farther than this below what would close a wide gap keeps it open.
    """
    holds = np.empty(len(pairs), dtype=np.bool_)
    for n in range(len(pairs)):
        cell, near, there, far = pairs[n]
        is_wide = lines.position[there] - lines.position[cell] - 1 > certain
        if not is_wide and lines.after[cell] == there:
            holds[n] = True
            continue
        support = wide if is_wide else narrow
        level, needed = support.level, support.needed
        # Away from the gap, at its near end.
        dx = int(np.sign(cells.ix[cell] - cells.ix[there]))
        dy = int(np.sign(cells.iy[cell] - cells.iy[there]))
        behind, beyond = lines.before[cell], lines.after[there]
        holds[n] = (
            (not is_wide or abs(height[far] - height[near]) <= level)
            and _is_edge(cell, near, behind, dx, dy, across, cells, height, level, needed)
            and _is_edge(there, far, beyond, -dx, -dy, across, cells, height, level, needed)
            and not (
                is_wide and _is_above(cell, near, there, far, lines, cells.start, height, deepest)
            )
        )
    return holds


@inner
def _is_edge(
    cell: int,
    i: int,
    behind: int,
    dx: int,
    dy: int,
    across: Lines,
    cells: OccupiedCells,
    height: Float64,
    level: float,
    needed: int,
) -> bool:
    """Return whether one end of a gap is the edge of a level surface.

    Parameters
    ----------
    cell, i : int
        Cell and patch of the end.
    behind : int
        The next occupied cell of its line, away from the gap; -1: none.
    dx, dy : int
        The step in x and y to the cell straight behind.
    across, cells, height
        As in `are_surfaces`.
    level, needed
        As in `Support`.
    """
    x, y = int(cells.ix[cell]), int(cells.iy[cell])
    aside, ahead = abs(dy), abs(dx)
    z, before, after = height[i], across.before[cell], across.after[cell]
    count = _is_level(behind, x + dx, y + dy, cells, height, z, level)
    count += _is_level(before, x - aside, y - ahead, cells, height, z, level)
    count += _is_level(after, x + aside, y + ahead, cells, height, z, level)
    # The corners share no line with the cell, and are searched for where they are needed.
    for side in (-1, 1):
        if count < needed:
            there_x, there_y = x + dx + side * aside, y + dy + side * ahead
            there = sought(cells.ix, cells.iy, -1, there_x, there_y)
            count += _is_level(there, there_x, there_y, cells, height, z, level)
    return count >= needed


@inner
def _is_level(
    cell: int, x: int, y: int, cells: OccupiedCells, height: Float64, z: float, level: float
) -> int:
    """Return 1 if the cell with a number is the one at (x, y) and has a patch level with z, or 0.

    Parameters
    ----------
    cell : int
        The number, which need not exist.
    x, y : int
        Cell indices.
    cells, height
        As in `are_surfaces`.
    z : float
        A height.
    level : float
        As in `Support`.
    """
    found = 0
    if is_at(cells.ix, cells.iy, cell, x, y):
        for j in range(cells.start[cell], cells.start[cell + 1]):
            if abs(height[j] - z) <= level:
                found = 1
    return found


@inner
def _is_above(
    cell: int,
    near: int,
    there: int,
    far: int,
    lines: Lines,
    start: Int64,
    height: Float64,
    deepest: float,
) -> bool:
    """Return whether what would close a gap lies more than `deepest` above a patch of its cell.

    Parameters
    ----------
    cell, near, there, far : int
        As in the rows of `Gaps.pairs`.
    lines, height, deepest
        As in `are_surfaces`.
    start : int64 (C + 1,)
        Where the patches of each cell begin.
    """
    d = lines.position[there] - lines.position[cell]
    between_them = lines.after[cell]
    while between_them != there:
        k = lines.position[between_them] - lines.position[cell]
        z = between(height[near], height[far], k, d)
        for j in range(start[between_them], start[between_them + 1]):
            if z - height[j] > deepest:
                return True
        between_them = lines.after[between_them]
    return False


@inner
def lies_in_wall(x: int, y: int, low: float, high: float, walls: Intervals, needed: int) -> bool:
    """Return whether a hole has enough wall around it.

    Parameters
    ----------
    x, y : int
        Its cell.
    low, high : float
        Its lower and upper end.
    walls : Intervals
        The vertical patches.
    needed : int
        Of the eight cells around, so many must hold a patch that covers more than half of it.
    """
    count, (ix, iy, start) = 0, walls.cells
    for column in range(x - 1, x + 2):
        there = sought(ix, iy, -1, column, y - 1)
        while there < len(ix) and ix[there] == column and iy[there] <= y + 1:
            covered = 0.0
            for j in range(start[there], start[there + 1]):
                covered = max(covered, min(high, walls.high[j]) - max(low, walls.low[j]))
            # The hole's own cell has no wall in the hole.
            count += 2 * covered > high - low
            there += 1
    return count >= needed
