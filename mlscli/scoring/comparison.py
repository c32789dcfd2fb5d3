"""Two maps, patch by patch.

Patches of the two are matched one to one within a cell: each with the nearest in height, at most
`gap_size` away, if that finds it the same way. What has no match is in one map only; of those
that match, the differences of height and depth are told. Neither map is the better one: exchange
them, and only the names change.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from mlscli.errors import UsageError, expect
from mlscli.maps.cells import pack
from mlscli.maps.surface_map import ORIGINS, SurfaceMap
from mlscli.runtime.arrays import Array, Bool, Float64, Int64
from mlscli.scoring.kernels import match

# Matched patches of two origins: they belong to neither.
CHANGED = "changed"


@dataclass(frozen=True)
class Spread:
    """How large the differences of some lengths are, whatever their sign.

    Attributes
    ----------
    rmse, median, p95, maximum : float or None
        Root of the mean square, median, 95th percentile and maximum; None where there is nothing
        to compare. In the unit of the map.
    beyond : int
        How many are greater than the tolerance.
    """

    rmse: float | None
    median: float | None
    p95: float | None
    maximum: float | None
    beyond: int

    @classmethod
    def of(cls, differences: Float64, tolerance: float) -> Spread:
        """Measure differences (N,)."""
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
        Patches that both maps have, and that only the first or only the second has.
    heights, depths : Spread
        Of the matched ones.
    """

    matched: int
    only_a: int
    only_b: int
    heights: Spread
    depths: Spread

    @property
    def beyond(self) -> bool:
        """Whether one map has a patch that the other has not, or not within the tolerance."""
        return any((self.only_a, self.only_b, self.heights.beyond, self.depths.beyond))


@dataclass(frozen=True)
class Comparison:
    """What differs between two maps.

    Attributes
    ----------
    identical : bool
        Whether the maps are equal, bit for bit, in all but route and meta.
    tolerance : float
        Heights and depths that differ by no more than this pass for equal.
    grid : mapping
        ``thickness`` and ``frame_id`` of both maps, where these differ.
    columns : mapping
        Of the columns of which matched patches do not hold the same, bit for bit: how many.
    total : Differences
        Of all patches.
    by_origin : mapping
        Differences of the patches that are measured, plastered, artificial (matched ones: in both
        maps), and of the matched ones that are ``changed`` from one origin to another.
    """

    identical: bool
    tolerance: float
    grid: Mapping[str, tuple[Any, Any]]
    columns: Mapping[str, int]
    total: Differences
    by_origin: Mapping[str, Differences]

    @property
    def differ(self) -> bool:
        """Whether the maps differ: with a tolerance above 0, in patches, heights and depths.

        A patch of another origin is another patch. Without a tolerance nothing passes that is
        not identical.
        """
        if self.identical or self.tolerance == 0:
            return not self.identical
        return self.total.beyond or self.by_origin[CHANGED].matched > 0

    def to_dict(self) -> dict[str, Any]:
        """Return all of it, ready for JSON."""
        return {"identical": self.identical, "differ": self.differ} | asdict(self)


def compare_maps(a: SurfaceMap, b: SurfaceMap, tolerance: float = 0.0) -> Comparison:
    """Compare two maps patch by patch.

    Parameters
    ----------
    a, b
        Maps of one grid.
    tolerance
        Differences of height or depth up to this pass; in the unit of the maps.

    Raises
    ------
    UsageError
        Where cell size or gap size differ, or the tolerance is no number of 0 or more.
    """
    expect(a, SurfaceMap, "a", "a map (SurfaceMap)")
    expect(b, SurfaceMap, "b", "a map (SurfaceMap)")
    if not 0 <= tolerance < math.inf:
        raise UsageError(f"tolerance: is {tolerance!r}; it must be a number, 0 or more")
    require_same_cells(a, b)
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
        identical=a == b,
        tolerance=float(tolerance),
        grid={
            name: (getattr(a, name), getattr(b, name))
            for name in ("thickness", "frame_id")
            if getattr(a, name) != getattr(b, name)
        },
        columns=_differing_columns(a, b, in_a, in_b),
        total=differences(both >= 0, only_a >= 0, only_b >= 0),
        by_origin={
            name: differences(both == origin, only_a == origin, only_b == origin)
            for origin, name in enumerate((*ORIGINS, CHANGED))
        },
    )


def matches(a: SurfaceMap, b: SurfaceMap) -> tuple[Int64, Int64]:
    """Return the patches of two maps that match, row by row (M,), ascending in the first map."""
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
    """Refuse maps whose patches cannot be told to be the same.

    Raises
    ------
    UsageError
        Naming what differs.
    """
    for name in ("cell_size", "gap_size"):
        mine, others = getattr(a, name), getattr(b, name)
        if mine != others:
            raise UsageError(
                f"{name}: is {mine!r} in one map and {others!r} in the other; "
                "patches can be matched on one grid only"
            )


def root_mean_square(values: Float64) -> float:
    """Return the root of the mean square of values (N,), N > 0, none of them squared too large."""
    scale = float(np.abs(values).max())
    return scale * math.sqrt(float(np.mean((values / scale) ** 2))) if scale else 0.0


def _differing_columns(a: SurfaceMap, b: SurfaceMap, in_a: Int64, in_b: Int64) -> dict[str, int]:
    counts = {
        name: int(np.count_nonzero(_bits(mine[in_a]) != _bits(b.columns[name][in_b])))
        for name, mine in a.columns.items()
    }
    return {name: count for name, count in counts.items() if count}


def _bits(column: Array) -> Array:
    """Return what a column is made of, as integers: NaN equals itself, and 0 is not -0."""
    bits: Array = column.view(f"u{column.itemsize}")
    return bits
