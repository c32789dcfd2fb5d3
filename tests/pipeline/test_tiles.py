"""What is kept in tiles is what would be kept in one piece.

How one could cheat: areas within one tile; a tile that is never emptied; sets without a reach.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from mlscli.cells import CellSet
from mlscli.keyframes import Points
from mlscli.pipeline.tiles import SHIFT, TiledMap, TiledPoints, cells_of
from mlscli.surface_map import SurfaceMap
from tests.maps import random_map

SIDE = 2**SHIFT
seeds = st.integers(0, 2**32 - 1)


def scattered(rng: np.random.Generator) -> SurfaceMap:
    """Return a map whose cells lie apart, in several tiles."""
    surface = random_map(rng)
    step = int(rng.choice([1, 5, SIDE]))
    return replace(surface, ix=surface.ix * step, iy=surface.iy * step).sorted()


@settings(max_examples=60, deadline=None)
@given(seeds)
def test_areas_are_replaced_as_in_a_whole_map(seed: int) -> None:
    rng = np.random.default_rng(seed)
    surface = scattered(rng)
    tiles = TiledMap(surface.take(np.empty(0, dtype=np.int64)))
    tiles.replace(CellSet.of(surface.ix, surface.iy), surface)
    for _ in range(6):
        centres = rng.integers(-6, 7, (2, 2)) * SIDE // 2
        cells = CellSet.of(*centres).widened(int(rng.choice([0, 3, 40, 10**6])))
        assert tiles.extract(cells) == surface.in_cells(cells)
        new = scattered(rng).in_cells(cells)
        if rng.random() < 0.3:
            new = new.take(np.arange(0))
        tiles.replace(cells, new)
        surface = surface.replace(cells, new)
        assert tiles.whole() == surface


@settings(max_examples=40, deadline=None)
@given(seeds)
def test_points_are_added_and_replaced_area_by_area(seed: int) -> None:
    rng = np.random.default_rng(seed)
    tiles = TiledPoints(0.5)
    kept = Points(np.empty((0, 3)), np.empty(0, dtype=np.int32))
    for number in range(5):
        size = int(rng.integers(0, 40))
        new = Points(rng.uniform(-40, 40, (size, 3)), np.full(size, number, dtype=np.int32))
        cells = CellSet.of(*rng.integers(-80, 80, (2, 2))).widened(int(rng.choice([0, 60])))
        if rng.random() < 0.5:
            inside = cells.contains(*cells_of(new, 0.5))
            new = Points(new.xyz[inside], new.keyframe[inside])
            outside = ~cells.contains(*cells_of(kept, 0.5))
            kept = Points(kept.xyz[outside], kept.keyframe[outside])
            tiles.replace(cells, new)
        else:
            tiles.add(new)
        xyz = np.concatenate((kept.xyz, new.xyz))
        kept = Points(xyz, np.concatenate((kept.keyframe, new.keyframe)))
        inside = cells.contains(*cells_of(kept, 0.5))
        assert rows(tiles.extract(cells)) == rows(Points(kept.xyz[inside], kept.keyframe[inside]))
        everywhere = CellSet.of(np.array([0]), np.array([0])).widened(10**6)
        assert rows(tiles.extract(everywhere)) == rows(kept)


def rows(points: Points) -> list[tuple[float, ...]]:
    return sorted((*xyz, k) for xyz, k in zip(points.xyz.tolist(), points.keyframe, strict=True))
