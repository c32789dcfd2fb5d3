"""A map too large for memory: its columns lie on disk, part by part."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from mlscli.maps.columns import COLUMNS
from mlscli.maps.free_space import FreeSpace
from mlscli.maps.grid import Grid
from mlscli.maps.surface_map import SurfaceMap
from mlscli.runtime.arrays import Array, Float64
from mlscli.runtime.scratch import Scratch, Stored


class StoredPatches(NamedTuple):
    """Successive patches of a map, stored column by column.

    Attributes
    ----------
    size : int
        Number of patches.
    columns : mapping of str to Stored
        The columns by name, as in `SurfaceMap`.
    """

    size: int
    columns: Mapping[str, Stored]


@dataclass(frozen=True, eq=False)
class StoredMap:
    """A map that is read part by part, each of whole cells, in the file's order.

    Attributes
    ----------
    grid : Grid
    parts : list of StoredPatches
        In the file's order.
    route : float64 (K, 4)
        As in `SurfaceMap`.
    meta : dict
    free : FreeSpace or None
        As in `SurfaceMap`; in memory.
    """

    grid: Grid
    parts: list[StoredPatches]
    route: Float64 = field(default_factory=lambda: np.empty((0, 4)))
    meta: dict[str, Any] = field(default_factory=dict)
    free: FreeSpace | None = None

    @property
    def size(self) -> int:
        """How many patches there are."""
        return sum(part.size for part in self.parts)

    def put(self, surface: SurfaceMap, scratch: Scratch) -> None:
        """Store the patches that come next in the file's order, of whole cells."""
        columns = {name: scratch.put(column) for name, column in surface.columns.items()}
        self.parts.append(StoredPatches(surface.size, columns))

    def column(self, name: str) -> Iterator[Array]:
        """Yield a column, part by part."""
        for part in self.parts:
            yield part.columns[name][0 : part.size]

    def surfaces(self) -> Iterator[SurfaceMap]:
        """Yield the map in parts of whole cells."""
        for part in self.parts:
            columns = {name: part.columns[name][0 : part.size] for name in COLUMNS}
            yield SurfaceMap.of(self.grid, columns, self.route, self.meta)


# --- what a map in memory and one on disk have in common ---


def column_of(surface: SurfaceMap | StoredMap, name: str) -> Iterator[Array]:
    """Yield a column, part by part."""
    if isinstance(surface, StoredMap):
        yield from surface.column(name)
    else:
        yield surface.columns[name]


def parts_of(surface: SurfaceMap | StoredMap) -> Iterator[SurfaceMap]:
    """Yield the map in parts of whole cells."""
    if isinstance(surface, StoredMap):
        yield from surface.surfaces()
    else:
        yield surface
