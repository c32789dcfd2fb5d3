"""Points that coincide: what a sensor reports where it has measured nothing.

Many drivers and exports leave (0, 0, 0) there, whatever the frame, and many nodes move it with the
other points. Measured points seldom have the same coordinates, to the last bit, and where they do,
as the corners of triangles or those of a coarse grid, others do as often.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from mlscli.io.plausibility.finding import Finding, doubted, right
from mlscli.io.plausibility.places import spread
from mlscli.runtime.arrays import Bool, Float64

_FEWEST, _SHARE = 3, 0.01
"""So many points at exactly (0, 0, 0), and this share of the cloud, are no single point."""

_FEWEST_ELSEWHERE, _SHARE_ELSEWHERE = 10, 0.05
"""The same of another place, which a sample must show."""

_OFTENER = 5
"""A pile has so many times the points of other places."""

_SAMPLE = 64
"""Points that are compared with each other."""

_ALL, _GLANCE = 4096, 1024
"""Of more points than the first, so many as the second are looked at to begin with: zeros that pile
up are missed once in 30,000 times where they are as few as can be."""


def without_zeros(points: Float64) -> Finding[Bool]:
    """Return which points (N, 3) can be measurements: all, or all but those at (0, 0, 0).

    The latter, doubted, where many are there and others do not coincide alike.
    """
    if _are_apart(points):
        return right(_all(len(points)))
    others = np.asarray((points[:, 0] != 0) | (points[:, 1] != 0) | (points[:, 2] != 0))
    zeros = len(points) - int(np.count_nonzero(others))
    if zeros < max(_FEWEST, _SHARE * len(points)) or zeros < _OFTENER * _alike(points[others]):
        return right(_all(len(points)))
    return doubted(others, "points at exactly (0, 0, 0) pile up and are no measurements")


def pile(points: Float64) -> Finding[int]:
    """Return how many points (N, 3) lie at one place, in doubt; 0 where none pile up."""
    some = points[:: max(1, len(points) // _SAMPLE)]
    order = np.lexsort(some.T)
    some = some[order]
    (equal,) = np.nonzero((some[1:] == some[:-1]).all(axis=1))
    if not len(equal):
        return right(0)
    place = some[equal[len(equal) // 2]]
    here = (points == place).all(axis=1)
    count = int(np.count_nonzero(here))
    least = max(_FEWEST_ELSEWHERE, _SHARE_ELSEWHERE * len(points), _OFTENER * _alike(points[~here]))
    if count < least:
        return right(0)
    x, y, z = (f"{number:.6g}" for number in place.tolist())
    return doubted(count, f"points pile up at ({x}, {y}, {z}) exactly")


@lru_cache(maxsize=4)
def _all(count: int) -> Bool:
    """Return True for so many points, read-only: messages mostly have as many as the one before."""
    kept = np.ones(count, dtype=np.bool_)
    kept.setflags(write=False)
    return kept


def _are_apart(points: Float64) -> bool:
    """Return whether no point that is looked at lies at zero; the first coordinate mostly tells."""
    first, places = points[:, 0], None
    if len(points) > _ALL:
        places = spread(len(points), _GLANCE)
        first = first[places]
    if np.count_nonzero(first) == len(first):
        return True
    (rows,) = np.nonzero(first == 0)
    return bool(points[rows if places is None else places[rows]].any(axis=1).all())


def _alike(points: Float64) -> int:
    """Return how many of the first points coincide at most; 1 where none do."""
    some = points[: 16 * _SAMPLE]
    counts = np.unique(some, axis=0, return_counts=True)[1] if len(some) else np.ones(1)
    return int(counts.max())
