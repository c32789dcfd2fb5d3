"""Notice a map that is published again and again, its surfaces at other places.

A SLAM system that publishes its whole map with every message corrects it meanwhile: taken together,
its messages hold each surface several times, at other heights. Such a map is told from a sensor
that sees one area again and again by a sample of the messages:

- The messages repeat each other. Points have twins in the next message, but for a shift that they
  have in common: their nearest point there is much nearer than the second nearest (the ratio test
  of D. Lowe, *Distinctive Image Features from Scale-Invariant Keypoints*, 2004,
  doi:10.1023/B:VISI.0000029664.99615.94). Or the points at one index are much nearer to each other
  than to the point at the next index. Or the messages grow all the time. Scans of a room may do
  all this, too.
- The last message covers the area of those before. A window that moves with the craft does not.
- Surfaces have moved: a quarter of the points of earlier messages or more are farther from those of
  the last one than these are from each other, or lie on one side of the planes through them,
  farther than their scatter explains. What a scanner sees again lies on both sides.
"""

from __future__ import annotations

from collections.abc import Hashable
from typing import NamedTuple

import numpy as np

from mlscli.geometry.surroundings import fit_planes
from mlscli.io.plausibility.places import spread
from mlscli.io.reading.sieve import all_measured
from mlscli.parameters.lengths import FARTHEST
from mlscli.runtime.arrays import Bool, Float64, Int64

# How many messages are sampled at most, how many points of each are kept, and of how many a slab
# is searched for twins; and the least number of points with which a message counts.
_SAMPLES, _POINTS, _SEARCHED, _FEWEST = 12, 256, 4_000, 64

# A twin is nearer than this part of the distance to other points; most points have one.
_NEAR, _MOST = 0.4, 0.65
# A common shift is sought among those to so many points nearest to each; shifts are alike that
# differ by less than this part of the distance to the last of these. After as many messages that
# repeat nothing, it is not sought any more: that takes longer than all else.
_SHIFTS, _ALIKE, _ATTEMPTS = 8, 0.1, 4
# The share of messages that repeat the one before.
_REPEATED = 0.7
# Messages that grow all the time end with at least so many times the points of the first; all but a
# few have this part of the points of the largest before.
_GROWTH, _SHRUNK, _FEW = 1.5, 0.8, 0.25
# The share of points that are covered, and how near the last message is to these, of its extent.
_COVERED, _AROUND = 0.6, 1 / 8
# The share of points that have moved, and of messages whose points have.
_MOVED, _MESSAGES = 0.25, 0.15
# Points have moved together where they lie beside a plane by this part of the spacing in the mean,
# and by so many times the standard error of that mean.
_ASIDE, _SIGNIFICANT = 0.25, 4.0
# As many points around one make a plane, and as many around that one move together; of these,
# most must be near planes of one orientation, which are trusted at least so far.
_PLANE, _TOGETHER, _AGREEING, _FLAT = 16, 8, 6, 0.1


class Republished:
    """Watches the messages of a pass, and keeps the last one and samples of some."""

    def __init__(self) -> None:
        self._key: Hashable = None
        self._parts: list[Float64] = []
        self._last = np.empty((0, 3))
        self._messages = self._first = self._most = 0
        self._shrunk = self._in_vain = 0
        self._samples: list[_Sample] = []
        self._every = 1

    def add(self, points: Float64, key: Hashable) -> None:
        """Take a part of a message: points, float64 (N, 3), and a key that all its parts share."""
        if key != self._key:
            self._close()
            self._key = key
        self._parts.append(points)

    def is_noticed(self) -> bool:
        """Return whether the messages so far are a map that was published at other places."""
        self._close()
        earlier = [
            each.points
            for each in self._samples
            if each.message < self._messages - 1 and len(each.points) >= _FEWEST
        ]
        if not earlier or not self._is_repeated:
            return False
        return _lies_elsewhere(_measured(self._last), earlier)

    @property
    def _is_repeated(self) -> bool:
        """Whether most messages repeat the one before, or grow from it."""
        grows = self._messages > 2 and len(self._last) >= _GROWTH * self._first
        repeated = [each.is_repeated for each in self._samples if each.is_repeated is not None]
        return (grows and self._shrunk <= _FEW * self._messages) or (
            sum(repeated) >= _REPEATED * max(1, len(repeated))
        )

    def _close(self) -> None:
        """Take the message whose parts have come, if any have."""
        if not self._parts:
            return
        points = self._parts[0] if len(self._parts) == 1 else np.concatenate(self._parts)
        self._parts = []
        size = len(points)
        self._shrunk += size < _SHRUNK * self._most
        # What is much smaller may be of another kind, such as the cameras between the maps.
        if size < max(_FEWEST, self._most / 2):
            return
        self._first = self._first or size
        latest = self._samples[-1] if self._samples else None
        if latest is not None and latest.is_repeated is None:
            repeated = _is_in_order(self._last, points) or latest.has_twins(
                points, shifted=self._in_vain < _ATTEMPTS
            )
            self._in_vain += not repeated
            self._samples[-1] = latest._replace(is_repeated=repeated)
        if self._messages % self._every == 0:
            self._samples.append(_Sample.of(self._messages, points))
            if len(self._samples) > _SAMPLES:
                self._every *= 2
                self._samples = [s for s in self._samples if s.message % self._every == 0]
        self._last, self._most = points, max(self._most, size)
        self._messages += 1


class _Sample(NamedTuple):
    """Some points of a message.

    Attributes
    ----------
    message : int
        Number of the message.
    points : float64 (M, 3)
        From all over it.
    axis : int
    low, high : float
        A slab: bounds of one coordinate, inclusive.
    crowd : float64 (K, 3)
        From the slab, where twins are looked for.
    is_repeated : bool or None
        Whether the next message repeats this one; None where none has come.
    """

    message: int
    points: Float64
    axis: int
    low: float
    high: float
    crowd: Float64
    is_repeated: bool | None = None

    @classmethod
    def of(cls, message: int, points: Float64) -> _Sample:
        """Choose points of a message, float64 (N, 3)."""
        points = _measured(points)
        sample = _some(points, _POINTS)
        axis = int(np.argmax(np.ptp(sample, axis=0))) if len(sample) else 0
        low, high = -np.inf, np.inf
        if len(points) > _SEARCHED:
            half = _SEARCHED / len(points) / 2
            low, high = np.quantile(sample[:, axis], (0.5 - half, 0.5 + half)).tolist()
        crowd = _some(_within(points, axis, low, high), _POINTS)
        return cls(message, sample, axis, low, high, crowd)

    def has_twins(self, points: Float64, *, shifted: bool) -> bool:
        """Return whether most points of the crowd have a twin among others, float64 (N, 3).

        With `shifted` also whether they have, once all are moved by the same shift.
        """
        from mlscli.runtime.tree import Tree

        others = _measured(_within(points, self.axis, self.low, self.high))
        if len(others) < 2 or not len(self.crowd):
            return False
        tree = Tree(others)
        count = min(_SHIFTS if shifted else 2, len(others))
        distances, nearest = tree.nearest(self.crowd, count)
        has_twins = _are_twins(distances)
        if has_twins or not shifted:
            return has_twins
        # All may have moved by more than they are apart, and then alike.
        shifts = (others[nearest] - self.crowd[:, None]).reshape(-1, 3)
        alike = _ALIKE * float(np.median(distances[:, -1]))
        counts = Tree(shifts).counts(shifts, alike)
        off = np.sqrt(np.square(shifts - shifts[np.argmax(counts)]).sum(axis=1))
        return _are_twins(tree.nearest(self.crowd + shifts[off <= alike].mean(axis=0), 2)[0])


def _are_twins(distances: Float64) -> bool:
    """Return whether most points have a twin, given the distances (N, K) of nearest to each."""
    return bool(np.mean(distances[:, 0] <= _NEAR * distances[:, 1]) >= _MOST)


def _within(points: Float64, axis: int, low: float, high: float) -> Float64:
    """Return the points (N, 3) one of whose coordinates is within bounds."""
    along = points[:, axis]
    # Rows by number, in a third of the time of a mask.
    return points.take(np.flatnonzero((along >= low) & (along <= high)), axis=0)


def _is_in_order(before: Float64, after: Float64) -> bool:
    """Return whether the points of two messages at one index are the same that have moved."""
    last = min(len(before), len(after)) - 1
    rows = np.linspace(0, last - 1, min(_POINTS, last)).astype(np.int64)
    three = np.stack((before[rows], after[rows], before[rows + 1]))
    here, there, beside = three[:, (np.abs(three) <= FARTHEST).all(axis=(0, 2))]
    if not len(here):
        return False
    moved, apart = (np.abs(other - here).max(axis=1) for other in (there, beside))
    return bool(np.median(moved) <= _NEAR * np.median(apart))


def _lies_elsewhere(last: Float64, samples: list[Float64]) -> bool:
    """Return whether a message covers the points of others, and its surfaces have moved.

    Parameters
    ----------
    last : float64 (N, 3)
    samples : list of float64 (M, 3)
        Points of each of the others.
    """
    from mlscli.runtime.tree import Tree

    if len(last) < _FEWEST:
        return False
    tree = Tree(last)
    low, high = np.quantile(_some(last, 16 * _POINTS), (0.01, 0.99), axis=0)
    around = _AROUND * float((high - low).max())
    # In a plane the sixteenth neighbour is twice as far as the fourth. Where points lie on lines,
    # as the sweeps of a laser do, only those farther away tell how far the lines are apart.
    rank = min(64, len(last) // 4)
    covered, moved = list[float](), list[bool]()
    for sample in samples:
        distances, near = tree.nearest(sample, _PLANE)
        nearest = distances[:, 0]
        spacing = tree.nearest(last[near[:, 0]], rank + 1)[0][:, -1] * np.sqrt(16 / rank)
        covered.append(float(np.mean(nearest <= around)))
        together, known = _moved_together(sample, last[near], spacing)
        # What is not covered is not known to have moved.
        apart = np.mean((nearest > spacing) & (nearest <= around)) >= _MOVED
        beside = together.sum() >= _MOVED * max(int(known.sum()), _PLANE)
        moved.append(bool(covered[-1] >= _COVERED and (apart or beside)))
    return bool(np.median(covered) >= _COVERED and np.mean(moved) >= _MESSAGES)


def _moved_together(sample: Float64, around: Float64, spacing: Float64) -> tuple[Bool, Bool]:
    """Return which points lie to one side of a surface, together with those beside them.

    Parameters
    ----------
    sample : float64 (M, 3)
    around : float64 (M, K, 3)
        The points of the surface that are nearest to each.
    spacing : float64 (M,)
        How far these are apart.

    Returns
    -------
    moved, known : bool (M,)
        Whether each has moved, and whether that can be told.
    """
    from mlscli.runtime.tree import Tree

    middles, normals, trust, _ = fit_planes(around)
    axis: Int64 = np.abs(normals).argmax(axis=1)
    normals = normals * np.sign(np.take_along_axis(normals, axis[:, None], axis=1))
    aside = ((sample - middles) * normals).sum(axis=1)
    beside = Tree(sample).nearest(sample, _TOGETHER)[1]
    alike = (axis[beside] == axis[:, None]) & (trust[beside] >= _FLAT)
    known = alike.sum(axis=1) >= _AGREEING
    several = np.where(alike, aside[beside], np.nan)[known]
    mean = np.nanmean(several, axis=1)
    error = np.nanstd(several, axis=1, ddof=1) / np.sqrt(alike[known].sum(axis=1))
    moved = np.zeros(len(sample), dtype=np.bool_)
    moved[known] = (np.abs(mean) > _ASIDE * spacing[known]) & (np.abs(mean) > _SIGNIFICANT * error)
    return moved, known


def _measured(points: Float64) -> Float64:
    """Return the points (N, 3) that are finite and not beyond `FARTHEST`."""
    return points if all_measured(points) else points[(np.abs(points) <= FARTHEST).all(axis=1)]


def _some(points: Float64, most: int) -> Float64:
    """Return at most so many points (M, 3) from all over a message, float64 (N, 3)."""
    return points if len(points) <= most else points[spread(len(points), most)]
