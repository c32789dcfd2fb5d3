"""Pieces of walls: what a small gap has split becomes one, and levels stay apart.

How one could cheat: join whatever stands above something; ask for no wall beside it, or take a
deck's neighbours for one; join what was inserted; keep the shape of one piece for all; join once
only; declare too short a reach. Each case is tried with one that differs by one cell.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mlscli.building.builder import MapBuilder
from mlscli.config import load
from mlscli.keyframes.batches import Points
from mlscli.keyframes.keyframe import Keyframe
from mlscli.maps.grid import Grid
from mlscli.maps.surface_map import SurfaceMap
from mlscli.pipeline.grouping import group
from mlscli.pipeline.pipeline import Pipeline
from mlscli.pipeline.report import Report
from mlscli.pipeline.stages.walls import Walls
from mlscli.runtime.arrays import Float64
from tests.helpers.maps import CELL, GAP, Patch, map_of, patches_of, symmetries, turned_map

STAGE = Walls(max_gap=0.0, max_gap_enhanced=0.0, pieces=2.0)
PIECES = [Patch(0, 0, height, 0.0, 0, 3) for height in (0.0, 1.0, 2.0)]


def wall(*cells: tuple[int, int], top: float = 2.0) -> list[Patch]:
    return [Patch(x, y, top, top, 0, 9) for x, y in cells]


def levels(patches: list[Patch], stage: Walls = STAGE) -> int:
    """Return how many patches the cell at 0, 0 has after the stage, the same in every turn."""
    surface = map_of(patches)
    result = stage.apply(surface)
    for symmetry in symmetries():
        assert stage.apply(turned_map(surface, symmetry)) == turned_map(result, symmetry)
    return sum(patch.cell == (0, 0) for patch in patches_of(result))


def test_pieces_of_a_wall_are_joined_where_it_goes_on_on_two_sides() -> None:
    assert levels([*PIECES, *wall((-1, 0), (1, 0))]) == 1
    assert levels([*PIECES, *wall((-1, -1), (1, 0))]) == 1
    assert levels([*PIECES, *wall((1, 0))]) == 3
    assert levels([*PIECES, *wall((-2, 0), (1, 0))]) == 3
    assert levels([*PIECES, *wall((-1, 0), (1, 0))], replace(STAGE, pieces=0.9)) == 3
    assert levels([*PIECES, *wall((-1, 0), (1, 0))], Walls(max_gap=0.0, max_gap_enhanced=0.0)) == 3


def test_pieces_that_no_gap_splits_make_no_stage_reach_farther() -> None:
    def reach(*settings: str) -> int:
        parameters = load(None, ["map.cell_size=1", *settings])
        pipeline = Pipeline(parameters, "map", Report())
        return next(s.reach(1.0) or 0 for s in pipeline.map_stages if isinstance(s, Walls))

    none = reach("map.gap_size=1.4", "walls.pieces=0")
    assert reach("map.gap_size=1.5", "walls.pieces=1.5") == none
    assert reach("map.gap_size=1.4", "walls.pieces=1.5") == none + 2


def test_a_wall_beside_counts_up_to_a_gap_from_the_space_between_two_pieces() -> None:
    two = [*PIECES[:1], PIECES[1]._replace(height=3.0)]
    far = replace(STAGE, pieces=3.0)
    for lower in (3.0 + GAP, 3.01 + GAP):
        beside = [Patch(x, 0, lower + 1.0, 1.0, 0, 9) for x in (-1, 1)]
        assert levels([*two, *beside], far) == (1 if lower == 3.0 + GAP else 2)


def test_a_surface_stays_apart_from_what_lies_below_it() -> None:
    walls = wall((-1, 0), (1, 0))
    corner = [Patch(x, 1, 2.0, 0.0, 0, 4) for x in (-1, 0)]
    edge = [*corner, Patch(1, 1, 2.0, 0.0, 0, 4)]
    below, deck = PIECES[0], PIECES[2]
    assert levels([below, deck, *walls, *corner]) == 1
    assert levels([below, deck, *walls, *edge]) == 2
    # A beam stands level with what is beside it, and nothing there is upright.
    beam = [Patch(x, 0, 2.0, 0.0, 0, 4) for x in (-1, 0, 1)]
    ground = [Patch(x, y, 0.0, 0.0, 0, 4) for x in (-1, 0, 1) for y in (-1, 0, 1)]
    assert levels([*beam, *ground]) == 2


def test_what_was_inserted_is_no_piece() -> None:
    inserted = [piece._replace(origin=1, count=0) for piece in PIECES[1:]]
    assert levels([PIECES[0], *inserted, *wall((-1, 0), (1, 0))]) == 3


def test_what_is_joined_is_what_its_points_would_have_made() -> None:
    rng = np.random.default_rng(3)
    z = np.concatenate([rng.uniform(low, low + 0.3, 7) for low in (0.0, 0.9, 2.0)])
    own = np.column_stack((np.full(len(z), 0.25), np.full(len(z), 0.25), z))
    beside = np.array([(x, 0.25, z) for x in (-0.25, 0.75) for z in np.arange(0, 2.5, 0.1)])
    points = Points.of(
        np.concatenate((own, beside)), np.arange(len(own) + len(beside), dtype=np.int32) % 5
    )
    small, large = (Grid(CELL, gap_size, 0.25) for gap_size in (0.4, 2.0))
    pieces, whole = group(points, small), group(points, large)
    joined = STAGE.apply(replace(pieces, route=np.zeros((5, 4))))
    joined.check()
    assert pieces.size > joined.size == whole.size == 3
    for name in ("ix", "height", "depth", "top", "bottom", "count", "first_keyframe"):
        assert np.array_equal(getattr(joined, name), getattr(whole, name))
    assert np.allclose(joined.mean, whole.mean, rtol=1e-12)
    assert np.allclose(joined.variance, whole.variance, rtol=1e-12)


def test_what_the_first_round_joins_bears_out_the_second_as_far_away_as_the_reach() -> None:
    # The cell at 2, 0 becomes a wall by those at 3; only then the one at 1, 0 has two beside it.
    row = [piece._replace(ix=x) for piece in PIECES for x in (1, 2)]
    for beside, left in ((wall((0, 0), (3, 0), (3, 1)), 1), (wall((0, 0), (3, 1)), 3)):
        after = patches_of(STAGE.apply(map_of([*row, *beside])))
        assert [patch.cell for patch in after].count((1, 0)) == left
    assert STAGE.reach(CELL) == 2


def field(seed: int) -> Float64:
    """Return ground with a thin wall, 5 high, and beside it a deck 2 above the ground."""
    rng = np.random.default_rng(seed)
    ground = np.column_stack((rng.uniform(0, 20, (1600, 2)), np.zeros(1600)))
    upright = np.column_stack((rng.uniform(2, 18, 400), np.full(400, 5.5), rng.uniform(0, 5, 400)))
    deck = np.column_stack((rng.uniform(10, 18, (256, 2)), np.full(256, 2.0)))
    return np.concatenate((ground, upright, deck)) + rng.normal(0, 0.02, (2256, 3))


def split(surface: SurfaceMap, low: tuple[int, int], high: tuple[int, int]) -> float:
    """Return which share of the cells from `low` to `high` holds several measured patches."""
    patches = [patch for patch in patches_of(surface) if patch.origin == 0]
    cells = [(x, y) for x in range(low[0], high[0]) for y in range(low[1], high[1])]
    return float(np.mean([sum(patch.cell == cell for patch in patches) > 1 for cell in cells]))


def test_beside_a_small_gap_few_columns_of_a_wall_are_split_and_all_below_a_deck() -> None:
    points = field(1)
    found = {}
    for pieces in ("0", "null"):
        settings = ["map.cell_size=1", "map.gap_size=0.5", f"walls.pieces={pieces}"]
        builder = MapBuilder(load(None, settings))
        builder.add(Keyframe(points))
        surface = builder.finish()
        surface.check()
        found[pieces] = split(surface, (3, 5), (17, 6)), split(surface, (11, 11), (17, 17))
    assert found["0"][0] > 0.6
    assert found["null"][0] < 0.2
    assert found["0"][1] == found["null"][1] > 0.95
