"""Two maps, patch by patch.

Patches of the two maps are matched one to one within a cell: two match where each is the other's
nearest in height, at most `gap_size` away. Patches without a match are in one map only; matched
ones are compared in height and depth. The comparison is symmetric: exchanging the maps exchanges
their names only.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from numbers import Real
from typing import Any

import numpy as np

from mlscli.errors import UsageError, expect
from mlscli.maps.cells import pack
from mlscli.maps.grid import LENGTHS
from mlscli.maps.surface_map import ORIGINS, SurfaceMap
from mlscli.runtime.arrays import Array, Bool, Float64, Int64
from mlscli.scoring.kernels import match

# The group of matched patches whose origins differ.
CHANGED = "changed"


@dataclass(frozen=True)
class Spread:
    """Statistics of the absolute differences of lengths.

    Attributes
    ----------
    rmse, median, p95, maximum : float or None
        Root mean square, median, 95th percentile and maximum, in the unit of the map; None where
        there is nothing to compare.
    beyond : int
        How many differences are greater than the tolerance.
    """

    rmse: float | None
    median: float | None
    p95: float | None
    maximum: float | None
    beyond: int

    @classmethod
    def of(cls, differences: Float64, tolerance: float) -> Spread:
        """Return the statistics of differences, float64 (N,)."""
        if not len(differences):
            return cls(None, None, None, None, 0)
        size = np.abs(differences)
        return cls(
            root_mean_square(size),
            float(np.median(size)),
            float(np.quantile(size, 0.95)),
            float(size.max()),
            int(np.count_nonzero(size > tolerance)),
        )


@dataclass(frozen=True)
class Differences:
    """What differs between some patches of two maps.

    Attributes
    ----------
    matched, only_a, only_b : int
        How many patches both maps have, only the first, and only the second.
    heights, depths : Spread
        Differences of the heights and depths of matched patches.
    """

    matched: int
    only_a: int
    only_b: int
    heights: Spread
    depths: Spread

    @property
    def beyond(self) -> bool:
        """Whether a patch is in one map only, or differs by more than the tolerance."""
        return any((self.only_a, self.only_b, self.heights.beyond, self.depths.beyond))


@dataclass(frozen=True)
class Comparison:
    """What differs between two maps.

    Attributes
    ----------
    identical : bool
        Whether the maps are equal, bit for bit, in all but route and meta; lengths of their grids
        may differ by 1e-9 of a cell.
    tolerance : float
        Heights and depths that differ by no more than this count as equal; in the unit of the map.
    grid : mapping of str to tuple
        ``thickness`` and ``frame_id`` of both maps, where these differ.
    columns : mapping of str to int
        How many matched patches differ in a column, bit for bit; columns without any are left out.
    total : Differences
        Of all patches.
    by_origin : mapping of str to Differences
        Of the measured, plastered and artificial patches (matched ones: in both maps), and of the
        ``changed``: matched patches whose origins differ.
    """

    identical: bool
    tolerance: float
    grid: Mapping[str, tuple[Any, Any]]
    columns: Mapping[str, int]
    total: Differences
    by_origin: Mapping[str, Differences]

    @property
    def differ(self) -> bool:
        """Whether the maps differ.

        With a tolerance of 0: whether they are not identical. Otherwise: whether a patch is in one
        map only, has another origin, or differs in height or depth by more than the tolerance.
        """
        if self.identical or self.tolerance == 0:
            return not self.identical
        return self.total.beyond or self.by_origin[CHANGED].matched > 0

    def to_dict(self) -> dict[str, Any]:
        """Return all fields and `differ`, ready for JSON."""
        return {"identical": self.identical, "differ": self.differ} | asdict(self)


def compare_maps(a: SurfaceMap, b: SurfaceMap, tolerance: float = 0.0) -> Comparison:
    """Compare two maps patch by patch.

    Parameters
    ----------
    a, b : SurfaceMap
        Maps of one cell size and gap size.
    tolerance : float
        Heights and depths that differ by no more than this count as equal; in the unit of the
        maps.

    Returns
    -------
    Comparison

    Raises
    ------
    UsageError
        Where cell size or gap size differ, or the tolerance is not a finite number of 0 or more.
    """
    expect(a, SurfaceMap, "a", "a map (SurfaceMap)")
    expect(b, SurfaceMap, "b", "a map (SurfaceMap)")
    expect(tolerance, Real, "tolerance", "a number of 0 or more")
    if not 0 <= tolerance < math.inf:
        raise UsageError(f"tolerance: is {tolerance!r}; it must be a number, 0 or more")
    require_same_cells(a, b)
    different = a.grid.differing(b.grid)
    in_a, in_b = matches(a, b)
    only_a, only_b = np.delete(a.origin, in_a), np.delete(b.origin, in_b)
    dh, dd = a.height[in_a] - b.height[in_b], a.depth[in_a] - b.depth[in_b]

    def differences(matched: Bool, alone_a: Bool, alone_b: Bool) -> Differences:
        return Differences(
            int(np.count_nonzero(matched)),
            int(np.count_nonzero(alone_a)),
            int(np.count_nonzero(alone_b)),
            Spread.of(dh[matched], tolerance),
            Spread.of(dd[matched], tolerance),
        )

    both = np.where(a.origin[in_a] == b.origin[in_b], a.origin[in_a], len(ORIGINS))
    return Comparison(
        identical=a == _on_lengths_of(a, b),
        tolerance=float(tolerance),
        grid={
            name: (getattr(a, name), getattr(b, name))
            for name in ("thickness", "frame_id")
            if name in different or (name == "frame_id" and a.frame_id != b.frame_id)
        },
        columns=_differing_columns(a, b, in_a, in_b),
        total=differences(both >= 0, only_a >= 0, only_b >= 0),
        by_origin={
            name: differences(both == origin, only_a == origin, only_b == origin)
            for origin, name in enumerate((*ORIGINS, CHANGED))
        },
    )


def matches(a: SurfaceMap, b: SurfaceMap) -> tuple[Int64, Int64]:
    """Return the patches of two maps that match.

    Returns
    -------
    in_a, in_b : int64 (M,)
        Indices of the matched patches in either map, those of the first map ascending.
    """
    keys, other_keys = pack(a.cells.ix, a.cells.iy), pack(b.cells.ix, b.cells.iy)
    _, cells, other_cells = np.intersect1d(
        keys, other_keys, assume_unique=True, return_indices=True
    )
    matched = match(
        a.height, a.cells.start, b.height, b.cells.start, cells, other_cells, a.gap_size
    )
    in_a = np.flatnonzero(matched >= 0)
    return in_a, matched[in_a]


def require_same_cells(a: SurfaceMap, b: SurfaceMap) -> None:
    """Refuse two maps whose patches cannot be matched.

    Raises
    ------
    UsageError
        Where cell size or gap size differ.
    """
    for name in a.grid.differing(b.grid):
        if name != "thickness":
            raise UsageError(
                f"{name}: is {getattr(a, name)!r} in one map and {getattr(b, name)!r} in the "
                "other; patches can be matched on one grid only"
            )


def _on_lengths_of(a: SurfaceMap, b: SurfaceMap) -> SurfaceMap:
    """Return `b` with the lengths of `a`, but for those that differ by more than a rounding."""
    different = b.grid.differing(a.grid)
    return replace(b, **{name: getattr(a, name) for name in LENGTHS if name not in different})


def root_mean_square(values: Float64) -> float:
    """Return the root mean square of values (N,), N > 0; large values do not overflow."""
    scale = float(np.abs(values).max())
    return scale * math.sqrt(float(np.mean((values / scale) ** 2))) if scale else 0.0


def _differing_columns(a: SurfaceMap, b: SurfaceMap, in_a: Int64, in_b: Int64) -> dict[str, int]:
    """Return how many matched patches differ in each column, bit for bit, where any do."""
    counts = {
        name: int(np.count_nonzero(_bits(mine[in_a]) != _bits(b.columns[name][in_b])))
        for name, mine in a.columns.items()
    }
    return {name: count for name, count in counts.items() if count}


def _bits(column: Array) -> Array:
    """Return the bits of a column as unsigned integers: NaN equals itself, and 0 is not -0."""
    bits: Array = column.view(f"u{column.itemsize}")
    return bits
