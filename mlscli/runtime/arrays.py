"""Names for the array types that signatures use."""

from __future__ import annotations

from typing import Any, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[Any]
Float32: TypeAlias = NDArray[np.float32]
Float64: TypeAlias = NDArray[np.float64]
Int32: TypeAlias = NDArray[np.int32]
Int64: TypeAlias = NDArray[np.int64]
UInt8: TypeAlias = NDArray[np.uint8]
UInt32: TypeAlias = NDArray[np.uint32]
UInt64: TypeAlias = NDArray[np.uint64]
Bool: TypeAlias = NDArray[np.bool_]


def frozen(array: Array) -> Array:
    """Return an array that cannot be written to.

    The columns of maps are such. What else is given to a kernel that takes columns is frozen, too:
    for writable arrays it would be compiled once more.
    """
    if array.flags.writeable:
        array = array[:]
        array.setflags(write=False)
    return array


# Counters in kernels begin with these: for literals, kernels would be compiled once more.
ZERO, ONE = cast(int, np.int64(0)), cast(int, np.int64(1))


def repeated(counts: Int64) -> tuple[Int64, Int64]:
    """Return each number as often as it is counted, and which of its repeats each is.

    Parameters
    ----------
    counts : int64 (N,)

    Returns
    -------
    which : int64 (M,)
        ``counts[0]`` times 0, ``counts[1]`` times 1, and so on.
    place : int64 (M,)
        0, 1, ... up to ``counts[i] - 1`` for each i.

    Examples
    --------
    >>> import numpy as np
    >>> repeated(np.array([2, 0, 3]))
    (array([0, 0, 2, 2, 2]), array([0, 1, 0, 1, 2]))
    """
    which = np.repeat(np.arange(len(counts)), counts)
    return which, np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts, counts)
