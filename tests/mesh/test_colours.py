"""Colours by height and origin.

Ways to pass without being right: a scale that is even in numbers but not to the eye, so its steps
are measured in Oklab; a red or green of the scale's own that could be taken for the artificial
or the route.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mlscli.maps.grid import Grid
from mlscli.maps.surface_map import SurfaceMap
from mlscli.mesh.colours import (
    ARTIFICIAL_RED,
    COLOURS,
    PALE,
    ROUTE_GREEN,
    ColourBy,
    Paint,
    from_oklab,
    height_colours,
    height_range,
    height_scale,
    oklab,
    patch_colours,
    region_colours,
    scale_of,
)
from mlscli.runtime.arrays import UInt8
from tests.helpers.maps import Patch, map_of
from tests.helpers.meshes import a_map

# Published pairs of sRGB and Oklab.
KNOWN = {
    (255, 255, 255): (1.0, 0.0, 0.0),
    (255, 0, 0): (0.62796, 0.22486, 0.12585),
    (0, 255, 0): (0.86644, -0.23389, 0.17950),
    (0, 0, 255): (0.45201, -0.03246, -0.31153),
}


def differences(one: UInt8, other: UInt8) -> list[float]:
    found: list[float] = np.linalg.norm(oklab(one) - oklab(other), axis=-1).tolist()
    return found


def test_oklab_gives_the_published_values_and_goes_back() -> None:
    rgb = np.array(list(KNOWN), dtype=np.uint8)
    assert oklab(rgb) == pytest.approx(np.array(list(KNOWN.values())), abs=1e-4)
    every = np.random.default_rng(1).integers(0, 256, (500, 3)).astype(np.uint8)
    assert (from_oklab(oklab(every)) == every).all()


def test_the_scale_has_equal_steps_to_the_eye_but_where_it_turns_at_yellow() -> None:
    scale = height_scale()
    steps = np.array(differences(scale[8::8], scale[:-8:8]))
    assert np.sort(steps)[1] > 0.75 * steps.max()


def test_the_scale_runs_from_blue_over_green_and_yellow_to_brown() -> None:
    scale = height_scale().astype(int)
    low, high = scale[0], scale[-1]
    assert low[2] == max(low)
    assert high[0] > high[1] > high[2]
    assert any(g == max(r, g, b) for r, g, b in scale)
    assert any(min(r, g) > 190 and b < 120 for r, g, b in scale)


def test_nothing_measured_or_plastered_looks_artificial_or_like_the_route() -> None:
    z = np.linspace(0, 1, 999)
    for origin in (0, 1):
        colours = patch_colours(z, np.full(999, origin, dtype=np.uint8), 0, 1)
        for meaning in (ARTIFICIAL_RED, ROUTE_GREEN):
            assert min(differences(colours, np.array(meaning, dtype=np.uint8))) > 0.1


def test_heights_outside_the_range_take_the_end_colours() -> None:
    colours = height_colours(np.array([-9.0, 1.0, 3.0, 99.0]), 1.0, 3.0)
    low, high = height_scale()[0].tolist(), height_scale()[-1].tolist()
    assert colours.tolist() == [low, low, high, high]


def test_where_all_heights_are_one_they_take_the_middle() -> None:
    colours = height_colours(np.array([1.0, 2.0, 3.0]), 2.0, 2.0)
    scale = height_scale()
    assert colours.tolist() == [scale[0].tolist(), scale[128].tolist(), scale[-1].tolist()]


def test_a_few_outliers_do_not_use_up_the_scale() -> None:
    columns = [(x, 0, x / 1000, 0.0) for x in range(1000)]
    low, high = height_range(a_map(*columns, (2000, 0, 1e6, 0.0), (2000, 5, -1e6, 0.0)))
    assert (low, high) == pytest.approx((0.02, 0.98), abs=0.002)


def test_inserted_heights_do_not_move_the_scale_unless_there_is_nothing_else() -> None:
    inserted = [Patch(x, 1, 50.0 + x, 0.0, 2, 0) for x in range(9)]
    measured = [Patch(x, 0, 1.0, 0.0, 0, 1) for x in range(2)]
    assert height_range(map_of([*measured, *inserted])) == (1.0, 1.0)
    assert height_range(map_of(inserted))[0] > 49
    assert height_range(SurfaceMap.of(Grid(1, 1, 1))) == (0.0, 0.0)


def test_plastered_is_half_way_to_white_and_artificial_red() -> None:
    z = np.array([0.5, 0.5, 0.5])
    measured, plastered, artificial = patch_colours(z, np.array([0, 1, 2], np.uint8), 0, 1).tolist()
    assert plastered == [(channel + 255) // 2 for channel in measured]
    assert tuple(artificial) == ARTIFICIAL_RED


def three_kinds() -> SurfaceMap:
    """Return nine measured patches with more points each, a plastered and an artificial one."""
    measured = [Patch(x, 0, x / 9, x / 10, 0, 10 ** (x % 4)) for x in range(9)]
    surface = map_of([*measured, Patch(9, 0, 0.5, 0, 1, 0), Patch(10, 0, 0.5, 0, 2, 0)])
    first = np.where(surface.origin == 0, surface.ix, -1).astype(np.int32)
    route = np.array([(100.0 + t, 0, 0, 0) for t in range(9)])
    return replace(surface, first_keyframe=first, last_keyframe=first, route=route)


def painted(by: ColourBy) -> list[list[int]]:
    surface = three_kinds()
    colours: list[list[int]] = Paint(surface, by)(
        surface, np.arange(surface.size), surface.height
    ).tolist()
    return colours


@pytest.mark.parametrize("by", COLOURS)
def test_artificial_patches_are_red_but_by_region(by: ColourBy) -> None:
    assert (painted(by)[-1] == list(ARTIFICIAL_RED)) == (by != "region")


@pytest.mark.parametrize("by", ["variance", "uncertainty", "count", "time"])
def test_what_nobody_measured_is_pale_where_measurements_are_shown(by: ColourBy) -> None:
    assert painted(by)[-2] == list(PALE)


def test_variances_are_shown_as_standard_deviations_and_times_from_the_first_on() -> None:
    variance, time = scale_of(three_kinds(), "variance"), scale_of(three_kinds(), "time")
    assert variance is not None
    assert variance.value[:9] == pytest.approx([x / 20 for x in range(9)])
    assert time is not None
    assert time.value[:9].tolist() == list(range(9))
    assert "(s)" in time.label


def test_uncertainties_are_shown_as_standard_deviations() -> None:
    surface = three_kinds()
    scale = scale_of(surface, "uncertainty")
    assert scale is not None
    assert (scale.value[:9] ** 2).tolist() == pytest.approx(surface.height_variance[:9].tolist())
    assert np.isnan(scale.value[9:]).all()


def test_counts_are_shown_as_powers_of_ten() -> None:
    scale = scale_of(three_kinds(), "count")
    assert scale is not None
    assert scale.value[:4] == pytest.approx([0, 1, 2, 3])
    colours = painted("count")
    assert colours[0] == colours[4] != colours[3]


def test_without_time_stamps_keyframes_are_counted() -> None:
    surface = three_kinds()
    scale = scale_of(replace(surface, route=np.full((9, 4), np.nan)), "time")
    assert scale is not None
    assert (scale.label, scale.value[:9].tolist()) == ("first keyframe", list(range(9)))


def test_regions_next_to_each_other_in_number_look_apart() -> None:
    colours = region_colours(np.arange(-1, 40, dtype=np.int32))
    assert colours[0].tolist() == list(PALE)
    assert min(differences(colours[1:-1], colours[2:])) > 0.1


def test_the_scale_is_that_of_the_whole_map_whatever_is_left_out() -> None:
    surface = three_kinds()
    part = surface.take(surface.ix < 4)
    paint = Paint(surface, "time")
    assert paint(part, np.arange(4), part.height).tolist() == painted("time")[:4]
