"""`gap_size: auto`: which heights of a cell are one surface, by the walls that were sampled.

Where walls were sampled, heights as far apart as the vehicle is high are one surface, or sparse
walls would fall to pieces. In airborne scans, where hardly any surface stands upright, there is
nothing to hold together, and only what the noise spreads is one surface.

Some points are asked, with all that lies near them; neither the order of the points nor how they
are stored decides which.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

import numpy as np

from mlscli.errors import ConfigError
from mlscli.geometry.roughness import ASKED, Roughness, roughness_around
from mlscli.geometry.spacing import Neighbourhoods, distinct, turned
from mlscli.geometry.surroundings import hashed
from mlscli.maps.cells import GREATEST_INDEX, LEAST_INDEX, on_grid, pack
from mlscli.parameters.lengths import FARTHEST, Cells, exceeds, in_units
from mlscli.pipeline.parameters import Parameters
from mlscli.pipeline.stages.ordering import cells_of
from mlscli.runtime.arrays import Bool, Float64, UInt64

REACH = 2
"""How many cells far the surroundings of a point extend."""

# Where fewer of the surfaces stand upright, no walls were sampled: with noise it is up to 2 % in
# scenes without any, and hardly anywhere less than 4 % in others. Nothing is concluded from fewer
# surfaces, or where noise leaves fewer surroundings flat.
_FEW_UPRIGHT = 0.03
_FEWEST_SURFACES = 50
_LEAST_FLAT = 0.2
# Without walls, heights this far apart are always one surface, as those on a slope are.
_LEAST_GAP = Cells(0.5)
# What is this many standard deviations apart is hardly ever the same surface.
_DEVIATIONS = 3
# Within limited memory, the surroundings of so many points are looked at together.
_TOGETHER = 64


def with_gap_size(
    parameters: Parameters, cell_size: float, rough: Roughness
) -> tuple[Parameters, str]:
    """Return the parameters with this size of cells and the gap that suits, checked, and why.

    Parameters
    ----------
    parameters : Parameters
        With ``auto`` for `gap_size`.
    cell_size : float
        In the unit of the recording.
    rough : Roughness
        Of the surfaces.

    Raises
    ------
    ConfigError
        Where the parameters contradict each other, whatever the gap size.
    """
    tall = parameters.with_cell_size(cell_size)
    height = "auto: the height of the vehicle"
    if rough.asked * rough.flat < _FEWEST_SURFACES or rough.flat < _LEAST_FLAT:
        return tall, f"{height}, as too few points lie on surfaces to tell walls"
    share = f"{rough.upright:.1%} of the surfaces stand upright"
    if rough.upright >= _FEW_UPRIGHT:
        return tall, f"{height}, as {share}"
    least, spread = in_units(_LEAST_GAP, cell_size), two_digits(_DEVIATIONS * rough.noise)
    gap_size = max(least, spread)
    if not exceeds(parameters.vehicle.height, gap_size, cell_size):
        return tall, f"{height}, though only {share}"
    try:
        settled = parameters.with_cell_size(cell_size, gap_size)
    except ConfigError as error:
        at_fault = error.faults[0].partition(":")[0]
        return tall, f"{height}, which {at_fault} needs, though only {share}"
    words = "three times the noise" if spread > least else "half a cell"
    return settled, f"auto: {words}, as only {share}"


def two_digits(number: float) -> float:
    """Return a number rounded to two significant digits."""
    return float(f"{number:.1e}")


class AskedPoints:
    """The points of a recording whose surroundings are looked at, found as they come.

    They are those that `Neighbourhoods.some` chooses of all distinct points.

    Parameters
    ----------
    cell_size : float
        Side of a cell, in the unit of the recording; points that lie in none do not count.
    """

    def __init__(self, cell_size: float) -> None:
        self._cell_size = cell_size
        self._points: list[Float64] = []
        self._size = 0
        self._below = np.uint64(2**64 - 1)

    def add(self, points: Float64) -> None:
        """Take points, float64 (N, 3)."""
        points = points[hashed(turned(points)) <= self._below]
        self._points.append(points[is_mapped(points, self._cell_size)])
        self._size += len(self._points[-1])
        if self._size > 8 * ASKED:
            self._settle()

    @property
    def points(self) -> Float64:
        """The points, float64 (M, 3), each once, neighbours mostly together."""
        self._settle()
        points = self._points[0]
        return points[np.argsort(pack(*cells_of(points, self._cell_size)), kind="stable")]

    def _settle(self) -> None:
        """Keep the points of the lowest hashes, and those that share the last of these."""
        points = distinct(np.concatenate([np.empty((0, 3)), *self._points]))
        keys = hashed(turned(points))
        if len(points) > ASKED:
            self._below = np.partition(keys, ASKED - 1)[ASKED - 1]
        self._points = [points[keys <= self._below]]
        self._size = len(self._points[0])


def roughness_of(clouds: Iterable[Float64], cell_size: float) -> Roughness:
    """Return the roughness of the points of clouds, float64 (N, 3) each, held in memory."""
    clouds = list(clouds)
    asked = AskedPoints(cell_size)
    for points in clouds:
        asked.add(points)
    return _roughness(asked.points, cell_size, len(asked.points), lambda _: clouds)


def roughness_within(
    asked: AskedPoints, cell_size: float, stored: Callable[[UInt64], Iterable[Float64]]
) -> Roughness:
    """Return the roughness of points that do not fit into memory.

    Parameters
    ----------
    asked : AskedPoints
        Of all points.
    cell_size : float
    stored : callable
        Returns points, float64 (N, 3), among them all that lie in the cells with given packed keys,
        uint64 (C,), ascending.
    """
    return _roughness(asked.points, cell_size, _TOGETHER, stored)


def _roughness(
    asked: Float64,
    cell_size: float,
    together: int,
    stored: Callable[[UInt64], Iterable[Float64]],
) -> Roughness:
    def parts() -> Iterator[tuple[Float64, Neighbourhoods]]:
        for begin in range(0, len(asked), max(together, 1)):
            some = asked[begin : begin + together]
            cells = _cells_around(some, cell_size)
            near = [_within(points, cells, cell_size) for points in stored(cells)]
            yield some, Neighbourhoods(np.concatenate(near))

    return roughness_around(parts(), REACH * cell_size)


def is_mapped(points: Float64, cell_size: float) -> Bool:
    """Return which points a map with such cells can hold, bool (N,)."""
    inside: Bool = np.abs(points[:, 2]) <= FARTHEST
    return inside & on_grid(points, cell_size)


def _cells_around(points: Float64, cell_size: float) -> UInt64:
    """Return the packed keys of all cells near points, uint64 (C,), ascending."""
    # A point at the edge of a cell may lie one cell farther away.
    aside = np.arange(-REACH - 1, REACH + 2)
    ix, iy = (index.astype(np.int64) for index in cells_of(points, cell_size))
    x = np.clip(ix[:, None, None] + aside[:, None], LEAST_INDEX, GREATEST_INDEX)
    y = np.clip(iy[:, None, None] + aside, LEAST_INDEX, GREATEST_INDEX)
    x, y = np.broadcast_arrays(x, y)
    return np.unique(pack(x.ravel(), y.ravel()))


def _within(points: Float64, cells: UInt64, cell_size: float) -> Float64:
    """Return the points that lie in cells with given packed keys, which ascend."""
    points = points[is_mapped(points, cell_size)]
    keys = pack(*cells_of(points, cell_size))
    place = np.minimum(np.searchsorted(cells, keys), len(cells) - 1)
    inside: Bool = cells[place] == keys
    return points[inside]
