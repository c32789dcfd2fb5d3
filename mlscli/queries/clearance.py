"""Whether a craft that flies along a polyline fits through a map, and how narrow it gets."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from mlscli.errors import UsageError, expect
from mlscli.maps.patches import runs
from mlscli.maps.surface_map import SurfaceMap
from mlscli.queries.flown import with_flown
from mlscli.queries.looked import look
from mlscli.queries.obstacles import CORE, GUESSED, OUTER, Craft, Held, Met, Obstacles, meet
from mlscli.queries.pieces import Pieces, pieces_of
from mlscli.queries.voxels import Voxels
from mlscli.runtime.arrays import Float32, Float64, Int64, UInt8
from mlscli.runtime.threads import in_ranges

FITS, NEVER_SEEN, DOUBTFUL, BLOCKED = 0, 1, 2, 3
VERDICTS = ("fits", "never seen", "doubtful", "does not fit")

# A craft may be so many cells wide and high.
MOST_CELLS = 1000
# Obstacles are looked for so far beside it: its width, and at least so many cells.
LEAST_REACH = 4.0


class Stretch(NamedTuple):
    """A part of a polyline with one verdict.

    Attributes
    ----------
    verdict : int
        `FITS`, `NEVER_SEEN`, `DOUBTFUL` or `BLOCKED`.
    first, last : int
        Its pieces, the last included.
    begin, end : float
        How far along the polyline it begins and ends, in the unit of the map.
    """

    verdict: int
    first: int
    last: int
    begin: float
    end: float


@dataclass(frozen=True, eq=False)
class Clearance:
    """How a craft gets along a polyline, piece by piece; no piece is longer than a cell.

    Attributes
    ----------
    width, height : float
        Of the craft, in the unit of the map.
    pieces : Pieces
        Their ends, and how far along the polyline these are.
    verdict : uint8 (N,)
        Of each piece: `FITS`, `NEVER_SEEN`, `DOUBTFUL` (nearer to an obstacle than the map can
        tell) or `BLOCKED` (does not fit); the last of these that holds.
    distance : float64 (N,)
        How far the craft stays from what the map knows of, on the safe side: obstacles are as large
        as they may be. Below 0 it meets one, and would have to move so far to the side, or up or
        down. Infinite where there is none within `reach`. In the unit of the map.
    nearest : int64 (N,)
        The patch that is so near, -1: none.
    seen : float32 (N,)
        Through which share of the voxels of its space lines passed; NaN: the map does not say.
    reach : float
        How far beside the craft obstacles were looked for, in the unit of the map.
    """

    width: float
    height: float
    pieces: Pieces
    verdict: UInt8
    distance: Float64
    nearest: Int64
    seen: Float32
    reach: float

    @property
    def overall(self) -> int:
        """The verdict on the whole polyline: the last in order that holds for a piece."""
        return int(self.verdict.max())

    @property
    def narrowest(self) -> int:
        """The piece on which the craft comes nearest to an obstacle.

        Of several, as under a level deck, the middle one of the first that follow one another.
        """
        nearest = np.flatnonzero(self.distance == self.distance.min())
        ends = np.flatnonzero(np.diff(nearest) > 1)
        return int(nearest[(ends[0] if len(ends) else len(nearest) - 1) // 2])

    @cached_property
    def stretches(self) -> list[Stretch]:
        """The polyline as parts with one verdict each, in order."""
        bounds = runs(self.verdict)
        along = self.pieces.along
        return [
            Stretch(int(self.verdict[a]), a, b - 1, float(along[a]), float(along[b]))
            for a, b in zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True)
        ]


def expect_craft(surface: SurfaceMap, width: float, height: float, least: int) -> None:
    """Refuse what is no map, no craft for it, or no number of lines.

    Parameters
    ----------
    surface : SurfaceMap
    width, height : float
    least : int
        As for `clearance`.

    Raises
    ------
    TypeError, UsageError
    """
    expect(surface, SurfaceMap, "surface", "a map (SurfaceMap)")
    side = surface.cell_size
    for name, value in (("width", width), ("height", height)):
        expect(value, (int, float, np.number), name, "a number")
        if not 0 < value <= MOST_CELLS * side:
            raise UsageError(
                f"{name}: is {value:g}, expected a length above 0, at most {MOST_CELLS:,} cells "
                f"({MOST_CELLS * side:g})"
            )
    expect(least, (int, np.integer), "least", "a whole number")
    if not 1 <= least <= 255:
        raise UsageError(f"least: is {least}, expected 1 to 255")


def clearance(
    surface: SurfaceMap, polyline: Float64, width: float, height: float, least: int = 2
) -> Clearance:
    """Return how a craft fits along a polyline.

    The craft is an upright cylinder around its place: however it turns, it stays within one as wide
    as its longest diagonal. Nothing is sampled: each piece is held against every cell that the
    cylinder reaches into on it. Where the craft was when the map was recorded is free, see
    `mlscli.queries.flown`. See `mlscli.queries.obstacles` for what it may meet, and
    `mlscli.queries.looked` for what was never seen.

    Parameters
    ----------
    surface : SurfaceMap
        Without free space, whatever is not blocked was never seen.
    polyline : float64 (K, 3)
        Where the middle of the craft flies, in the frame and the unit of the map; one place: where
        it hovers.
    width, height : float
        The craft's diameter, and its height; in the unit of the map.
    least : int
        So many sight lines show that a voxel is free, see `space_at`.

    Returns
    -------
    Clearance

    Raises
    ------
    TypeError, UsageError
        Where an argument is none of these, or out of range.

    Examples
    --------
    >>> import numpy as np
    >>> import mlscli
    >>> bridge = mlscli.SurfaceMap.of(mlscli.Grid(0.5, 1.0, 0.1))
    >>> found = mlscli.clearance(bridge, np.array([[0.0, 0, 1], [4, 0, 1]]), 0.6, 0.3)
    >>> found.overall == mlscli.queries.clearance.NEVER_SEEN
    True
    """
    expect_craft(surface, width, height, least)
    return along(with_flown(surface), polyline, width, height, least)


def along(
    surface: SurfaceMap, polyline: Float64, width: float, height: float, least: int
) -> Clearance:
    """Return what `clearance` does, of a map that holds where the craft was, see `with_flown`.

    Parameters
    ----------
    surface : SurfaceMap
    polyline : float64 (K, 3)
    width, height : float
    least : int
        As for `clearance`, and right.
    """
    side = surface.cell_size
    pieces = pieces_of(polyline, side)
    place = pieces.place
    craft = Craft(width / 2, height / 2, 1e-9 * side)
    reach = max(float(width), LEAST_REACH * side)
    beside = craft.radius + reach + side
    ends = (
        math.floor((place[:, 0].min() - beside) / side),
        math.floor((place[:, 0].max() + beside) / side),
    )
    obstacles, space = Obstacles.of(surface, *ends), Voxels.of(surface.free, *ends)
    held = Held(craft, side, obstacles, space, least)
    count = len(place) - 1
    met, distance = np.zeros(count, dtype=np.uint8), np.empty(count)
    nearest, seen = np.empty(count, dtype=np.int64), np.full(count, np.nan, dtype=np.float32)
    blank = np.ones(count, dtype=np.bool_)

    def work(begin: int, end: int) -> None:
        meet(begin, end, place, held, reach, Met(met, distance, nearest))
        if surface.free is not None:
            look(begin, end, place, held, seen, blank)

    in_ranges(count, work, weight=16.0)
    verdict = np.where(blank | (met == GUESSED), NEVER_SEEN, FITS).astype(np.uint8)
    verdict[met == OUTER] = DOUBTFUL
    verdict[met == CORE] = BLOCKED
    for array in (verdict, distance, nearest, seen):
        array.setflags(write=False)
    return Clearance(float(width), float(height), pieces, verdict, distance, nearest, seen, reach)
