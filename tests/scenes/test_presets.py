"""The scenes by name: what each is said to hold, and what they refuse.

Ways to pass without being right: names without scenes; a dimension that changes nothing.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from mlscli.errors import UsageError
from mlscli.maps.surface_map import SurfaceMap
from mlscli.scenes.presets import SCENE_PRESETS, Preset, make, preset
from mlscli.scenes.surfaces import Scene, edges
from mlscli.scenes.truth import truth


def true_map(name: str, add_param: float | None = None) -> SurfaceMap:
    return truth(make(name, add_param), 0.15, 0.5, 0.15)


def levels(surface: SurfaceMap, x: float, y: float) -> list[float]:
    """Return the heights at a place."""
    here = (surface.ix == np.floor(x / 0.15)) & (surface.iy == np.floor(y / 0.15))
    return [round(height, 6) for height in surface.height[here].tolist()]


def test_the_thesis_s_numbers_are_names() -> None:
    names = ["bridge", "bridge-walls", "house", "planes", "planes-walls"]
    assert [preset(str(number)).name for number in range(1, 6)] == names
    assert make("1") == make("bridge")


@pytest.mark.parametrize("each", SCENE_PRESETS, ids=lambda each: each.name)
def test_floors_end_on_edges_of_the_thesis_s_cells_and_walls_stand_in_their_middle(
    each: Preset,
) -> None:
    scene = make(each.name)
    for surface in scene.surfaces:
        corner, along, across = edges([surface])
        if surface.upright:
            along_x = surface.along[1] == 0
            place = corner[0, 1] if along_x else corner[0, 0]
            assert place / 0.15 % 1 == pytest.approx(0.5)
        elif each.name != "stair":
            ends = np.concatenate((corner, corner + along + across))[:, :2] / 0.15
            assert ends == pytest.approx(np.round(ends))


def test_the_dimension_of_a_scene_is_the_one_it_names() -> None:
    for height in (1.0, 3.0):
        assert levels(true_map("bridge", height), 0.01, 0.01) == [0.0, height]
        assert levels(true_map("bridge-walls", height), 0.01, 0.01) == [0.0, height]
    for offset in (0.6, 1.8):
        assert levels(true_map("planes", offset), 0.01, 0.01) == [offset]
        assert levels(true_map("planes-walls", offset), 0.01, 0.01) == [offset]
    for diameter in (0.4, 0.9):
        ground, wall = make("house", diameter).surfaces[:2]
        for a_low, a_high, b_low, b_high in (*ground.openings, *wall.openings):
            assert (a_high - a_low, b_high - b_low) == pytest.approx((diameter, diameter))


def test_the_house_has_a_hole_in_its_ground_and_one_in_its_wall() -> None:
    true = true_map("house")
    assert levels(true, 0.01, -1.51) == []
    assert levels(true, 0.01, -0.5) == [0.0]
    assert len(levels(true, 0.01, 0.975)) == 2
    assert len(levels(true, -1.2, 0.975)) == 1


def test_only_the_scene_with_walls_has_walls() -> None:
    assert not (true_map("planes").depth > 0).any()
    assert np.count_nonzero(true_map("planes-walls").depth > 0) == 80


def test_storeys_decks_galleries_and_tunnels_are_levels() -> None:
    assert levels(true_map("house-storeys"), 0.01, 1.01) == [0.0, 1.2, 2.4]
    assert levels(true_map("parking"), 0.01, -1.01) == [0.0, 1.2, 2.4]
    assert levels(true_map("stair"), 2.5, 1.51) == [0.0, 1.08]
    assert levels(true_map("tunnel"), 0.01, 0.01) == [0.0, 1.2, 1.8]
    assert levels(true_map("tunnel"), 0.01, 1.51) == [1.8]
    assert levels(true_map("street"), 3.3, 0.01) == [0.0, 3.6]
    assert levels(true_map("village-thesis"), 0.01, 0.01) == [-0.9, 0.0]
    assert levels(true_map("table"), 0.01, 0.01) == [0.0, 0.75]


def test_the_gym_has_features_on_its_bands_and_a_window_at_its_end() -> None:
    scene = make("gym")
    bands = [s for s in scene.surfaces if s.texture == 1]
    bare = [s for s in scene.surfaces if s.texture < 0.1]
    assert (len(bands), len(bare)) == (2, 3)
    assert levels(true_map("gym"), 5.93, 0.01) == [0.9, 2.1]


def test_the_gap_beside_the_bridge_is_truly_deck() -> None:
    assert levels(true_map("bridge-gap"), 0.01, 0.61) == [-0.9, 0.0]
    assert levels(true_map("bridge-gap"), 0.01, 1.2) == [-0.3]


def test_a_village_has_as_many_houses_as_asked_for() -> None:
    for size in (1, 3, 10):
        scene = make("village", size=size)
        assert len(scene.surfaces) == 6 * size**2
        low, high = scene.bounds
        assert (high - low)[:2] == pytest.approx((4.5 * size, 4.5 * size))
    assert isinstance(make("village"), Scene)


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("brigde",), "did you mean bridge"),
        (("None",), "`type_` None"),
        (("6",), "`type_` 6"),
        (("bridge", 0.5), "height of the bridge"),
        (("bridge", float("nan")), "`add_param` nan"),
        (("house", 1.3), "at most 1.2"),
        (("table", 1.0), "table has none"),
        (("village", 1.0), "`size`"),
        (("bridge", None, 3), "`size` 3"),
        (("village", None, 0), "`size` 0"),
        (("village", None, 501), "`size` 501"),
    ],
)
def test_what_a_scene_does_not_take_is_refused(arguments: tuple[Any, ...], named: str) -> None:
    with pytest.raises(UsageError, match=named):
        make(*arguments)
