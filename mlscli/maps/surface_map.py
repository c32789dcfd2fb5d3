"""The multi-level surface map: columns of patches, sorted by cell and height.

The model is that of R. Triebel, P. Pfaff and W. Burgard, *Multi-Level Surface Maps for Outdoor
Terrain Mapping and Loop Closing*, IROS 2006 (doi:10.1109/IROS.2006.282632), with patches made by
single linkage, and horizontal or vertical by their spread.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from numbers import Real
from types import NoneType
from typing import Any

import numpy as np

from mlscli.errors import InputError, expect
from mlscli.maps.cells import GREATEST_INDEX, CellSet, Limits
from mlscli.maps.columns import COLUMNS, STATISTICS, UNMEASURED, bare, new_columns
from mlscli.maps.display import html
from mlscli.maps.free_space import FreeSpace
from mlscli.maps.grid import Grid
from mlscli.maps.order import Columns, Keys, OccupiedCells, ascend, come_before, interleave, pick
from mlscli.maps.patches import overlap, reach_beyond
from mlscli.maps.uncertainty import height_variances
from mlscli.parameters.lengths import FARTHEST, LARGEST_CELL, SMALLEST_CELL
from mlscli.runtime.arrays import Array, Bool, Float32, Float64, Int32, Int64, UInt8, UInt32
from mlscli.runtime.threads import LIGHT, in_ranges

MEASURED, PLASTERED, ARTIFICIAL = 0, 1, 2
ORIGINS = ("measured", "plastered", "artificial")

_ENDS = ("height", "depth", "top", "bottom")
_ARRAYS = (*COLUMNS, "route")


def _no_route() -> Float64:
    return np.empty((0, 4))


@dataclass(frozen=True, eq=False, repr=False)
class SurfaceMap:
    """A sparse grid of surface patches; its arrays are read-only.

    Patches are sorted by (ix, iy, height, depth, origin, count).

    Attributes
    ----------
    cell_size, gap_size, thickness : float
        Side of a cell; successive heights farther apart belong to different patches; a patch with
        a greater spread is vertical. In the unit of the recording.
    ix, iy : int32 (P,)
        Cell indices.
    height, depth : float64 (P,)
        Upper end of a patch and its extent below, in the unit of the recording; ``depth > 0``
        means vertical.
    top, bottom, mean, variance : float64 (P,)
        Of the measured heights; NaN where the patch was inserted.
    noise : float32 (P,)
        Mean variance of the errors of the points' heights, as far as the stages on points told it;
        NaN where they did not, or the patch was inserted. See `height_variance`.
    count : uint32 (P,)
        Measured points; 0 where inserted.
    origin : uint8 (P,)
        0 measured, 1 plastered, 2 artificial.
    moved : uint8 (P,)
        1 where a stage has moved a measured patch, or one of its ends, out of [bottom, top]: what
        lies beyond is closed, not measured. Otherwise 0, also where inserted.
    region : int32 (P,)
        Number of the region; -1 where there is none.
    first_keyframe, last_keyframe : int32 (P,)
        Rows of `route` that first and last measured the patch; -1 where inserted.
    frame_id : str
        Name of the map frame.
    route : float64 (K, 4)
        Time, x, y, z of the craft, a row for each keyframe; NaN where not known.
    meta : dict
        How the map was made: program version, sources, parameters, counts.
    free : FreeSpace or None
        Where sight lines passed; None where nobody asked for it.
    """

    cell_size: float
    gap_size: float
    thickness: float
    ix: Int32
    iy: Int32
    height: Float64
    depth: Float64
    top: Float64
    bottom: Float64
    mean: Float64
    variance: Float64
    noise: Float32
    count: UInt32
    origin: UInt8
    moved: UInt8
    region: Int32
    first_keyframe: Int32
    last_keyframe: Int32
    frame_id: str = "map"
    route: Float64 = field(default_factory=_no_route)
    meta: dict[str, Any] = field(default_factory=dict)
    free: FreeSpace | None = None

    def __post_init__(self) -> None:
        """Make the arrays read-only, for the caller, too."""
        held = self.__dict__
        for name in _ARRAYS:
            array = held[name]
            if not isinstance(array, np.ndarray):
                expect(array, np.ndarray, name, "an array")
            # By position: this runs for every map that a batch makes.
            array.setflags(False)

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore a copy: its arrays are read-only, too."""
        self.__dict__.update(state)
        self.__post_init__()

    @classmethod
    def of(
        cls,
        grid: Grid,
        columns: Mapping[str, Array] | None = None,
        route: Float64 | None = None,
        meta: dict[str, Any] | None = None,
    ) -> SurfaceMap:
        """Return a map on a grid; use `check` for columns that may be invalid.

        Parameters
        ----------
        grid : Grid
        columns : mapping of str to array, optional
            Those of `COLUMNS`, in the file's order; by default of no patches.
        route : float64 (K, 4), optional
        meta : dict, optional
            By default both are empty.
        """
        expect(grid, Grid, "grid", "a Grid")
        if columns is not None:
            expect(columns, Mapping, "columns", "the columns by name")
        if meta is not None:
            expect(meta, dict, "meta", "a dict")
        chosen: Any = new_columns(0) if columns is None else columns
        return cls(
            grid.cell_size,
            grid.gap_size,
            grid.thickness,
            **chosen,
            frame_id=grid.frame_id,
            route=_no_route() if route is None else route,
            meta={} if meta is None else meta,
        )

    @property
    def grid(self) -> Grid:
        """The grid that its patches lie on."""
        return Grid(self.cell_size, self.gap_size, self.thickness, self.frame_id)

    @property
    def size(self) -> int:
        """How many patches there are."""
        return len(self.ix)

    @property
    def columns(self) -> dict[str, Any]:
        """The columns by name, in the file's order."""
        return {name: getattr(self, name) for name in COLUMNS}

    @property
    def low_end(self) -> Float64:
        """Lower end of each patch, ``height - depth``; stages see [low end, height]."""
        return self.height - self.depth

    @property
    def height_variance(self) -> Float64:
        """Variance of the error of each height, in the square of the unit, float64 (P,).

        NaN where it is not known: of inserted patches, and where `noise` is NaN. The model stands
        in `mlscli.maps.uncertainty`.
        """
        statistics = self.top, self.bottom, self.mean, self.variance, self.noise, self.count
        variances: Float64 = height_variances(self.height, self.depth, *statistics)
        return variances

    @cached_property
    def cells(self) -> OccupiedCells:
        """The occupied cells and where their patches begin."""
        return OccupiedCells.of(self.ix, self.iy)

    @property
    def keys(self) -> Keys:
        """The columns by which patches are sorted."""
        return Keys(self.ix, self.iy, self.height, self.depth, self.origin, self.count)

    # --- parts of a map, and maps put together ---

    def with_columns(self, **columns: Any) -> SurfaceMap:
        """Return the map with some columns replaced, sorted anew.

        Where their ends are among these, it is noted which patches were moved beyond their points.
        """
        if columns.keys() & set(_ENDS) and "moved" not in columns:
            ends = (columns.get(name, getattr(self, name)) for name in _ENDS)
            columns["moved"] = reach_beyond(*ends).astype(np.uint8)
        return replace(self, **columns).sorted()

    def beyond_points(self) -> Bool:
        """Return which measured patches do not lie within [bottom, top], bool (P,)."""
        return reach_beyond(self.height, self.depth, self.top, self.bottom)

    def take(self, which: Bool | Int64) -> SurfaceMap:
        """Return the patches that a mask selects, or indices, in the order of the indices."""
        expect(which, np.ndarray, "which", "a mask or indices, as an array")
        if which.dtype == np.bool_ and which.all():
            return self
        chosen: Any = np.flatnonzero(which) if which.dtype == np.bool_ else which

        def choose(begin: int, end: int, columns: Columns, taken: Columns) -> None:
            pick(begin, end, columns, chosen, taken)

        return self._with_new_columns(len(chosen), choose, self)

    def sorted(self) -> SurfaceMap:
        """Return the same patches in the file's order."""
        if self._is_sorted():
            return self
        return self.take(np.lexsort(self.keys[::-1]))

    def union(self, other: SurfaceMap) -> SurfaceMap:
        """Return the patches of both, none merged, with the grid, route and meta of this map."""
        expect(other, SurfaceMap, "other", "a map (SurfaceMap)")
        mine, others = self.sorted(), other.sorted()
        if not others.size:
            return mine
        before = come_before(mine.keys, others.keys)

        def put_together(
            begin: int, end: int, columns: Columns, more: Columns, both: Columns
        ) -> None:
            interleave(begin, end, columns, more, before, both)

        return self._with_new_columns(mine.size + others.size, put_together, mine, others)

    def _with_new_columns(
        self, size: int, fill: Callable[..., None], *sources: SurfaceMap
    ) -> SurfaceMap:
        """Return a map of `size` patches, whose rows ``fill(begin, end, *columns)`` writes.

        Several threads call `fill`, with columns of one size: those of each source, and the new.
        """
        new = new_columns(size)
        by_size = list(zip(*(bare(each) for each in (*map(vars, sources), new)), strict=True))

        def fill_rows(begin: int, end: int) -> None:
            for columns in by_size:
                fill(begin, end, *columns)

        in_ranges(size, fill_rows, weight=LIGHT)
        return replace(self, **new)

    def with_inserted(
        self, ix: Int32, iy: Int32, height: Float64, depth: Float64, origin: UInt8
    ) -> SurfaceMap:
        """Return the map with inserted patches added.

        Parameters
        ----------
        ix, iy : int32 (N,)
        height, depth : float64 (N,)
        origin : uint8 (N,)
            Columns of the inserted patches; the others are set as for every inserted patch.
        """
        expect(ix, np.ndarray, "ix", "an array")
        if not len(ix):
            return self
        given = {"ix": ix, "iy": iy, "height": height, "depth": depth, "origin": origin}
        inserted = new_columns(len(ix))
        for name, column in inserted.items():
            column[:] = given[name] if name in given else UNMEASURED[name]
        return self.union(replace(self, **inserted))

    def crop(
        self,
        min_x: int | None = None,
        max_x: int | None = None,
        min_y: int | None = None,
        max_y: int | None = None,
    ) -> SurfaceMap:
        """Return the patches and the free space whose cell indices lie within limits, inclusive."""
        limits = Limits(min_x, max_x, min_y, max_y)
        for name, limit in limits._asdict().items():
            expect(limit, (Real, NoneType), name, "the index of a cell")
        free = self.free and self.free.crop(limits)
        return replace(self.take(limits.contain(self.ix, self.iy)), free=free)

    def in_cells(self, cells: CellSet) -> SurfaceMap:
        """Return the patches in the cells of a set."""
        expect(cells, CellSet, "cells", "a set of cells (CellSet)")
        return self.take(cells.contains(self.ix, self.iy))

    def replace(self, cells: CellSet, other: SurfaceMap) -> SurfaceMap:
        """Return the map with the patches in `cells` replaced by those that `other` has there.

        Raises
        ------
        UsageError
            Where cell size, gap size or thickness differ.
        """
        expect(other, SurfaceMap, "other", "a map (SurfaceMap)")
        expect(cells, CellSet, "cells", "a set of cells (CellSet)")
        self.grid.require_same(other.grid)
        outside = self.take(~cells.contains(self.ix, self.iy))
        return outside.union(other.in_cells(cells))

    # --- equality and invariants ---

    def __eq__(self, other: object) -> bool:
        """Return whether all but route and meta is the same, bit for bit."""
        if not isinstance(other, SurfaceMap):
            return NotImplemented
        return (
            (self.cell_size, self.gap_size, self.thickness, self.frame_id)
            == (other.cell_size, other.gap_size, other.thickness, other.frame_id)
            and self.size == other.size
            and self.free == other.free
            and all(
                mine.tobytes() == others.tobytes()
                for mine, others in zip(self.columns.values(), other.columns.values(), strict=True)
            )
        )

    def __repr__(self) -> str:
        """Return a summary: maps are too large to print."""
        return (
            f"SurfaceMap(patches={self.size}, cells={len(self.cells.ix)}, "
            f"cell_size={self.cell_size!r}, gap_size={self.gap_size!r}, frame_id={self.frame_id!r})"
        )

    __hash__ = None  # type: ignore[assignment]

    def _repr_html_(self) -> str | None:
        return html(self)

    def check(self) -> None:
        """Check every invariant of the model.

        Raises
        ------
        InputError
            Naming the first array at fault and what is wrong with it.
        """
        for fault in self._faults():
            raise InputError(fault)

    def _faults(self) -> Iterator[str]:
        if not SMALLEST_CELL <= self.cell_size <= LARGEST_CELL:
            sides = f"from {SMALLEST_CELL:g} to {LARGEST_CELL:g}"
            yield f"cell_size: is {self.cell_size!r}; it must be {sides}"
        for name in ("gap_size", "thickness"):
            value = getattr(self, name)
            if not 0 <= value <= (GREATEST_INDEX + 1) * self.cell_size:
                yield f"{name}: is {value!r}; it must be from 0 to {GREATEST_INDEX:,} cells"
        yield from self._form_faults()
        yield from self._value_faults()
        yield from self.free.faults() if self.free is not None else ()
        if not self._is_sorted():
            yield "ix, iy, height: patches are not sorted by (ix, iy, height, depth, origin, count)"
        if np.logical_and.reduce([key[1:] == key[:-1] for key in self.keys]).any():
            yield "ix, iy, height: a patch is there twice"

    def _form_faults(self) -> Iterator[str]:
        for name, dtype in COLUMNS.items():
            column = getattr(self, name)
            if column.dtype != dtype:
                yield f"{name}: has dtype {column.dtype}; it must be {dtype}"
            if column.shape != (self.size,):
                yield f"{name}: has shape {column.shape}; it must be ({self.size},), as ix"
        if self.route.dtype != np.float64:
            yield f"route: has dtype {self.route.dtype}; it must be float64"
        if self.route.ndim != 2 or self.route.shape[1] != 4:
            yield f"route: has shape {self.route.shape}; it must be (K, 4)"
        if np.isinf(self.route).any():
            yield "route: holds infinite values; what is not known is NaN"

    def _value_faults(self) -> Iterator[str]:
        measured = self.origin == MEASURED
        if np.any(self.origin > ARTIFICIAL):
            yield f"origin: holds {self.origin.max()}; it must be 0, 1 or 2"
        for name in ("height", "depth"):
            if not np.isfinite(getattr(self, name)).all():
                yield f"{name}: is not finite everywhere"
            if np.any(np.abs(getattr(self, name)) > 2 * FARTHEST):
                yield f"{name}: holds values beyond {2 * FARTHEST:.0e}, which no points span"
        if np.any(self.depth < 0):
            yield f"depth: holds {float(self.depth.min())!r}; it must be 0 or more"
        for name in STATISTICS:
            column = getattr(self, name)
            if not np.isfinite(column[measured]).all():
                yield f"{name}: is not finite for every measured patch"
            if not np.isnan(column[~measured]).all():
                yield f"{name}: is not NaN for every inserted patch"
        if np.any((self.count > 0) != measured):
            yield "count: must be 0 for inserted patches and above 0 for measured ones"
        bottom, mean, top = self.bottom[measured], self.mean[measured], self.top[measured]
        if np.any((bottom > mean) | (mean > top)):
            yield "mean: does not lie between bottom and top everywhere"
        if np.any(self.variance[measured] < 0):
            yield "variance: holds values below 0"
        if np.any(~np.isnan(self.noise[~measured])):
            yield "noise: is not NaN for every inserted patch"
        if np.any((self.noise < 0) | np.isinf(self.noise)):
            yield "noise: holds values below 0 or infinite ones; what is not known is NaN"
        if overlap(self.ix[measured], self.iy[measured], bottom, top):
            yield "bottom, top: measured patches of one cell overlap"
        beyond = self.beyond_points()
        if np.any(beyond & (self.moved == 0)):
            yield "height: lies beyond bottom and top of a measured patch that moved does not mark"
        if np.any(self.moved != beyond):
            yield "moved: must be 1 for measured patches beyond bottom and top, 0 for all others"
        if np.any(self.region < -1):
            yield f"region: holds {self.region.min()}; it must be -1 or more"
        yield from self._keyframe_faults(measured)

    def _keyframe_faults(self, measured: Bool) -> Iterator[str]:
        first, last, keyframes = self.first_keyframe, self.last_keyframe, len(self.route)
        for name, column in (("first_keyframe", first), ("last_keyframe", last)):
            if np.any(column[~measured] != -1):
                yield f"{name}: must be -1 for inserted patches"
            if np.any((column[measured] < 0) | (column[measured] >= keyframes)):
                yield f"{name}: does not name a row of route ({keyframes} rows) everywhere"
        if np.any(first > last):
            yield "first_keyframe: comes after last_keyframe somewhere"

    def _is_sorted(self) -> bool:
        """Return whether the patches are in the file's order."""
        return bool(ascend(self.keys))
