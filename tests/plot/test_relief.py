"""Maps from above: which patch a pixel shows, and how it is lit.

Ways to pass without being right: maps as wide as they are long, on which axes can be exchanged; a
light from any side, so slopes to all four sides are compared.
"""

from __future__ import annotations

import pytest

from mlscli.errors import UsageError
from mlscli.maps.grid import Grid
from mlscli.maps.surface_map import SurfaceMap
from mlscli.mesh.colours import Paint
from mlscli.plot.relief import MAX_SIDE, SOFT_RED, frame_of, picture, shown_patches
from mlscli.runtime.arrays import Array
from tests.helpers.maps import Patch, map_of
from tests.helpers.meshes import a_map, plane

LEVELS = a_map((3, -2, 0.0, 0.0), (3, -2, 5.0, 0.0), (5, -2, 1.0, 0.0), (3, -1, 2.0, 0.0))


def heights(surface: SurfaceMap, level: int | None = None) -> list[list[float | None]]:
    shown = shown_patches(surface, frame_of(surface), level)
    return [[float(surface.height[p]) if p >= 0 else None for p in row] for row in shown]


def test_rows_are_y_and_columns_x_and_the_highest_patch_is_on_top() -> None:
    assert heights(LEVELS) == [[5.0, None, 1.0], [2.0, None, None]]


def test_levels_are_counted_from_below() -> None:
    assert heights(LEVELS, 1) == [[0.0, None, 1.0], [2.0, None, None]]
    assert heights(LEVELS, 2) == [[5.0, None, None], [None, None, None]]


def test_the_frame_lies_where_the_cells_are() -> None:
    surface = a_map((3, -2, 0, 0), (5, 1, 0, 0), cell_size=0.5)
    assert frame_of(surface).extent == (1.5, 3.0, -1.0, 1.0)


def test_a_few_strays_far_away_are_not_in_the_picture() -> None:
    surface = a_map(*plane(30, 20), (10**6, 5, 0, 0), (5, -(10**6), 0, 0))
    west, east, south, north = frame_of(surface).extent
    assert west <= 0 < 30 <= east
    assert south <= 0 < 20 <= north
    assert east - west < 60
    assert (shown_patches(surface, frame_of(surface)) >= 0).sum() == 600


def test_a_map_wider_than_a_picture_shows_the_highest_patch_of_each_square() -> None:
    surface = a_map(*[(x, 0, float(x == 5), 0.0) for x in range(3 * MAX_SIDE)])
    frame = frame_of(surface)
    shown = shown_patches(surface, frame)
    assert (frame.cells, shown.shape) == (3, (1, MAX_SIDE))
    assert surface.height[shown[0, 1]] == 1.0


def test_a_map_without_patches_is_refused() -> None:
    with pytest.raises(UsageError, match="no patches"):
        frame_of(SurfaceMap.of(Grid(1, 1, 1)))


def lit(surface: SurfaceMap) -> Array:
    frame = frame_of(surface)
    return picture(surface, shown_patches(surface, frame), frame, Paint(surface, "origin"))


def test_light_falls_from_the_north_west() -> None:
    def brightness(east: float, north: float) -> float:
        columns = [(x, y, east * x + north * y, 0.0) for x, y, _, _ in plane(7, 7)]
        return float(lit(a_map(*columns))[3, 3, :3].sum())

    level = brightness(0, 0)
    assert brightness(0.5, 0) > level > brightness(-0.5, 0)
    assert brightness(0, -0.5) > level > brightness(0, 0.5)


def test_what_is_high_throws_a_shadow_to_the_south_east() -> None:
    ground = [column for column in plane(12, 12) if column[:2] != (5, 5)]
    image = lit(a_map(*ground, (5, 5, 4.0, 0.0)))[:, :, :3].sum(axis=2)
    # North is up in the map, and so are rows.
    assert image[3, 7] < image[7, 3]
    assert image[3, 7] < image[0, 0] == image[7, 7] == image[7, 3]


def test_level_ground_has_its_own_colour_and_artificial_ground_is_red() -> None:
    patches = [Patch(x, y, 0.0, 0.0, 2, 0) for x, y, _, _ in plane(3, 3)]
    image = lit(map_of(patches))
    assert image[1, 1].tolist() == [*SOFT_RED.tolist(), 255]


def test_pixels_without_a_patch_are_clear() -> None:
    assert (lit(LEVELS)[:, :, 3] > 0).tolist() == [[True, False, True], [True, False, False]]
