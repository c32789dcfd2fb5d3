"""Places where a map closes what is open: under a deck, in a window, over a hole.

A phantom closing is an inserted patch that is not correct. The true patches of its cell decide
which place it is in. True patches of one cell are more than `gap_size` apart: the space between two
successive ones is open. A phantom closing that reaches into such a space, farther than a cell size
from both, is

- ``in_window`` where both are vertical: sill and lintel;
- ``under_deck`` otherwise: under a bridge, a roof or a crown, in a gate.

Of the others, it is ``in_hole``, a hole in the ground, where its cell holds no true patch, but lies
between cells that do, along x and along y; ``off_level`` where it is within a cell size of a true
patch in height: it closes a surface at a wrong height; ``elsewhere`` otherwise: above or below all
true patches, or off the edge of the scene.
"""

from __future__ import annotations

import numpy as np

from mlscli.maps.patches import distance, runs
from mlscli.maps.surface_map import ARTIFICIAL, ORIGINS, PLASTERED
from mlscli.runtime.arrays import Bool, Float64, Int32, Int64, UInt8
from mlscli.runtime.kernels import kernel
from mlscli.scoring.kernels import Patches, nearby

PLACES = ("under_deck", "in_window", "in_hole", "off_level", "elsewhere")
_UNDER_DECK, _IN_WINDOW, _IN_HOLE, _OFF_LEVEL, _ELSEWHERE = range(len(PLACES))


def count_by_place(
    phantoms: Patches, origin: UInt8, true: Patches, cell_size: float
) -> dict[str, dict[str, int]]:
    """Count phantom closings by place, and in each by origin.

    Parameters
    ----------
    phantoms : Patches
        F inserted patches that are not correct.
    origin : uint8 (F,)
        Their origins, `PLASTERED` or `ARTIFICIAL`.
    true : Patches
        The true patches.
    cell_size : float

    Returns
    -------
    dict of str to dict
        By each of `PLACES`, how many are ``plastered`` and how many ``artificial``.
    """
    near = nearby(phantoms.ix, phantoms.iy, true.ix, true.iy, 0)
    place = _places(
        phantoms.low, phantoms.high, near, true.low, true.high, true.vertical, cell_size
    )
    inside = _between(phantoms.ix, phantoms.iy, true.ix, true.iy)
    inside &= _between(phantoms.iy, phantoms.ix, true.iy, true.ix)
    place[inside & (near[:, 0, 0] == near[:, 0, 1])] = _IN_HOLE
    return {
        name: {
            ORIGINS[which]: int(np.count_nonzero((place == number) & (origin == which)))
            for which in (PLASTERED, ARTIFICIAL)
        }
        for number, name in enumerate(PLACES)
    }


def _between(line: Int32, position: Int32, true_line: Int32, true_position: Int32) -> Bool:
    """Return which cells lie between the first and the last true cell of their line, bool (F,).

    Parameters
    ----------
    line, position : int32 (F,)
        The cells: their ix and iy for lines along y, their iy and ix for lines along x.
    true_line, true_position : int32 (T,)
        The cells that hold true patches, likewise.
    """
    if not len(true_line):
        return np.zeros(len(line), dtype=np.bool_)
    order = np.lexsort((true_position, true_line))
    true_line, true_position = true_line[order], true_position[order]
    start = runs(true_line)
    lines = true_line[start[:-1]]
    first, last = true_position[start[:-1]], true_position[start[1:] - 1]
    there = np.minimum(np.searchsorted(lines, line), len(lines) - 1)
    inside: Bool = (lines[there] == line) & (first[there] < position) & (position < last[there])
    return inside


@kernel
def _places(
    low: Float64,
    high: Float64,
    near: Int64,
    true_low: Float64,
    true_high: Float64,
    true_vertical: Bool,
    margin: float,
) -> Int64:
    """Return the number of the place of each patch, int64 (F,), without ``in_hole``.

    A patch that reaches into several spaces is in the place of the lowest.

    Parameters
    ----------
    low, high : float64 (F,)
        Ends of the patches.
    near : int64 (F, 1, 2)
        The range of true patches in the cell of each, as `nearby` returns it.
    true_low, true_high : float64 (T,)
        Ends of the true patches.
    true_vertical : bool (T,)
        Which true patches are vertical.
    margin : float
        The cell size.
    """
    place = np.full(len(low), _ELSEWHERE, dtype=np.int64)
    for i in range(len(low)):
        begin, end = near[i, 0]
        for j in range(begin, end):
            if distance(low[i], high[i], true_low[j], true_high[j]) <= margin:
                place[i] = _OFF_LEVEL
        for above in range(begin + 1, end):
            floor, ceiling = true_high[above - 1] + margin, true_low[above] - margin
            if floor < ceiling and low[i] < ceiling and high[i] > floor:
                walled = true_vertical[above - 1] and true_vertical[above]
                place[i] = _IN_WINDOW if walled else _UNDER_DECK
                break
    return place
