"""How a finished map grew, keyframe by keyframe.

Ways to pass without being right: inserted patches that are there from the beginning, or come at
the end; changes that leave patches out, or tell them twice.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mlscli.maps.surface_map import SurfaceMap
from mlscli.maps.uncovering import appearing, growth
from tests.helpers.maps import Patch, map_of, random_map


def a_row(first: list[int], origin: list[int]) -> SurfaceMap:
    """Return patches side by side along x, with the keyframes that saw them first."""
    patches = [Patch(x, 0, 0.0, 0.0, o, int(o == 0)) for x, o in enumerate(origin)]
    first_keyframe = np.where(np.array(origin) == 0, first, -1).astype(np.int32)
    return replace(map_of(patches), first_keyframe=first_keyframe, last_keyframe=first_keyframe)


def test_a_measured_patch_appears_with_its_first_keyframe() -> None:
    surface = a_row([4, 0, 6], [0, 0, 0])
    assert appearing(surface).tolist() == [4, 0, 6]


def test_an_inserted_patch_appears_with_the_last_of_those_around_it() -> None:
    # The far ones, seen last of all, have no part in it.
    surface = a_row([6, 1, 2, -1, 5, 3, 6], [0, 0, 0, 1, 0, 0, 0])
    assert appearing(surface)[3] == 5


def test_a_map_of_inserted_patches_alone_is_there_from_the_beginning() -> None:
    assert appearing(a_row([-1, -1], [2, 2])).tolist() == [0, 0]
    assert len(appearing(map_of([]))) == 0


@pytest.mark.parametrize("seed", range(20))
def test_growth_tells_every_patch_once_and_in_the_order_of_the_flight(seed: int) -> None:
    surface = random_map(np.random.default_rng(seed))
    grown = surface.take(np.zeros(surface.size, dtype=np.bool_))
    latest = -1
    for change in growth(surface):
        assert change.removed.size == 0
        measured = change.added.first_keyframe[change.added.origin == 0]
        assert (measured > latest).all()
        if len(measured):
            assert len(set(measured.tolist())) == 1
            latest = int(measured[0])
        grown = change.applied_to(grown)
    assert grown == surface
