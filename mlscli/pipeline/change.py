"""What a batch changes in a growing map: patches that go, patches that come, the route grown."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mlscli.cells import CellSet, pack
from mlscli.kernels import kernel
from mlscli.pipeline.tiles import records_of
from mlscli.surface_map import SurfaceMap
from mlscli.typing import Bool, Float64, UInt8, UInt64

NO_ROUTE: Float64 = np.empty((0, 4))


class Change(NamedTuple):
    """The difference of two states of a map.

    A patch that differs in any column, if only in its count, goes and comes.

    Attributes
    ----------
    removed, added : SurfaceMap
        Patches of the state before, and of the state after; their keyframes number the rows of
        the whole map's route.
    route : float64 (K, 4)
        The rows that the route gains, as in `SurfaceMap`.
    """

    removed: SurfaceMap
    added: SurfaceMap
    route: Float64 = NO_ROUTE

    @property
    def cells(self) -> CellSet:
        """The cells in which something changed."""
        ix = np.concatenate((self.removed.ix, self.added.ix))
        return CellSet.of(ix, np.concatenate((self.removed.iy, self.added.iy)))

    @property
    def points(self) -> int:
        """How many more points the patches hold than before."""
        return points_in(self.added) - points_in(self.removed)

    def applied_to(self, surface: SurfaceMap) -> SurfaceMap:
        """Return the state after, given the state before."""
        return difference(surface, self.removed).removed.union(self.added)


def points_in(surface: SurfaceMap) -> int:
    """Return how many measured points the patches hold."""
    return int(surface.count.sum(dtype=np.int64))


def difference(before: SurfaceMap, after: SurfaceMap) -> Change:
    """Return how one map differs from another, patch by patch and bit for bit."""
    one, other = _cells_and_bytes(before), _cells_and_bytes(after)
    return Change(before.take(~_shared(*one, *other)), after.take(~_shared(*other, *one)))


def _cells_and_bytes(surface: SurfaceMap) -> tuple[UInt64, UInt8]:
    records = records_of(surface)
    rows = records.view(np.uint8).reshape(surface.size, records.itemsize)
    return pack(surface.ix, surface.iy), rows


@kernel
def _shared(keys: UInt64, rows: UInt8, other_keys: UInt64, other_rows: UInt8) -> Bool:
    """Tell which rows the others have, too; both ascend by key."""
    shared = np.zeros(len(keys), dtype=np.bool_)
    first = 0
    for i in range(len(keys)):
        while first < len(other_keys) and other_keys[first] < keys[i]:
            first += 1
        j = first
        while j < len(other_keys) and other_keys[j] == keys[i] and not shared[i]:
            shared[i] = True
            for byte in range(rows.shape[1]):
                if rows[i, byte] != other_rows[j, byte]:
                    shared[i] = False
                    break
            j += 1
    return shared
