"""The room around a craft, in gates and under decks whose sizes are known.

How one could cheat: to be right for a craft that flies along x; to swap left and right, or up and
down, so every side is at another distance; to tell of nothing but measured patches; to see through
what nobody saw.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from mlscli.maps.surface_map import SurfaceMap
from mlscli.queries.room import room_at
from tests.helpers.lines import free_space_of
from tests.helpers.maps import CELL, Patch, map_of

# A passage along x: a wall 3 cells to its left, another 5 cells to its right.
LEFT, RIGHT = 3, -6
SIZE = (0.6, 0.4)


def passage(*, swapped: bool = False, deck: int = 0) -> SurfaceMap:
    """Return a passage along x, or along y, with a floor at 0 and a deck at 3."""
    patches = []
    for along in range(-12, 12):
        for aside in range(RIGHT, LEFT + 1):
            cell = (aside, along) if swapped else (along, aside)
            if aside in (LEFT, RIGHT):
                patches.append(Patch(*cell, 3.0, 3.0, 0, 4))
            else:
                patches.append(Patch(*cell, 0.0, 0.0, 0, 4))
                patches.append(Patch(*cell, 3.0, 0.0, deck, 0 if deck else 4))
    return map_of(patches)


def seen_between(low: int, high: int) -> dict[tuple[int, int, int], int]:
    cells = ((ix, iy) for ix in range(-12, 12) for iy in range(-12, 12))
    return {(*cell, iz): 2 for cell in cells for iz in range(low, high)}


def test_each_side_is_as_far_as_it_is() -> None:
    surface = passage()
    begin, end = np.array([-0.1, 0.0, 1.0]), np.array([0.1, 0.0, 1.0])
    rooms = room_at(surface, begin, end, *SIZE)
    assert rooms["up"].distance == pytest.approx(3.0 - 1.2)
    assert rooms["down"].distance == pytest.approx(1.0 - 0.2)
    assert rooms["left"].distance == pytest.approx(LEFT * CELL - 0.3)
    assert rooms["right"].distance == pytest.approx(-(RIGHT + 1) * CELL - 0.3)
    off = 2 * math.sqrt(surface.height_variance[rooms["up"].patch])
    assert rooms["up"].least == pytest.approx(rooms["up"].distance - off)
    assert {room.rests for room in rooms.values()} == {"measured"}
    back = room_at(surface, end, begin, *SIZE)
    assert (back["left"].distance, back["right"].distance) == pytest.approx(
        (rooms["right"].distance, rooms["left"].distance)
    )


def test_left_is_left_along_y_too() -> None:
    # Along y, x runs to the right.
    begin, end = np.array([0.0, -0.1, 1.0]), np.array([0.0, 0.1, 1.0])
    rooms = room_at(passage(swapped=True), begin, end, *SIZE)
    assert rooms["right"].distance == pytest.approx(LEFT * CELL - 0.3)
    assert rooms["left"].distance == pytest.approx(-(RIGHT + 1) * CELL - 0.3)


def test_a_craft_that_reaches_in_has_less_than_no_room() -> None:
    place = np.array([0.0, 0.0, 1.5])
    rooms = room_at(passage(), place, place, 4.0, 3.4)
    assert rooms["up"].distance == pytest.approx(-0.2)
    assert rooms["down"].distance == pytest.approx(-0.2)


def test_what_was_not_seen_ends_the_room_but_for_a_cell_before_what_is_known() -> None:
    surface = passage()
    place = np.array([0.0, 0.0, 1.0])
    seen = replace(surface, free=free_space_of(seen_between(0, 10)))
    assert room_at(seen, place, place, *SIZE)["up"].rests == "measured"
    seen = replace(surface, free=free_space_of(seen_between(0, 8)))
    up = room_at(seen, place, place, *SIZE)["up"]
    assert up.distance == up.least == pytest.approx(8 * CELL / 2 - 1.2, abs=CELL / 2)
    assert (up.rests, up.patch) == ("never seen", -1)
    assert room_at(seen, place, place, *SIZE)["left"].rests == "measured"


@pytest.mark.parametrize(("deck", "rests"), [(1, "plastered"), (2, "artificial")])
def test_it_is_told_what_ends_the_room(deck: int, rests: str) -> None:
    place = np.array([0.0, 0.0, 1.0])
    surface = passage(deck=deck)
    assert room_at(surface, place, place, *SIZE)["up"].rests == rests
    # Lines through an artificial deck show that it is none: up there, nothing is known to be.
    seen = replace(surface, free=free_space_of(seen_between(0, 400)))
    assert room_at(seen, place, place, *SIZE)["up"].rests == {1: rests, 2: "nothing"}[deck]
