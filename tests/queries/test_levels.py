"""Levels and heights at places, held against loops over all patches.

Ways to pass without being right: places that all lie in cells with patches, so most lie beside;
middles of cells, so places lie on their sides, too; maps of one level.
"""

from __future__ import annotations

import math

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given

from mlscli import height_at, levels_at
from mlscli.errors import UsageError
from mlscli.maps import cells
from mlscli.maps.surface_map import SurfaceMap
from mlscli.queries import levels
from mlscli.runtime.arrays import Int32, UInt64
from tests.helpers.maps import CELL, Patch, map_of, patches_of

PATCHES = st.lists(
    st.builds(
        Patch,
        ix=st.integers(-2, 2),
        iy=st.integers(-2, 2),
        height=st.integers(-4, 4).map(float),
        depth=st.sampled_from([0.0, 0.5]),
        origin=st.integers(0, 2),
        count=st.integers(1, 3),
        region=st.just(-1),
    ),
    max_size=12,
)
# Halves of a cell: places on the sides of cells are as likely as others.
PLACES = st.lists(st.tuples(st.integers(-7, 7), st.integers(-7, 7)), max_size=9).map(
    lambda halves: np.array(halves, dtype=np.float64).reshape(-1, 2) * CELL / 2
)


def patches_over(surface: SurfaceMap, x: float, y: float) -> list[int]:
    cell = math.floor(x / CELL), math.floor(y / CELL)
    return [n for n, patch in enumerate(patches_of(surface)) if patch.cell == cell]


@given(patches=PATCHES, places=PLACES)
def test_the_levels_of_a_place_are_the_patches_of_its_cell(
    patches: list[Patch], places: np.ndarray
) -> None:
    surface = map_of(patches)
    start, patch = levels_at(surface, places)
    assert len(start) == len(places) + 1
    for n, (x, y) in enumerate(places.tolist()):
        assert patch[start[n] : start[n + 1]].tolist() == patches_over(surface, x, y)


@given(patches=PATCHES, places=PLACES, below=st.integers(-5, 5))
def test_the_height_of_a_place_is_that_of_the_highest_patch_up_to_a_limit(
    patches: list[Patch], places: np.ndarray, below: int
) -> None:
    surface = map_of(patches)
    for limit in (float(below), math.inf):
        found = height_at(surface, places, limit)
        for height, (x, y) in zip(found.tolist(), places.tolist(), strict=True):
            heights = [surface.height[n] for n in patches_over(surface, x, y)]
            right = max((each for each in heights if each <= limit), default=math.nan)
            assert height == right or (math.isnan(height) and math.isnan(right))


def test_every_place_may_have_its_own_limit() -> None:
    deck = map_of([Patch(0, 0, 0.0, 0.0, 0, 1), Patch(0, 0, 3.0, 0.0, 0, 1)])
    places = np.full((3, 2), CELL / 2)
    found = height_at(deck, places, np.array([2.9, 3.0, -0.1]))
    assert found.tolist()[:2] == [0.0, 3.0]
    assert math.isnan(found[2])


def test_beyond_all_cells_there_is_nothing() -> None:
    surface = map_of([Patch(0, 0, 0.0, 0.0, 0, 1)])
    far = np.array([[np.nan, 0.1], [np.inf, 0.1], [1e300, 0.1], [0.1, -(2.0**31) * CELL - 1]])
    assert levels_at(surface, far).start.tolist() == [0] * 5
    assert np.isnan(height_at(surface, far)).all()


@pytest.mark.parametrize("wrong", [np.zeros(2), np.zeros((1, 3)), np.array([["a", "b"]])])
def test_other_arrays_are_refused(wrong: np.ndarray) -> None:
    with pytest.raises(UsageError, match=r"^xy: is an array .* expected numbers \(N, 2\)$"):
        levels_at(map_of([]), wrong)
    with pytest.raises(
        UsageError, match=r"^below: is an array \(3,\), expected a number, or \(2,\)$"
    ):
        height_at(map_of([]), np.zeros((2, 2)), np.zeros(3))


def test_cells_of_many_places_are_packed_by_the_kernel_that_is_compiled_ahead(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # Of arrays with gaps another one would be compiled, while a new user waits.
    packed: list[bool] = []

    def pack(ix: Int32, iy: Int32) -> UInt64:
        packed.append(ix.flags.c_contiguous and iy.flags.c_contiguous)
        return cells.pack(ix, iy)

    monkeypatch.setattr(levels, "pack", pack)
    levels_at(map_of([Patch(0, 0, 1.0, 0.0, 0, 1)]), np.zeros((5, 2)))
    assert packed == [True, True]
