"""Space that nobody looked into, under decks and behind windows.

How one could cheat: to call all space without lines unseen, also that in the ground and above the
site, so slopes and cliffs must give nothing; to look only between two levels of a cell, so roofs
stand over ground that nobody saw; to go on through walls, so closed houses must give nothing; to
go by single voxels, so lines that miss a few of them are enough.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from mlscli.maps.surface_map import SurfaceMap
from mlscli.queries.under import Unseen, never_looked_into
from tests.helpers.lines import free_space_of
from tests.helpers.maps import CELL, Patch, map_of

HALF = CELL / 2
# The roof covers cells 0 to 3 of a floor from -4 to 7, in x and in y.
ROOF, SIDE, WIDE = 3.0, range(4), range(-4, 8)


def site(is_wall: Callable[[int, int], bool], *, floor: bool = False) -> SurfaceMap:
    """Return a floor with a roof over its middle, on walls, all seen but what is under the roof."""
    patches: list[Patch] = []
    lines: dict[tuple[int, int, int], int] = {}
    for ix in WIDE:
        for iy in WIDE:
            under = ix in SIDE and iy in SIDE
            wall = under and is_wall(ix, iy)
            if wall:
                patches.append(Patch(ix, iy, ROOF, ROOF, 0, 9))
            elif under:
                patches.append(Patch(ix, iy, ROOF, 0.0, 0, 9))
            if not under or (floor and not wall):
                patches.append(Patch(ix, iy, 0.0, 0.0, 0, 9))
            low = 13 if under else 1
            lines |= {(ix, iy, iz): 2 for iz in range(low, 30)}
    return replace(map_of(patches), free=free_space_of(lines))


def cells(found: Unseen) -> set[tuple[int, int]]:
    return set(zip(found.ix.tolist(), found.iy.tolist(), strict=True))


def ring(ix: int, iy: int) -> bool:
    return ix in (0, 3) or iy in (0, 3)


ALL = {(ix, iy) for ix in SIDE for iy in SIDE}


@pytest.mark.parametrize("floor", [False, True])
def test_under_a_roof_on_nothing_it_is_unseen_from_floor_to_roof(floor: bool) -> None:
    found = never_looked_into(site(lambda *_: False, floor=floor))
    assert cells(found) == ALL
    # But for what lies within two voxels of a level.
    assert found.low == pytest.approx(3 * HALF)
    assert found.high == pytest.approx(ROOF - 2 * HALF)


def test_nobody_asks_what_is_in_a_house_without_openings() -> None:
    assert not len(never_looked_into(site(ring)).ix)


def test_behind_a_door_the_whole_room_is_unseen() -> None:
    found = never_looked_into(site(lambda ix, iy: ring(ix, iy) and (ix, iy) != (0, 1)))
    assert cells(found) == {(0, 1), (1, 1), (1, 2), (2, 1), (2, 2)}


def test_a_look_settles_what_it_passes_through() -> None:
    surface = site(lambda *_: False)
    seen = {(ix, iy, iz): 2 for ix in (0, 1) for iy in SIDE for iz in range(1, 12)}
    assert surface.free is not None
    looked = replace(surface, free=surface.free.union(free_space_of(seen)))
    assert cells(never_looked_into(looked)) == {(ix, iy) for ix in (2, 3) for iy in SIDE}
    once = dict.fromkeys(seen, 1)
    looked = replace(surface, free=surface.free.union(free_space_of(once)))
    assert cells(never_looked_into(looked)) == ALL
    assert not cells(never_looked_into(looked, least=1)) & {(0, 1), (1, 1)}


@pytest.mark.parametrize(("missing", "is_unseen"), [(5, False), (6, True)])
def test_lines_that_miss_a_few_voxels_are_enough(missing: int, is_unseen: bool) -> None:
    surface = site(lambda *_: False, floor=True)
    seen = {(ix, iy, iz): 2 for ix in SIDE for iy in SIDE for iz in range(1, 12)
            if (ix, iy) != (1, 1) or iz not in range(3, 3 + missing)}  # fmt: skip
    assert surface.free is not None
    looked = replace(surface, free=surface.free.union(free_space_of(seen)))
    assert cells(never_looked_into(looked)) == ({(1, 1)} if is_unseen else set())


@pytest.mark.parametrize("rise", [0.1, 0.5, 3.0])
def test_slopes_and_cliffs_are_no_roofs(rise: float) -> None:
    patches = [Patch(ix, iy, rise * max(ix, 0), 0.0, 0, 9) for ix in WIDE for iy in WIDE]
    surface = map_of(patches)
    lines = {
        (ix, iy, iz): 2
        for ix, iy, height in zip(surface.ix, surface.iy, surface.height, strict=True)
        for iz in range(int(height / HALF) + 1, int(height / HALF) + 5)
    }
    assert not len(never_looked_into(replace(surface, free=free_space_of(lines))).ix)


def test_it_does_not_depend_on_the_directions_of_the_grid() -> None:
    def door(ix: int, iy: int) -> bool:
        return ring(ix, iy) and (ix, iy) != (3, 2)

    found = never_looked_into(site(door))
    turned = never_looked_into(site(lambda ix, iy: door(iy, ix)))
    assert cells(turned) == {(iy, ix) for ix, iy in cells(found)}
    assert len(found.ix) == 5


def test_a_map_that_does_not_know_what_was_seen_tells_nothing() -> None:
    blind = replace(site(lambda *_: False), free=None)
    assert not len(never_looked_into(blind).ix)
    empty = replace(map_of([]), free=free_space_of({}))
    assert not len(never_looked_into(empty).ix)
    assert np.array_equal(never_looked_into(empty).low, [])
