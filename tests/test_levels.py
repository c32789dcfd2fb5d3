"""The openings that `benchmarks/levels.py` watches are there, and a closing of them would be seen.

How one could cheat: a scene without the opening that it is named for; a count that is always 0.
"""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.levels import OPENINGS
from mlscli.config import load
from mlscli.maps.surface_map import ARTIFICIAL, SurfaceMap
from mlscli.pipeline.stages.plaster import Plaster
from mlscli.scenes.surfaces import Scene
from mlscli.scenes.truth import truth
from mlscli.scoring import score

CELL = 0.15
WIDEST = 5  # cells of max_gap_enhanced by default


def true_map(scene: Scene) -> SurfaceMap:
    return truth(scene, CELL, 3 * CELL, CELL)


def closed_everywhere(surface: SurfaceMap) -> SurfaceMap:
    """Return a map with patches in all cells, a cell apart in height."""
    ix, iy, iz = (
        part.ravel()
        for part in np.mgrid[
            surface.ix.min() : surface.ix.max() + 1, surface.iy.min() : surface.iy.max() + 1, 0:14
        ].astype(np.int32)
    )
    size = len(ix)
    return surface.take(surface.ix < surface.ix.min()).with_inserted(
        ix, iy, (iz + 0.5) * CELL, np.zeros(size), np.full(size, ARTIFICIAL, dtype=np.uint8)
    )


@pytest.mark.parametrize(("name", "scene", "wide", "narrow"), OPENINGS)
def test_what_would_close_an_opening_is_counted(
    name: str, scene: Scene, wide: tuple[str, ...], narrow: tuple[str, ...]
) -> None:
    surface = true_map(scene)
    open_to_all = score(surface, surface).phantom_places
    places = score(closed_everywhere(surface), surface).phantom_places
    for place in (*wide, *narrow):
        assert open_to_all[place] == {"plastered": 0, "artificial": 0}
        assert places[place]["artificial"] >= 4, name


def widest_hole(surface: SurfaceMap) -> int:
    """Return how many cells follow one another in a row of the map that hold no patch."""
    rows = [np.unique(surface.ix[surface.iy == y]) for y in np.unique(surface.iy)]
    return int(max(np.diff(row).max() for row in rows)) - 1


def test_the_holes_called_wide_are_wider_than_what_is_closed_and_the_others_are_not() -> None:
    (plaster,) = (stage for stage in load(None).pipeline if isinstance(stage, Plaster))
    assert str(plaster.max_gap_enhanced) == f"{WIDEST} cells"
    for name, scene, wide, narrow in OPENINGS:
        if "in_hole" in wide + narrow:
            assert (widest_hole(true_map(scene)) > WIDEST) == ("in_hole" in wide), name
