"""Sets of cells by strips, against sets of pairs of numbers.

How one could cheat: reaches shorter than a strip; cells that all lie in one strip, or none near
an edge of the grid; sets that are listed twice.
"""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from mlscli.maps.cells import GREATEST_INDEX, LEAST_INDEX, CellSet, pack
from mlscli.maps.strips import Strips
from tests.helpers.cells import cells_in

EDGES = st.sampled_from(
    [LEAST_INDEX, LEAST_INDEX + 40, -33, -1, 0, 31, 32, GREATEST_INDEX - 31, GREATEST_INDEX]
)
INDEX = EDGES | st.integers(-70, 70)
CELLS = st.lists(st.tuples(INDEX, INDEX), max_size=12)
REACH = st.integers(0, 12) | st.sampled_from([31, 32, 33, 70])


@settings(max_examples=35)
@given(CELLS, REACH, st.lists(REACH, max_size=2))
def test_the_strips_of_a_set_hold_its_cells_and_no_others(
    cells: list[tuple[int, int]], reach: int, others: list[int]
) -> None:
    ix, iy = np.array(cells, dtype=np.int64).reshape(-1, 2).T
    narrow = CellSet.of(ix, iy)
    # What was asked for before is used, and changes nothing.
    for other in others:
        narrow.widened(other).strips(10**6)
    strips = narrow.widened(reach).strips(10**6)
    assert strips is not None
    squares = [
        (range(max(x - reach, LEAST_INDEX), min(x + reach, GREATEST_INDEX) + 1),
         range(max(y - reach, LEAST_INDEX), min(y + reach, GREATEST_INDEX) + 1))
        for x, y in cells
    ]  # fmt: skip
    expected = {
        (x - LEAST_INDEX << 32) + y - LEAST_INDEX
        for columns, rows in squares
        for x in columns
        for y in rows
    }
    assert cells_in(strips) == expected
    assert in_order(strips)


@given(CELLS, REACH, CELLS)
def test_a_set_tells_its_cells_in_the_strips_that_it_is_asked_for(
    cells: list[tuple[int, int]], reach: int, asked: list[tuple[int, int]]
) -> None:
    widened = CellSet.of(*np.array(cells, dtype=np.int64).reshape(-1, 2).T).widened(reach)
    listed = widened.strips(10**6)
    assert listed is not None
    numbers = np.unique(pack(*np.array(asked, dtype=np.int64).reshape(-1, 2).T) >> np.uint64(5))
    strips = widened.strips_among(numbers)
    there = np.isin(listed.number, numbers)
    assert strips.number.tolist() == listed.number[there].tolist()
    assert strips.bits.tolist() == listed.bits[there].tolist()


def in_order(strips: Strips) -> bool:
    ascending = bool((strips.number[1:] > strips.number[:-1]).all())
    return ascending and bool(strips.bits.all())
