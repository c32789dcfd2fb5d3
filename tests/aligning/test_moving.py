"""Maps moved onto another grid hold the same points, where these belong.

Ways to pass without being right: to lose points where patches meet in a cell, so they are counted;
to leave the heights, the route or the variance as they were.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mlscli.aligning.moving import moved_map
from mlscli.errors import InputError
from mlscli.geometry.similarity import Similarity
from mlscli.maps.grid import Grid
from mlscli.maps.merging import merge_maps
from mlscli.maps.patches import overlap
from tests.helpers.maps import CELL, GAP, THICKNESS, Patch, map_of, patches_of, random_map

GRID = Grid(CELL, GAP, THICKNESS)


def test_a_shift_by_whole_cells_moves_patches_and_nothing_else() -> None:
    surface = map_of([Patch(0, 0, 1.0, 0.5, 0, 4), Patch(1, 0, 2.0, 0.0, 1, 0)])
    moved = moved_map(surface, Similarity(0.0, 1.0, (2 * CELL, -CELL, 0.25)), GRID)
    moved.check()
    expected = [Patch(2, -1, 1.25, 0.5, 0, 4), Patch(3, -1, 2.25, 0.0, 1, 0)]
    assert patches_of(moved) == expected


def test_what_is_scaled_scales_its_heights_its_variance_and_its_route() -> None:
    surface = map_of([Patch(0, 0, 1.0, 0.5, 0, 4)])
    surface.route.setflags(write=True)
    surface.route[0] = (5.0, 1.0, 2.0, 3.0)
    moved = moved_map(surface, Similarity(np.pi / 2, 2.0, (0.0, 0.0, 1.0)), GRID)
    assert (moved.top[0], moved.bottom[0], moved.variance[0]) == (3.0, 2.0, 0.25)
    assert moved.noise[0] == 4 * surface.noise[0]
    assert np.allclose(moved.route[0], (5.0, -4.0, 2.0, 7.0))


@settings(max_examples=12)
@given(
    st.integers(0, 2**32 - 1),
    st.floats(-4, 4),
    st.floats(0.2, 4),
    st.tuples(*[st.floats(-1e4, 1e4)] * 3),
)
def test_every_point_is_in_the_moved_map_and_it_can_be_merged(
    seed: int, yaw: float, scale: float, shift: tuple[float, float, float]
) -> None:
    surface = random_map(np.random.default_rng(seed))
    moved = moved_map(surface, Similarity(yaw, scale, shift), GRID)
    moved.check()
    measured = moved.take(moved.origin == 0)
    assert measured.count.sum() == surface.count.sum()
    assert not overlap(measured.ix, measured.iy, measured.bottom, measured.top)
    if surface.size:
        assert moved.height.max() == pytest.approx(
            (scale * surface.height + shift[2]).max(), abs=scale * 4 + 1
        )
    merge_maps(moved, map_of([Patch(0, 0, 1.0, 0.5, 0, 4)])).check()


def test_what_comes_to_lie_beyond_all_cells_is_refused() -> None:
    surface = map_of([Patch(0, 0, 1.0, 0.0, 0, 4)])
    with pytest.raises(InputError, match="beyond all cells"):
        moved_map(surface, Similarity(0.0, 1.0, (1e10, 0.0, 0.0)), GRID)
