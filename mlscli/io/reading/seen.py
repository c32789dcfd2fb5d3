"""The exact set of points seen before, for maps that are published again and again.

Coordinates are compared bit for bit, in a hash table of 40 to 80 bytes a point. It doubles when
it is full, so that the cost of a point does not depend on how many came before.
"""

from __future__ import annotations

import numpy as np

from mlscli.runtime.arrays import Bool, Float64, Int64, UInt64
from mlscli.runtime.kernels import kernel

_FREE = -1
_FACTORS = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], dtype=np.uint64)


class SeenPoints:
    """A growing set of points."""

    def __init__(self) -> None:
        self._points = np.empty((512, 3), dtype=np.uint64)
        self._slots = np.full(1024, _FREE, dtype=np.int64)
        self._size = 0

    def add(self, points: Float64) -> Bool:
        """Add points to the set, and return which of them are new.

        Parameters
        ----------
        points : float64 (N, 3)
            Free of -0.0.

        Returns
        -------
        bool (N,)
            False where a point was added before, or stands earlier in `points`.
        """
        bits = np.ascontiguousarray(points).view(np.uint64)
        fresh = np.empty(len(bits), dtype=np.bool_)
        self._reserve(self._size + len(bits))
        self._size = _enter(bits, self._points, self._slots, self._size, fresh)
        return fresh

    def _reserve(self, size: int) -> None:
        """Make room for `size` points in all, with at most half of the slots taken."""
        if size <= len(self._points):
            return
        room = 1 << (size - 1).bit_length()
        known = self._points[: self._size]
        self._points = np.empty((room, 3), dtype=np.uint64)
        self._slots = np.full(2 * room, _FREE, dtype=np.int64)
        _enter(known, self._points, self._slots, 0, np.empty(len(known), dtype=np.bool_))


@kernel
def _enter(new: UInt64, points: UInt64, slots: Int64, size: int, fresh: Bool) -> int:
    """Add the new ones of some points to a hash table; return its new size.

    Parameters
    ----------
    new : uint64 (N, 3)
        The bits of the coordinates.
    points : uint64 (R, 3)
        The points of the table, of which the first `size` are in use; added to.
    slots : int64 (S,)
        Index of the point in each slot, or `_FREE`; S is a power of two. Added to.
    size : int
    fresh : bool (N,)
        Overwritten: whether each point was not in the table before.
    """
    last = np.uint64(len(slots) - 1)
    for row in range(len(new)):
        key = np.uint64(0)
        for axis in range(3):
            key = (key ^ new[row, axis]) * _FACTORS[axis]
            key ^= key >> np.uint64(32)
        slot = key & last
        while slots[slot] != _FREE:
            known = points[slots[slot]]
            if known[0] == new[row, 0] and known[1] == new[row, 1] and known[2] == new[row, 2]:
                break
            slot = (slot + np.uint64(1)) & last
        fresh[row] = slots[slot] == _FREE
        if fresh[row]:
            slots[slot] = size
            for axis in range(3):
                points[size, axis] = new[row, axis]
            size += 1
    return size
