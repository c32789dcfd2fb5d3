"""Sorting and searching within kernels: numpy's take seconds to compile, once for each type."""

from __future__ import annotations

from typing import Any

import numpy as np

from mlscli.runtime.arrays import Array
from mlscli.runtime.kernels import inner


@inner
def sort_along(values: Array, others: Array) -> None:
    """Sort values in place, ascending, and the elements of another array along with them.

    Equal values keep their order. The other array may be the same as the first.
    """
    size, width = len(values), 1
    spare, spare_others = np.empty_like(values), np.empty_like(others)
    while width < size:
        for begin in range(0, size, 2 * width):
            middle, end = min(begin + width, size), min(begin + 2 * width, size)
            left, right = begin, middle
            for place in range(begin, end):
                if left < middle and (right == end or values[left] <= values[right]):
                    taken, left = left, left + 1
                else:
                    taken, right = right, right + 1
                spare[place], spare_others[place] = values[taken], others[taken]
        for place in range(size):
            values[place], others[place] = spare[place], spare_others[place]
        width *= 2


@inner
def place_of(values: Array, value: Any) -> int:
    """Return the first place in ascending values whose value is not less; their number: none."""
    begin, end = 0, len(values)
    while begin < end:
        middle = (begin + end) // 2
        if values[middle] < value:
            begin = middle + 1
        else:
            end = middle
    return begin
