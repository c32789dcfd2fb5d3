"""Sets of cells, against all pairs of cells.

How one could cheat: cells in order alone, each once; cells so far apart that a reach is never met.
"""

from __future__ import annotations

import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st

from mlscli.maps.cells import GREATEST_INDEX, LEAST_INDEX, CellSet, on_grid, unpack

near = st.integers(-6, 6) | st.sampled_from([LEAST_INDEX, LEAST_INDEX + 1, GREATEST_INDEX])
cells = st.lists(st.tuples(near, near), max_size=12)


@example(listed=[(0, 0)], asked=[(0, 0)], reach=0, in_order=True)
@example(listed=[(0, 0)], asked=[(0, 0), (0, 3)], reach=1, in_order=True)
@example(listed=[(0, 0), (0, 5)], asked=[(0, 0), (0, 5)], reach=0, in_order=True)
@example(listed=[(0, 0)], asked=[(5, 0), (0, 0)], reach=0, in_order=False)
@given(listed=cells, asked=cells, reach=st.integers(0, 3), in_order=st.booleans())
def test_a_set_contains_what_lies_within_its_reach_in_any_order(
    listed: list[tuple[int, int]], asked: list[tuple[int, int]], reach: int, in_order: bool
) -> None:
    asked = sorted(asked) if in_order else asked
    there = np.array(listed, dtype=np.int64).reshape(-1, 2)
    found = np.array(asked, dtype=np.int64).reshape(-1, 2)
    cell_set = CellSet.of(*there.T)
    assert list(zip(*map(np.ndarray.tolist, unpack(cell_set.keys)), strict=True)) == sorted(
        set(listed)
    )
    away = np.abs(there[None] - found[:, None]).max(axis=2, initial=0)
    expected = (away <= reach).any(axis=1)
    assert cell_set.widened(reach).contains(*found.T).tolist() == expected.tolist()


def test_points_are_on_the_grid_up_to_its_last_cell_at_any_height() -> None:
    last = [LEAST_INDEX, LEAST_INDEX + 0.5, GREATEST_INDEX + 0.5, 0.0]
    beyond = [LEAST_INDEX - 0.5, GREATEST_INDEX + 1.0, np.nan, np.inf, -np.inf]
    xyz = np.array([[x, y, 1e300] for x in [*last, *beyond] for y in [*last, *beyond]])
    expected = [x in last and y in last for x in [*last, *beyond] for y in [*last, *beyond]]
    assert on_grid(xyz, 1.0).tolist() == expected
