"""What appeared and what went between two flights over the same place.

Gone is what one flight measured and a later one saw through, not what it did not look at; what
appeared is what the later flight measured where the earlier one had seen through. So both maps
must know free space. Space that is occupied in one map and seen through in the other, as in the
change detection of W. Xiao, B. Vallet, M. Brédif and N. Paparoditis, *Street environment change
detection from mobile laser scanning point clouds*, ISPRS Journal of Photogrammetry and Remote
Sensing 107, 2015 (doi:10.1016/j.isprsjprs.2015.04.011), here voxel by voxel.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from mlscli.errors import UsageError, expect
from mlscli.maps.space import occupied
from mlscli.maps.surface_map import MEASURED, SurfaceMap
from mlscli.runtime.arrays import Bool, Int64, repeated
from mlscli.scoring.comparison import require_same_cells
from mlscli.scoring.kernels import Patches, covered, nearby

SMALLEST = 8.0
"""What fills less, in cells cubed, may be an outlier that one of the maps kept."""


class Thing(NamedTuple):
    """What appeared or went as one.

    Attributes
    ----------
    low, high : tuple of float
        The corners (x, y, z) of the box that holds it, in the unit of the map.
    volume : float
        Of the voxels in which it was measured and that were seen through before or after, in the
        cube of the map's unit: of its surfaces, not of what they enclose.
    """

    low: tuple[float, float, float]
    high: tuple[float, float, float]
    volume: float


@dataclass(frozen=True)
class Changes:
    """What differs between two flights.

    Attributes
    ----------
    appeared, gone : list of Thing
        The largest first.
    smaller : tuple of int
        How many places appeared, and went, that are too small to be told from outliers.
    not_seen_again : int
        Measured patches of the earlier map where the later one has none, and saw nothing through:
        it did not look there.
    not_seen_before : int
        Measured patches of the later map where the earlier flight had not looked.
    """

    appeared: list[Thing]
    gone: list[Thing]
    smaller: tuple[int, int]
    not_seen_again: int
    not_seen_before: int

    @property
    def changed(self) -> bool:
        """Whether anything appeared or went."""
        return bool(self.appeared or self.gone)

    def to_dict(self) -> dict[str, Any]:
        """Return all fields and `changed`, ready for JSON."""
        told = asdict(self)
        for name in ("appeared", "gone"):
            told[name] = [thing._asdict() for thing in getattr(self, name)]
        return {"changed": self.changed, **told}


def changes(
    before: SurfaceMap, after: SurfaceMap, *, least: int = 2, smallest: float = SMALLEST
) -> Changes:
    """Return what appeared and what went from one flight to a later one.

    Parameters
    ----------
    before, after : SurfaceMap
        Maps of the same place, frame, cell size and gap size, with free space.
    least : int
        How many sight lines make space free, see `space_at`.
    smallest : float
        What fills less is counted only, in cells cubed.

    Raises
    ------
    UsageError
        Where a map has no free space, or cell size, gap size or frame differ.
    """
    for surface, name in ((before, "before"), (after, "after")):
        expect(surface, SurfaceMap, name, "a map (SurfaceMap)")
    require_same_cells(before, after)
    if before.frame_id != after.frame_id:
        raise UsageError(
            f"the maps are of different frames: {before.frame_id!r} and {after.frame_id!r}"
        )
    for surface, name in ((before, "the first map"), (after, "the second map")):
        if surface.free is None:
            raise UsageError(
                f"{name} does not say what was seen through, and what was not looked at could pass "
                "for gone; build it with `free_space`"
            )
    went, came = _seen_through(before, after, least), _seen_through(after, before, least)
    gone, few_gone = _things(went, before.cell_size, smallest)
    appeared, few_appeared = _things(came, before.cell_size, smallest)
    return Changes(
        appeared,
        gone,
        (few_appeared, few_gone),
        _not_looked_at(before, after, went),
        _not_looked_at(after, before, came),
    )


def _seen_through(one: SurfaceMap, other: SurfaceMap, least: int) -> Int64:
    """Return the voxels (N, 3) that one map measured, and the other saw through.

    Where the other map has a patch in the voxel or in one beside it, the same thing may lie a
    little elsewhere.
    """
    assert other.free is not None
    voxels = other.free.voxels[other.free.lines >= least].astype(np.int64)
    voxels = voxels[occupied(one.take(one.origin == MEASURED), *voxels.T)]
    near = np.zeros(len(voxels), dtype=np.bool_)
    for step in product((-1, 0, 1), repeat=3):
        near |= occupied(other, *(voxels + step).T)
    return voxels[~near]


def _things(voxels: Int64, cell_size: float, smallest: float) -> tuple[list[Thing], int]:
    """Return voxels a cell apart or less as one thing, and how many of these are too small."""
    if not len(voxels):
        return [], 0
    # In cells; the next ones are more than a cell apart.
    pairs = KDTree(voxels * (1, 1, 0.5)).query_pairs(1.25, p=np.inf, output_type="ndarray")
    links = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(voxels), len(voxels)))
    count, number = connected_components(links, directed=False)
    sides = np.array([cell_size, cell_size, cell_size / 2])
    order = np.argsort(number, kind="stable")
    parts = np.split(voxels[order], np.cumsum(np.bincount(number, minlength=count))[:-1])
    # A voxel is half a cell cubed.
    large = [part for part in parts if len(part) / 2 >= smallest]
    large.sort(key=lambda part: (-len(part), *part[0].tolist()))
    things = [
        Thing(
            tuple((part.min(axis=0) * sides).tolist()),
            tuple(((part.max(axis=0) + 1) * sides).tolist()),
            len(part) * float(sides.prod()),
        )
        for part in large
    ]
    return things, count - len(large)


def _not_looked_at(one: SurfaceMap, other: SurfaceMap, seen_through: Int64) -> int:
    """Return how many measured patches of one map the other neither has nor saw through."""
    mine, others = Patches.measured(one), Patches.of(other)
    near = nearby(mine.ix, mine.iy, others.ix, others.iy, 1)
    missing = ~covered(mine.low, mine.high, near, others.low, others.high, one.cell_size / 2)
    return int(np.count_nonzero(missing & ~_holds(mine, seen_through, one.cell_size)))


def _holds(patches: Patches, voxels: Int64, cell_size: float) -> Bool:
    """Return which patches reach into one of some voxels (N, 3)."""
    ix, iy, iz = voxels[np.lexsort(voxels.T[::-1])].T
    begin, end = nearby(patches.ix, patches.iy, ix.astype(np.int32), iy.astype(np.int32), 0)[:, 0].T
    patch, place = repeated(end - begin)
    low, high = (np.floor(each / (cell_size / 2)) for each in (patches.low, patches.high))
    height = iz[begin[patch] + place]
    holds = np.zeros(len(begin), dtype=np.bool_)
    holds[patch[(height >= low[patch]) & (height <= high[patch])]] = True
    return holds
