"""Surfaces and the building blocks: where they lie, and what is refused.

Ways to pass without being right: sizes along the slope instead of seen from above; a wall whose
orientation is turned the other way round; scenes that survive JSON because nobody looks at them.
"""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from mlscli.runtime.arrays import Float64
from mlscli.scenes.parts import floor, inset, ramp, wall, walls
from mlscli.scenes.surfaces import (
    Rectangle,
    Scatter,
    Scene,
    Surface,
    Vector,
    add_horizontal,
    add_vertical,
    scene_from_json,
    scene_to_json,
)
from tests.scenes.scenes import random_scene

EMPTY = Scene("empty")


def corners(surface: Surface) -> Float64:
    corner, along, across = map(np.array, (surface.corner, surface.along, surface.across))
    return np.array([corner, corner + along, corner + along + across, corner + across])


def test_a_horizontal_surface_lies_around_its_position() -> None:
    (surface,) = add_horizontal(EMPTY, (1, 2, 3), (4, 2)).surfaces
    assert corners(surface).tolist() == [[-1, 1, 3], [3, 1, 3], [3, 3, 3], [-1, 3, 3]]


def test_orientation_turns_from_x_towards_y() -> None:
    (surface,) = add_horizontal(EMPTY, (0, 0, 0), (2, 1), orientation=30).surfaces
    assert surface.along == pytest.approx((2 * math.cos(math.pi / 6), 1, 0))
    assert surface.across == pytest.approx((-0.5, math.cos(math.pi / 6), 0))


@pytest.mark.parametrize("turns", [-4, -1, 0, 1, 2, 3, 7])
def test_quarter_turns_are_exact(turns: int) -> None:
    (surface,) = add_vertical(EMPTY, (0.975, 0.975, 1), (2, 1), 90 * turns).surfaces
    on_one_line = corners(surface)[:, 1 if turns % 2 == 0 else 0]
    assert set(on_one_line.tolist()) == {0.975}


def test_grade_rises_along_the_length_seen_from_above() -> None:
    (surface,) = add_horizontal(EMPTY, (0, 0, 1), (4, 2), 90, grade=0.25).surfaces
    assert surface.along == (0, 4, 1)
    assert surface.corner[2] == 0.5
    assert surface.lengths == (math.sqrt(17), 2)


def test_a_vertical_surface_stands_around_its_position() -> None:
    (surface,) = add_vertical(EMPTY, (1, 2, 3), (4, 2), grade=0.5).surfaces
    assert surface.upright
    assert corners(surface).tolist() == [[-1, 2, 1], [3, 2, 3], [3, 2, 5], [-1, 2, 3]]


def test_blocks_pass_on_what_a_surface_has() -> None:
    opening, bare = Rectangle(0, 1, 0, 1), Rectangle(1, 2, 0, 1)
    for add in (add_horizontal, add_vertical):
        (surface,) = add(
            EMPTY, (0, 0, 0), (4, 2), 0, 0, Scatter(0.1, 0.2),
            openings=[opening], texture=0.3, textureless=[bare],
        ).surfaces  # fmt: skip
        assert surface.scatter == (0.1, 0.2)
        assert surface.openings == (opening,)
        assert surface.texture == 0.3
        assert surface.textureless == (bare,)


def test_adding_leaves_the_scene_as_it_was() -> None:
    one = add_horizontal(EMPTY, (0, 0, 0), (1, 1))
    two = add_horizontal(one, (0, 0, 1), (1, 1))
    assert (len(EMPTY.surfaces), len(one.surfaces), len(two.surfaces)) == (0, 1, 2)


@pytest.mark.parametrize(
    ("edges", "fault"),
    [
        (((1, 0, 0), (2, 0, 0)), "area"),
        (((0, 0, 0), (0, 1, 0)), "area"),
        (((math.nan, 0, 0), (0, 1, 0)), "finite"),
        (((0, 0, 1), (1, 0, 0)), "upright"),
        (((1, 0, 0), (0, 0, -1)), "upright"),
    ],
)
def test_what_is_no_surface_is_refused(edges: tuple[Vector, Vector], fault: str) -> None:
    with pytest.raises(ValueError, match=fault):
        Surface((0, 0, 0), *edges)


def test_parts_are_told_by_their_extents() -> None:
    scene = floor(EMPTY, (0, 4), (1, 3), 0.5, openings=[((1, 2), (1.5, 2.5))])
    scene = ramp(scene, (0, 2), (0, 1), (3, 1))
    scene = wall(scene, (2, 0), (2, 3), (1, 2), openings=[((0.5, 1), (1.25, 1.75))])
    level, slope, upright = scene.surfaces
    assert corners(level).tolist() == [[0, 1, 0.5], [4, 1, 0.5], [4, 3, 0.5], [0, 3, 0.5]]
    assert level.openings == ((1, 2, 0.5, 1.5),)
    assert corners(slope)[:, 2].tolist() == [3, 1, 1, 3]
    assert corners(upright).tolist() == [[2, 0, 1], [2, 3, 1], [2, 3, 2], [2, 0, 2]]
    assert upright.openings == ((0.5, 1, 0.25, 0.75),)


def test_a_wall_with_a_grade_begins_at_the_height_told() -> None:
    (surface,) = wall(EMPTY, (0, 0), (2, 0), (0, 1), grade=0.5).surfaces
    assert corners(surface)[:, 2].tolist() == [0, 1, 2, 1]


def test_walls_surround_a_rectangle() -> None:
    scene = walls(EMPTY, (0, 2), (0, 1), (0, 3))
    low, high = scene.bounds
    assert (low.tolist(), high.tolist()) == ([0, 0, 0], [2, 1, 3])
    assert sum(surface.lengths[0] for surface in scene.surfaces) == 6
    assert inset((0, 3), 2) == (0.3, 2.7)


def test_bounds_hold_turned_and_sloping_surfaces() -> None:
    scene = add_horizontal(EMPTY, (0, 0, 0), (2, 2), 45, grade=1)
    low, high = scene.bounds
    root = math.sqrt(2)
    assert low == pytest.approx((-root, -root, -1))
    assert high == pytest.approx((root, root, 1))


def test_a_scene_survives_json_bit_for_bit() -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        scene = random_scene(rng)
        assert any(surface.openings for surface in scene.surfaces)
        back = scene_from_json(json.loads(json.dumps(scene_to_json(scene))))
        assert back == scene


@pytest.mark.parametrize(
    "value",
    [{}, [], {"name": "a"}, {"name": "a", "surfaces": 3}, {"name": "a", "surfaces": [[1, 2]]},
     {"name": "a", "surfaces": [[0.0] * 9 + [[]]]}, {"name": "a", "surfaces": [["x"] * 9 + [[]]]},
     {"name": "a", "surfaces": [[0, 0, 0, 1, 0, 0, 0, 1, 0, [[1, 2]]]]}],
)  # fmt: skip
def test_json_that_is_no_scene_is_refused(value: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=r".+"):
        scene_from_json(value)
