"""Sorting and searching within kernels, against numpy's.

How one could cheat: to sort values alone, so what goes along is numbered; to let equal values
change places, so few different values are drawn; to search where none is equal.
"""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from mlscli.runtime.arrays import Array, Float64, Int64
from mlscli.runtime.kernels import kernel
from mlscli.runtime.sorting import place_of, sort_along

SOME = st.lists(st.integers(-5, 5).map(float), max_size=70)


@kernel
def ordered(values: Float64) -> tuple[Float64, Int64, Float64]:
    along, numbers, alone = values.copy(), np.arange(len(values)), values.copy()
    sort_along(along, numbers)
    sort_along(alone, alone)
    return along, numbers, alone


@kernel
def places(values: Float64, sought: Float64) -> Array:
    found = np.empty(len(sought), dtype=np.int64)
    for i in range(len(sought)):
        found[i] = place_of(values, sought[i])
    return found


@given(SOME)
def test_values_ascend_and_equal_ones_keep_their_order(drawn: list[float]) -> None:
    values = np.array(drawn, dtype=np.float64)
    along, numbers, alone = ordered(values)
    assert numbers.tolist() == np.argsort(values, kind="stable").tolist()
    assert along.tolist() == alone.tolist() == sorted(drawn)


@given(SOME, SOME)
def test_a_place_is_the_first_that_is_not_less(drawn: list[float], sought: list[float]) -> None:
    values, asked = np.array(sorted(drawn), dtype=np.float64), np.array(sought, dtype=np.float64)
    assert places(values, asked).tolist() == np.searchsorted(values, asked).tolist()
