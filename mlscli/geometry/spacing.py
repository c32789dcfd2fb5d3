"""How far apart the distinct points of a cloud lie.

The measure is the distance to the fourth nearest neighbour, and of a cloud the median of it: the
k-th nearest neighbour is the oldest estimate of density there is (D. Loftsgaarden and
C. Quesenberry, 1965, https://doi.org/10.1214/aoms/1177700079), and outliers hardly move a median.

Points that coincide, or lie in clusters, measure nothing but the sensor's own noise. What is
distinct shows when the cloud is thinned to one point for each box of side s: where most of what is
left has one other at most within 2 s, the boxes hold a cluster each (one may hold a part of it).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from mlscli.geometry.surroundings import hashed
from mlscli.runtime.arrays import Array, Float64, Int64, UInt32
from mlscli.runtime.threads import in_ranges

NEIGHBOUR = 4

# Neighbours are searched for this many points at most.
_ASKED = 100_000
# Most boxes have so many others at most within so many sides.
_BESIDE, _APART = 1, 2.0
# Boxes grow by this factor, from the distance of the points on.
_GROWTH = 2**0.5
# After so many more steps they are four times as wide.
_LATER = 4
# Of boxes on a surface a sixteenth is left in boxes four times as wide, on a curve a quarter; of
# boxes that stand apart, more than this.
_STILL_APART = 0.2
# There are this many points to a cluster, or more.
_FEWEST_JOINED = 2
# So many of the points lie in clusters that stand apart, not counting the largest few: these could
# be whole scenes. Outliers are fewer.
_LEAST_CLUSTERED = 0.25
_LARGEST = 8
# Distances that grow by less are the same: thinning lengthens them a little.
_SAME = 1.5
# A look of fewer points than this does not count, and of more looks than this some are taken.
_FEWEST = 20
_LOOKS = 64
# One look seems to cover more ground than all do together, by this factor.
_IMPOSSIBLE = 2.0


class Neighbourhoods:
    """Distinct points, and who lies near whom.

    Parameters
    ----------
    points : float64 (N, 3)
        Coordinates, finite; they may be put in another order, in place.
    is_distinct : bool
        Whether no point is there twice; else those that are are dropped.

    Attributes
    ----------
    points : float64 (M, 3)
        Those that lie close together mostly stand so, too.
    rows : uint32 (M,)
        The numbers that they had among the distinct ones.
    """

    def __init__(self, points: Float64, *, is_distinct: bool = False) -> None:
        from mlscli.runtime.tree import Tree

        points = points if is_distinct else distinct(points)
        self.points = np.require(points, requirements=("C", "W"))
        self._tree = Tree(self.points, in_place=True)
        self.rows = self._tree.rows

    def some(self, size: int) -> Int64:
        """Return the numbers of `size` points, or of a few more, chosen by their coordinates.

        Points that lie the same in a cloud turned or mirrored about z are chosen together.
        """
        if len(self.points) <= size:
            return np.arange(len(self.points))
        keys = hashed(turned(self.points))
        return np.flatnonzero(keys <= np.partition(keys, size - 1)[size - 1])

    def distances(
        self,
        rows: Int64,
        progress: Callable[[int], None] | None = None,
        *,
        nearest: int = NEIGHBOUR,
    ) -> Float64:
        """Return how far the fourth neighbour of points lies, or another; infinite: there is none.

        Parameters
        ----------
        rows : int64 (K,)
            The numbers of the points.
        progress : callable, optional
            Called with the number of points done, now and then.
        nearest : int
            Which neighbour.
        """

        def query(begin: int, end: int) -> Float64:
            found, _ = self._tree.nearest(self.points[rows[begin:end]], nearest + 1)
            return found[:, -1]

        return np.concatenate(in_ranges(len(rows), query, progress))

    def around(self, places: Float64, most: int, reach: float) -> tuple[Float64, Array]:
        """Return the points around some of them, at most so many and so far, and which there are.

        Parameters
        ----------
        places : float64 (N, 3)
            Where these are.
        most : int
        reach : float
            In the unit of the recording.

        Returns
        -------
        near : float64 (N, most, 3)
            The points, nearest first, each itself the first; 0 where there are fewer.
        there : bool (N, most)
        """
        distances, near = self._tree.nearest(places, most, reach)
        there = np.isfinite(distances)
        return np.where(there[..., None], self.points[np.where(there, near, 0)], 0.0), there


def turned(points: Float64) -> Iterator[Float64]:
    """Yield coordinates that are the same for points turned by right angles about z or mirrored."""
    x, y, z = points.T
    yield np.minimum(np.abs(x), np.abs(y))
    yield np.maximum(np.abs(x), np.abs(y))
    yield z + 0.0


def distinct(points: Float64) -> Float64:
    """Return the points, float64 (N, 3), each once: of those that are equal, one of them."""
    keys = hashed(points.T)
    order = np.argsort(keys)
    first = _firsts(keys[order])
    # In their own order, points that lie close together mostly stand so, too.
    return points if len(first) == len(points) else points[np.sort(order[first])]


def _firsts(keys: Array) -> Int64:
    """Return where each key comes first, given keys in order."""
    is_first = np.ones(len(keys), dtype=np.bool_)
    np.not_equal(keys[1:], keys[:-1], out=is_first[1:])
    return np.flatnonzero(is_first)


class Spacing(NamedTuple):
    """How far apart the points of a cloud lie, and by which of them that was told.

    Attributes
    ----------
    distance : float
        Median distance of the points to their fourth neighbour, in the unit of the recording.
    cloud : Neighbourhoods
        The points.
    """

    distance: float
    cloud: Neighbourhoods

    @property
    def area(self) -> float:
        """What the points cover, but for a factor, in the square of the unit."""
        return len(self.cloud.points) * self.distance**2


def spacing(points: Float64, progress: Callable[[int], None] | None = None) -> Spacing | None:
    """Return the spacing of the distinct points of a cloud; None where these are too few.

    Parameters
    ----------
    points : float64 (N, 3)
        Coordinates, finite; they may be put in another order, in place.
    progress : callable, optional
        Called with the number of points done, now and then.
    """
    cloud = Neighbourhoods(points)
    if len(cloud.points) <= NEIGHBOUR:
        return None
    rows = cloud.some(_ASKED)

    def done(count: int) -> None:
        if progress is not None:
            progress(count * len(points) // len(rows))

    return Spacing(float(np.median(cloud.distances(rows, done))), cloud)


def without_clusters(found: Spacing, farthest: float) -> Spacing:
    """Return the spacing of the clusters of a cloud; the same again where it has none.

    Of several sizes of clusters, such as those of beams within those of scans, the largest counts.

    Parameters
    ----------
    found : Spacing
        Of all points.
    farthest : float
        The greatest distance that is believed, in the unit of the recording.
    """
    clusters, points = found, found.cloud.points
    # The last boxes, from the smallest on: the largest are four times as wide.
    boxes = [_Boxes(points, np.ones(len(points), dtype=np.uint32), 0.0)]
    side = _GROWTH * found.distance
    while side <= farthest and len(boxes[-1].points) > 2 * _LARGEST:
        boxes.append(boxes[-1].joined(side, _nearest))
        side *= _GROWTH
        if len(boxes) <= _LATER:
            continue
        small = boxes.pop(0)
        # Boxes that stand apart still do where they are wider.
        if small.side and len(boxes[-1].points) >= _STILL_APART * len(small.points):
            clusters = small.apart(found.distance, farthest) or clusters
    return clusters


class _Boxes(NamedTuple):
    """A cloud thinned to one point for each box.

    Attributes
    ----------
    points : float64 (N, 3)
        Halfway between the extremes of the points of each box.
    size : uint32 (N,)
        How many points there were.
    side : float
        Of a box, in the unit of the recording.
    """

    points: Float64
    size: UInt32
    side: float

    def joined(self, side: float, number: Callable[[Float64], Float64]) -> _Boxes:
        """Return the points joined in boxes, numbered by what their coordinates are in sides."""
        keys = hashed(number(axis / side) for axis in self.points.T)
        order = np.argsort(keys)
        start = _firsts(keys[order])
        del keys
        size = np.add.reduceat(self.size[order], start, dtype=np.uint32)
        middles = np.empty((len(start), 3))
        for axis, middle in zip(self.points.T, middles.T, strict=True):
            ranked = axis[order]
            middle[:] = np.minimum.reduceat(ranked, start)
            middle += np.maximum.reduceat(ranked, start)
            middle /= 2
            middle += 0.0
            del ranked
        return _Boxes(middles, size, side)

    def apart(self, least: float, farthest: float) -> Spacing | None:
        """Return the spacing of the boxes; None where they hold no clusters that stand apart.

        Parameters
        ----------
        least, farthest : float
            Spacing of the points, which clusters exceed, and the most that is believed.
        """
        # Clusters lie on edges, too: join once more, in boxes between the first.
        points, size, _ = self.joined(self.side, _away_from_zero)
        if not 2 * _LARGEST < len(points) <= size.sum() / _FEWEST_JOINED:
            return None
        cloud = Neighbourhoods(points, is_distinct=True)
        distance = float(np.median(cloud.distances(cloud.some(_ASKED))))
        if not _SAME * least <= distance <= farthest:
            return None
        size = size[cloud.rows]
        is_alone = cloud.distances(np.arange(len(size)), nearest=_BESIDE + 1) >= _APART * self.side
        if 2 * np.count_nonzero(is_alone) < len(size):
            return None
        alone = np.sort(size[is_alone])
        is_clustered = alone[:-_LARGEST].sum() >= _LEAST_CLUSTERED * size.sum()
        return Spacing(distance, cloud) if is_clustered else None


def _nearest(numbers: Float64) -> Float64:
    """Return the whole numbers nearest to numbers, which are overwritten; never -0.0."""
    np.rint(numbers, out=numbers)
    numbers += 0.0
    return numbers


def _away_from_zero(numbers: Float64) -> Float64:
    """Return the next whole numbers away from 0; never -0.0."""
    return np.copysign(np.ceil(np.abs(numbers)), numbers) + 0.0


def of_one_look(found: Spacing, looks: Sequence[Float64]) -> Spacing | None:
    """Return the usual spacing of a single look, where looks repeat each other; else None.

    What looks see anew adds to what they cover together. Where one look alone, by its number of
    points and their spacing, seems to cover more than all do together, they have seen the same
    points again, a little off.

    Parameters
    ----------
    found : Spacing
        Of all looks together.
    looks : sequence of float64 (N, 3)
        The points of each, finite.
    """
    rich = [points for points in looks if len(points) >= _FEWEST]
    taken = rich[:: -(-len(rich) // _LOOKS)] if len(rich) > 1 else []
    each = [one for points in taken if (one := spacing(points.copy())) is not None]
    if not each:
        return None
    points = np.array([len(one.cloud.points) for one in each])
    areas = np.array([one.area for one in each])
    usual = each[_middle(areas, points)].area
    if usual < _IMPOSSIBLE * found.area:
        return None
    return each[_middle(np.array([one.distance for one in each]), points)]


def _middle(values: Float64, weights: Array) -> int:
    """Return the number of the weighted median."""
    order = np.argsort(values, kind="stable")
    reached = np.cumsum(weights[order])
    return int(order[np.searchsorted(reached, reached[-1] / 2)])
