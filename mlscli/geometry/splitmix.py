"""The mixing of bits in S. Vigna's splitmix64: of arrays and, in kernels, of numbers."""

from __future__ import annotations

import numpy as np

from mlscli.runtime.arrays import UInt64

_STEP = np.uint64(0x9E3779B97F4A7C15)
_FIRST, _SECOND = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)


def mixed(key: UInt64) -> UInt64:
    """Return keys mixed: each bit of one changes half of what comes of it."""
    key = key + _STEP
    key = (key ^ (key >> np.uint64(30))) * _FIRST
    key = (key ^ (key >> np.uint64(27))) * _SECOND
    return key ^ (key >> np.uint64(31))
