"""What a map can be coloured by: the colours are those of meshes, the legend says what they mean.

Ways to pass without being right: one colour for all patches; a scale whose ends are not those that
the colours were made with, so both ends are looked up in maps whose values are known.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mlscli.maps.surface_map import SurfaceMap
from mlscli.mesh import ROUTE, build_mesh
from mlscli.mesh.colours import COLOURS, ColourBy, height_scale
from mlscli.view.colourings import Colouring, colourings
from tests.helpers.meshes import a_map, house, plane


def line() -> SurfaceMap:
    """Return patches in a row with ever more points, ever later, in ever more regions."""
    surface = a_map(*plane(101, 1))
    number = np.arange(surface.size)
    route = np.zeros((len(number), 4))
    route[:, 0] = 50 + number / 2
    return replace(
        surface,
        count=(10 ** (number / 25)).astype(np.uint32),
        variance=(number / 100) ** 2,
        noise=np.zeros(len(number), dtype=np.float32),
        first_keyframe=number.astype(np.int32),
        last_keyframe=number.astype(np.int32),
        region=number.astype(np.int32),
        route=route,
    )


def named(surface: SurfaceMap) -> dict[str, Colouring]:
    return {way.name: way for way in colourings(surface)}


@pytest.mark.parametrize("by", COLOURS)
def test_patches_have_the_colours_of_the_mesh(by: ColourBy) -> None:
    surface = replace(house(), region=np.arange(house().size, dtype=np.int32))
    mesh = build_mesh(surface, "patches", colour=by)
    colour = named(surface)[by].colour
    top = mesh.points
    assert (mesh.origin[top] != ROUTE).all()
    assert (colour[mesh.patch[top]] == mesh.colours[top]).all()


@pytest.mark.parametrize(
    ("by", "low", "high"),
    [
        ("time", 1.0, 49.0),
        ("variance", 0.02, 0.98),
        ("count", 1, 8128),
    ],
)
def test_the_ends_of_a_scale_are_what_has_its_first_and_last_colour(
    by: ColourBy, low: float, high: float
) -> None:
    way = named(line())[by]
    assert way.ends == pytest.approx((low, high), rel=0.03)
    assert way.colour[[0, -1]].tolist() == height_scale()[[0, -1]].tolist()
    assert len(np.unique(way.colour, axis=0)) > 50


def test_kinds_are_the_colours_that_patches_of_them_have() -> None:
    surface = house()
    for name, way in named(surface).items():
        shown = {tuple(row) for row in way.colour.tolist()}
        for colour, text in way.kinds:
            assert colour in shown or "lighter" in text, (name, text)
    assert [text.split(":")[0] for _, text in named(surface)["origin"].kinds] == [
        "measured",
        "plastered",
        "artificial",
    ]


def test_what_a_map_does_not_tell_is_not_offered() -> None:
    assert list(named(line())) == list(COLOURS)
    unknown = np.full(9, np.nan, dtype=np.float32)
    bare = replace(a_map(*plane(3, 3)), route=np.full((1, 4), np.nan), noise=unknown)
    assert list(named(bare)) == ["height", "origin", "variance", "count"]
