"""What would be seen of places, held against every patch as a box.

How one could cheat: to step over thin patches, so level ones of no height stand in the way; to
look along x only, so lines run everywhere; to be stopped by the cell of the place itself.
"""

from __future__ import annotations

from dataclasses import replace

import hypothesis.strategies as st
import numpy as np
from hypothesis import given

from mlscli.maps.surface_map import SurfaceMap
from mlscli.queries.sights import Hiding, in_sight, refuted
from mlscli.runtime.arrays import Float64
from tests.helpers.lines import free_space_of
from tests.helpers.maps import CELL, Patch, map_of, random_map


def is_clear(surface: SurfaceMap, view: Float64, place: Float64) -> bool:
    """Return whether a line meets no patch up to a cell before its end: box by box."""
    way = place - view
    share = max(1 - CELL / float(np.linalg.norm(way)), 0.0)
    for patch in range(surface.size):
        begin, end = 0.0, share
        for axis, index in ((0, surface.ix[patch]), (1, surface.iy[patch])):
            sides = (np.array([index, index + 1]) * CELL - view[axis]) / way[axis]
            begin, end = max(begin, sides.min()), min(end, sides.max())
        z = np.sort(view[2] + np.array([begin, end]) * way[2])
        if begin < end and z[0] <= surface.height[patch] and z[1] >= surface.low_end[patch]:
            return False
    return True


@given(st.integers(0, 2**32))
def test_lines_are_stopped_by_the_boxes_that_they_meet(seed: int) -> None:
    rng = np.random.default_rng(seed)
    surface = random_map(rng)
    if not surface.size:
        return
    middle = np.array([surface.ix.mean() * CELL, surface.iy.mean() * CELL, 1.0])
    views, places = middle + rng.normal(0, 2.0, (2, 4, 3))
    reach = 4.0
    seen = in_sight(Hiding.of(surface, 2), CELL, views, places, reach)
    for v, view in enumerate(views):
        for n, place in enumerate(places):
            right = np.linalg.norm(place - view) <= reach and is_clear(surface, view, place)
            assert seen[v, n] == right


def test_level_patches_hide_and_the_cell_of_the_place_does_not() -> None:
    floor = map_of([Patch(ix, 0, 0.0, 0.0, 0, 5) for ix in range(-9, 9)])
    hiding = Hiding.of(floor, 2)
    above, on, below = np.array([[0.1, 0.2, 2.0], [2.3, 0.2, 0.0], [0.3, 0.2, -2.0]])
    assert in_sight(hiding, CELL, above[None], np.stack((on, below)), 9.0).tolist() == [
        [True, False]
    ]
    assert not in_sight(hiding, CELL, above[None], on[None], 2.0).any()


def test_a_guess_that_lines_refute_hides_nothing() -> None:
    patches = [Patch(0, 0, 2.0, 2.0, 2, 0), Patch(2, 0, 2.0, 2.0, 2, 0), Patch(4, 0, 2, 2, 0, 5)]
    through = {(ix, 0, iz): 2 for ix in (0, 4) for iz in range(9)}
    through |= {(2, 0, iz): 2 for iz in range(9) if iz != 5}
    surface = replace(map_of(patches), free=free_space_of(through))
    assert refuted(surface, 2).tolist() == [True, False, False]
    assert not refuted(surface, 3).any()
    assert not refuted(replace(surface, free=None), 2).any()
    hiding = Hiding.of(surface, 2)
    west, places = np.array([[-1.0, 0.2, 1.0]]), np.array([[0.9, 0.2, 1.0], [1.9, 0.2, 1.0]])
    assert in_sight(hiding, CELL, west, places, 9.0).tolist() == [[True, False]]
