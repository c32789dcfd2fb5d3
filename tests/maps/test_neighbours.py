"""Neighbours of cells, against a dictionary of all of them.

How one could cheat: cells without gaps, or away from the ends of int32.
"""

from __future__ import annotations

from bisect import bisect_left

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from mlscli.maps.cells import GREATEST_INDEX, LEAST_INDEX
from mlscli.maps.neighbours import beside, is_at, links, shifted, sought
from mlscli.runtime.arrays import Int32

index = st.integers(-3, 3) | st.integers(GREATEST_INDEX - 2, GREATEST_INDEX) | st.just(LEAST_INDEX)
cells = st.sets(st.tuples(index, index), min_size=1, max_size=20).map(sorted)


def columns(listed: list[tuple[int, int]]) -> tuple[Int32, Int32]:
    ix, iy = np.array(listed, dtype=np.int32).T.copy()
    return ix, iy


@given(listed=cells, dx=st.integers(-2, 2), dy=st.integers(-2, 2))
def test_a_shifted_cell_is_found_where_there_is_one(
    listed: list[tuple[int, int]], dx: int, dy: int
) -> None:
    number = {cell: n for n, cell in enumerate(listed)}
    expected = [number.get((x + dx, y + dy), -1) for x, y in listed]
    assert shifted(*columns(listed), dx, dy).tolist() == expected
    assert not any(is_at(*columns(listed), n, *listed[0]) for n in (-1, len(listed)))


@given(listed=cells, asked=st.tuples(index, index))
def test_the_first_cell_not_before_another_is_sought_from_wherever(
    listed: list[tuple[int, int]], asked: tuple[int, int]
) -> None:
    first = bisect_left(listed, asked)
    for begin in range(-1, first + 1):
        assert sought(*columns(listed), begin, *asked) == first


@given(listed=cells)
def test_the_four_beside_are_those_that_share_an_edge(listed: list[tuple[int, int]]) -> None:
    number = {cell: n for n, cell in enumerate(listed)}
    four = [[(x - 1, y), (x + 1, y), (x, y - 1), (x, y + 1)] for x, y in listed]
    assert beside(*columns(listed)).tolist() == [[number.get(c, -1) for c in row] for row in four]


@given(listed=cells)
def test_links_lead_to_the_next_of_the_column_and_of_the_row(
    listed: list[tuple[int, int]],
) -> None:
    number = {cell: n for n, cell in enumerate(listed)}

    def next_of(cell: tuple[int, int], axis: int, way: int) -> int:
        ahead = [
            other
            for other in listed
            if other[1 - axis] == cell[1 - axis] and way * other[axis] > way * cell[axis]
        ]
        return number[min(ahead, key=lambda other: way * other[axis])] if ahead else -1

    after, before, after_in_row, before_in_row = (
        found.tolist() for found in links(*columns(listed))
    )
    for found, axis, way in (
        (after, 1, 1), (before, 1, -1), (after_in_row, 0, 1), (before_in_row, 0, -1)
    ):  # fmt: skip
        assert found == [next_of(cell, axis, way) for cell in listed]
