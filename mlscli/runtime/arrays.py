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
