"""What a batch changes in a growing map: patches removed and added, and rows of the route."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from mlscli.maps.cells import CellSet
from mlscli.maps.grid import Grid
from mlscli.maps.records import columns_of, points_of, records_in, records_of, rows_in, surface_of
from mlscli.maps.rows import missing
from mlscli.maps.surface_map import SurfaceMap
from mlscli.runtime.arrays import Array, Float64, UInt64


@dataclass(frozen=True, eq=False)
class Change:
    """The difference of two states of a map.

    A patch that differs in any column, even if only in its count, is both removed and added. The
    maps `removed` and `added` are made when they are first read.

    Attributes
    ----------
    gone, come : uint64 (N, words)
        The patches removed and those added, as rows of `mlscli.maps.records`, ascending by cell.
    grid : Grid
        The grid of both states.
    route : float64 (K, 4)
        The rows that the route gains, as in `SurfaceMap`.
    """

    gone: UInt64
    come: UInt64
    grid: Grid
    route: Float64 = field(default_factory=lambda: np.empty((0, 4)))

    @classmethod
    def of(cls, removed: SurfaceMap, added: SurfaceMap, route: Float64) -> Change:
        """Return the change that removes some patches and adds others."""
        return cls(rows_in(records_of(removed)), rows_in(records_of(added)), removed.grid, route)

    @classmethod
    def between(cls, before: Array, after: Array, grid: Grid) -> Change:
        """Return the difference of two states, given as records in the file's order."""
        one, other = rows_in(before), rows_in(after)
        return cls(missing(one, other), missing(other, one), grid)

    @cached_property
    def removed(self) -> SurfaceMap:
        """The patches removed; their keyframes are rows of the whole map's route."""
        return surface_of(records_in(self.gone), self.grid)

    @cached_property
    def added(self) -> SurfaceMap:
        """The patches added; their keyframes are rows of the whole map's route."""
        return surface_of(records_in(self.come), self.grid)

    @property
    def cells(self) -> CellSet:
        """The cells in which something changed."""
        return CellSet.of_keys(np.concatenate((self.gone[:, 0], self.come[:, 0])))

    @cached_property
    def points(self) -> int:
        """How many measured points the map gains; negative where it loses some."""
        return points_of(self.come) - points_of(self.gone)

    def applied_to(self, surface: SurfaceMap) -> SurfaceMap:
        """Return the state after, given the state before; the route is not extended."""
        stays = missing(rows_in(records_of(surface)), self.gone)
        return replace(surface, **columns_of(records_in(stays))).union(self.added)


def points_in(surface: SurfaceMap) -> int:
    """Return how many measured points the patches hold."""
    return int(surface.count.sum(dtype=np.int64))
