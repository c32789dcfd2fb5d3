"""Places from all over a list, for a look at some of what it holds."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from mlscli.runtime.arrays import Float64, Int64


@lru_cache(maxsize=64)
def spread(count: int, size: int) -> Int64:
    """Return places in a list of `count`, one in each of `size` equal parts, where by chance.

    What is left out of a list in regular steps is hit like the rest.

    Parameters
    ----------
    count : int
        At least `size`.
    size : int

    Returns
    -------
    int64 (size,)
        Ascending; read-only.
    """
    places = (_shifted(size) * (count / size)).astype(np.int64)
    places.setflags(write=False)
    return places


@lru_cache(maxsize=8)
def _shifted(size: int) -> Float64:
    """Return the whole numbers from 0, each with a share added by chance, (size,)."""
    return np.arange(size) + np.random.default_rng(0).random(size)
