"""Each stage does what its rule says, wherever it is evaluated.

How one could cheat: a reference that calls the kernel; maps without ties, levels or gaps; maps on
which a stage changes nothing. Hence references of plain loops, heights in coarse steps on half of
the maps, and a test that each stage changes many of them.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from mlscli.maps.cells import CellSet, Limits
from mlscli.maps.grid import Grid
from mlscli.maps.surface_map import SurfaceMap
from mlscli.parameters.lengths import Cells
from mlscli.pipeline.stages.gaps import between
from mlscli.pipeline.stages.orphans import Orphans
from mlscli.pipeline.stages.plaster import Plaster
from mlscli.pipeline.stages.pyramids import Pyramids
from mlscli.pipeline.stages.regions import Regions
from mlscli.pipeline.stages.stage import MapStage
from mlscli.pipeline.stages.walls import Walls
from tests.helpers import references
from tests.helpers.maps import (
    CELL,
    GAP,
    Patch,
    map_of,
    ordered,
    patches_of,
    random_map,
    rough_floor,
    symmetries,
    turned_map,
)

MAPS = 300

Reference = Callable[[list[Patch]], list[Patch]]


def orphans(rng: np.random.Generator) -> tuple[MapStage, Reference]:
    horizontal, vertical = float(rng.choice([0, 0.5, 1.0, 1.3])), float(rng.choice([0, 0.25, 0.5]))
    least, share = int(rng.integers(0, 4)), float(rng.choice([0, 0.05, 0.2, 0.5]))
    box = float(rng.choice([0, 0.5, 1.1])), float(rng.choice([0, 0.25, 0.6]))
    stage = Orphans(
        horizontal=horizontal,
        vertical=vertical,
        min_neighbours=least,
        min_share=share,
        share_horizontal=box[0],
        share_vertical=box[1],
    )
    return stage, lambda p: references.orphans(p, CELL, horizontal, vertical, least, share, box)


def gaps(rng: np.random.Generator) -> tuple[float, float, float]:
    """Return a slope, max_gap and max_gap_enhanced; lengths of whole cells and others."""
    narrow = float(rng.choice([0, 0.4, 0.5, 1.0]))
    wide = float(rng.choice([0, narrow, 1.5, 2.6]))
    return float(rng.choice([0, 0.5, 1.0])), narrow, 0.0 if wide < narrow else wide


def plaster(rng: np.random.Generator) -> tuple[MapStage, Reference]:
    slope, narrow, wide = gaps(rng)
    clearance, trusted = float(rng.choice([0, 0.25])), float(rng.choice([0, 0.5, 0.8]))
    support, over_lower = int(rng.choice([0, 0, 1, 2, 3])), bool(rng.random() < 0.5)
    stage = Plaster(
        height_thresh=slope,
        height_clearance=clearance,
        max_gap=narrow,
        max_gap_enhanced=wide,
        slope_reach=trusted,
        support=support,
        over_lower=over_lower,
    )
    return stage, lambda p: references.plaster(
        p, CELL, GAP, slope, clearance, narrow, wide, trusted, support, over_lower
    )


def walls(rng: np.random.Generator) -> tuple[MapStage, Reference]:
    slope, narrow, wide = gaps(rng)
    join, along = float(rng.choice([0, 0.25, 0.5, 2.0])), float(rng.choice([0, 0, 0.5, 1.0, 1.6]))
    support, pieces = int(rng.choice([0, 0, 1, 2])), float(rng.choice([0, 1.0, 3.0]))
    stage = Walls(
        height_thresh=slope,
        max_gap=narrow,
        max_gap_enhanced=wide,
        join=join,
        along=along,
        support=support,
        pieces=pieces,
    )
    return stage, lambda p: references.walls(
        p, CELL, GAP, slope, narrow, wide, join, along, support, pieces
    )


def pyramids(rng: np.random.Generator) -> tuple[MapStage, Reference]:
    factor, highest = float(rng.choice([0, 0.5, 1.5])), float(rng.choice([0.5, GAP]))
    pits = bool(rng.random() < 0.5)
    stage = Pyramids(height_factor_thresh=factor, max_height=highest, pits=pits)
    return stage, lambda p: references.pyramids(p, GAP, factor, highest, pits)


def regions(rng: np.random.Generator) -> tuple[MapStage, Reference]:
    thresh, least = float(rng.choice([0, 0.25, 0.5])), int(rng.integers(1, 6))
    snap = bool(rng.random() < 0.5)
    stage = Regions(height_thresh=thresh, min_size=least, snap=snap)
    return stage, lambda p: references.regions(p, GAP, thresh, least, snap)


STAGES = [orphans, plaster, walls, pyramids, regions]
every_stage = pytest.mark.parametrize("draw", STAGES)
Draw = Callable[[np.random.Generator], tuple[MapStage, Reference]]


def map_for(draw: Draw, rng: np.random.Generator) -> SurfaceMap:
    """Return a map on which the stage finds something."""
    return rough_floor(rng) if draw is pyramids else random_map(rng)


@every_stage
def test_a_stage_agrees_with_its_rule_read_plainly(draw: Draw) -> None:
    rng = np.random.default_rng(1)
    changed = 0
    for _ in range(MAPS):
        surface = map_for(draw, rng)
        stage, reference = draw(rng)
        before, after = patches_of(surface), patches_of(stage.apply(surface))
        assert after == reference(before)
        changed += after != before
    assert changed > MAPS / 10


def test_orphans_among_many_levels_are_told_by_the_rule_and_in_their_time() -> None:
    rng = np.random.default_rng(6)
    patches = [
        Patch(ix, iy, float(height), float(rng.choice([0, 0.25, 2.0])), 0, int(rng.integers(1, 5)))
        for ix in range(2)
        for iy in range(2)
        for height in np.cumsum(rng.choice([0.25, 0.5, 3.0], 60))
    ]
    for vertical, share in ((0.25, 0.0), (0.5, 0.01), (0.5, 0.05)):
        box: dict[str, Any] = {"share_horizontal": 0.5, "share_vertical": vertical}
        stage = Orphans(horizontal=0.5, vertical=vertical, min_neighbours=2, min_share=share, **box)
        found = patches_of(stage.apply(map_of(patches)))
        alone = ordered(patches), CELL, 0.5, vertical, 2
        assert found == references.orphans(*alone, share, (0.5, vertical))
        assert 0 < len(found) < len(patches)
    # Each against each took minutes.
    tower = map_of([Patch(0, iy, 2.0 * k, 0.0, 0, 1) for iy in range(3) for k in range(8000)])
    begin = time.process_time()
    box = {"share_horizontal": 0.5, "share_vertical": 0.5}
    assert not Orphans(horizontal=0.5, vertical=0.5, min_share=0.2, **box).apply(tower).size
    # A level of a tower is measured by ten levels, not by thousands.
    assert Orphans(horizontal=0.5, vertical=0.5, min_share=0.05).apply(tower).size == tower.size
    assert time.process_time() - begin < 1


@every_stage
def test_neither_threads_nor_a_stray_patch_change_anything(
    draw: Draw, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(5)
    # Every cell is a range of its own.
    monkeypatch.setattr("mlscli.runtime.threads.WORTHWHILE", 1e-9)
    monkeypatch.setattr("mlscli.runtime.threads.processors", lambda: 3)
    for _ in range(MAPS // 6):
        patches = patches_of(map_for(draw, rng))
        # Rows and columns by the thousand million, few of which hold anything.
        patches = ordered([*patches, Patch(-(2**31), 2**31 - 1, 0.0, 0.0, 0, 1)])
        stage, reference = draw(rng)
        assert patches_of(stage.apply(map_of(patches))) == reference(patches)


@every_stage
def test_a_stage_keeps_the_model(draw: Draw) -> None:
    rng = np.random.default_rng(2)
    for _ in range(MAPS):
        draw(rng)[0].apply(map_for(draw, rng)).check()


@every_stage
def test_what_a_stage_moves_beyond_what_was_measured_is_marked(draw: Draw) -> None:
    rng = np.random.default_rng(9)
    marked = kept = 0
    for _ in range(MAPS):
        after = draw(rng)[0].apply(map_for(draw, rng))
        names = ("origin", "moved", "height", "depth", "bottom", "top")
        for row in zip(*(getattr(after, name).tolist() for name in names), strict=True):
            origin, moved, height, depth, bottom, top = row
            within = bottom - 1e-9 <= height - depth and height <= top
            assert moved == (origin == 0 and not within)
            marked += moved
            kept += origin == 0 and not moved
    assert (marked > MAPS / 10) is (draw in (walls, pyramids, regions))
    assert kept > MAPS


@every_stage
def test_limits_confine_a_stage_and_change_nothing_inside(draw: Draw) -> None:
    rng = np.random.default_rng(3)
    for _ in range(MAPS):
        surface = map_for(draw, rng)
        stage, _ = draw(rng)
        west, south, width = rng.integers(-7, 3), rng.integers(-7, 3), rng.integers(0, 9)
        limits = Limits(int(west), int(west + width), int(south), None)
        limited = replace(stage, **limits._asdict()).apply(surface)
        assert limited.crop(*limits) == stage.apply(surface).crop(*limits)
        outside_after = limited.take(~limits.contain(limited.ix, limited.iy))
        assert outside_after == surface.take(~limits.contain(surface.ix, surface.iy))


@every_stage
def test_limits_without_a_cell_between_them_are_a_fault(draw: Draw) -> None:
    stage, _ = draw(np.random.default_rng(8))
    assert [f.field for f in replace(stage, min_y=3, max_y=2).faults(CELL, GAP)] == ["min_y"]
    assert list(replace(stage, min_y=3, max_y=3).faults(CELL, GAP)) == []


@pytest.mark.parametrize("draw", STAGES[:-1])
def test_a_stage_reads_no_farther_than_its_reach(draw: Draw) -> None:
    rng = np.random.default_rng(4)
    for _ in range(MAPS):
        surface = map_for(draw, rng)
        stage, _ = draw(rng)
        reach = stage.reach(CELL)
        assert reach is not None
        cells = CellSet.of(rng.integers(-7, 10, 3), rng.integers(-7, 10, 3))
        near = surface.in_cells(cells.widened(reach))
        assert stage.apply(near).in_cells(cells) == stage.apply(surface).in_cells(cells)


@every_stage
def test_turning_the_map_turns_the_result(draw: Draw) -> None:
    rng = np.random.default_rng(5)
    for _ in range(MAPS // 4):
        surface = map_for(draw, rng)
        stage, _ = draw(rng)
        result = stage.apply(surface)
        for symmetry in symmetries():
            turned = stage.apply(turned_map(surface, symmetry))
            expected = turned_map(result, symmetry)
            # Regions are the same up to their numbers.
            assert _without_regions(turned) == _without_regions(expected)
            if draw is regions:
                pairs = set(zip(turned.region.tolist(), expected.region.tolist(), strict=True))
                assert len(pairs) == len({a for a, _ in pairs}) == len({b for _, b in pairs})


@every_stage
def test_an_empty_map_stays_empty(draw: Draw) -> None:
    stage, _ = draw(np.random.default_rng(6))
    assert stage.apply(SurfaceMap.of(Grid(CELL, GAP, 0.25))).size == 0


def test_lengths_in_cells_and_in_units_are_the_same() -> None:
    surface = random_map(np.random.default_rng(7))
    in_cells = Plaster(height_clearance=Cells(0.5), max_gap=Cells(1), max_gap_enhanced=Cells(3))
    in_units = Plaster(height_clearance=0.25, max_gap=0.5, max_gap_enhanced=1.5)
    assert in_cells.apply(surface) == in_units.apply(surface)


def test_lengths_without_bound_reach_over_the_whole_map_and_no_farther() -> None:
    surface = random_map(np.random.default_rng(9), fill=0.9)
    anywhere = Orphans(horizontal=1e300, vertical=1e300, min_neighbours=surface.size - 1)
    assert anywhere.apply(surface) == surface
    assert replace(anywhere, min_neighbours=surface.size).apply(surface).size == 0
    for stage in (Plaster(max_gap=1e300, max_gap_enhanced=1e300), Walls(max_gap=1e300)):
        stage.apply(surface).check()


def test_plaster_closes_the_gap_beside_a_bridge_higher_not_along_one_axis() -> None:
    # The thesis's figure 6.10: a cell between ground (along x) and bridge (along y).
    ground = [Patch(x, 0, 0.0, 0.0, 0, 5) for x in (-1, 1)]
    bridge = [Patch(0, y, 0.5, 0.0, 0, 5) for y in (-1, 1)]
    closed = Plaster(max_gap=CELL, max_gap_enhanced=0).apply(map_of(ground + bridge))
    assert [p for p in patches_of(closed) if p.cell == (0, 0)] == [Patch(0, 0, 0.5, 0.0, 1, 0)]


def test_the_space_under_a_bridge_stays_open() -> None:
    ground = [Patch(x, y, 0.0, 0.0, 0, 5) for x in range(5) for y in range(5)]
    deck = [Patch(x, 2, 3.0, 0.0, 0, 5) for x in range(5)]
    walls_then_plaster = Plaster().apply(Walls().apply(map_of(ground + deck)))
    between = [p for p in patches_of(walls_then_plaster) if 0.0 < p.height < 3.0]
    assert between == []


def test_a_wall_is_drawn_out_to_the_floor_and_the_roof_beside_it_but_not_over_a_passage() -> None:
    floor, roof = Patch(1, 0, 0.0, 0.0, 0, 5), Patch(-1, 1, 2.0, 0.0, 0, 5)
    wall = Patch(0, 0, 1.75, 1.5, 0, 9)
    joined = patches_of(Walls(join=CELL).apply(map_of([floor, roof, wall])))
    assert [p for p in joined if p.cell == (0, 0)] == [Patch(0, 0, 2.0, 2.0, 0, 9)]
    # Below it, what the craft could pass stays open, however far walls may be joined.
    deep = Patch(1, 0, -0.6, 0.0, 0, 5)
    joined = patches_of(Walls(join=9.0).apply(map_of([deep, wall])))
    assert [p for p in joined if p.cell == (0, 0)] == [wall]
    # A floor of its own cell is not come within the gap of.
    below = Patch(0, 0, -0.55, 0.0, 0, 5)
    joined = patches_of(Walls(join=CELL).apply(map_of([floor, below, wall])))
    assert [p for p in joined if p.cell == (0, 0)] == [below, wall]


def test_a_slope_is_trusted_no_farther_than_asked() -> None:
    ends = [Patch(0, 0, 0.0, 0.0, 0, 5), Patch(4, 0, 0.75, 0.0, 0, 5)]
    wide = Plaster(height_thresh=0.5, height_clearance=0.25, max_gap=2.0, max_gap_enhanced=0)
    assert wide.apply(map_of(ends)).size == 5
    assert replace(wide, slope_reach=2 * CELL).apply(map_of(ends)).size == 5
    assert replace(wide, slope_reach=1.9 * CELL).apply(map_of(ends)).size == 2


def test_a_pit_is_raised_to_its_lowest_neighbour_where_pits_are_asked_for() -> None:
    floor = [Patch(*cell, 0.0, 0.0, 0, 5) for cell in ((-1, 0), (1, 0), (0, -1), (0, 1))]
    pit = Patch(0, 0, -0.6, 0.0, 0, 5)
    assert Pyramids().apply(map_of([*floor, pit])) == map_of([*floor, pit])
    raised = patches_of(Pyramids(pits=True).apply(map_of([*floor, pit])))
    assert [p.height for p in raised if p.cell == (0, 0)] == [0.0]


def test_a_pyramid_that_would_double_another_surface_is_removed() -> None:
    floor = [
        Patch(x, y, 0.0, 0.0, 0, 5) for x in (-1, 0, 1) for y in (-1, 0, 1) if (x, y) != (0, 0)
    ]
    peak, below = Patch(0, 0, 0.6, 0.0, 0, 5), Patch(0, 0, -0.5, 0.0, 0, 5)
    lowered = Pyramids().apply(map_of([*floor, peak]))
    assert [p.height for p in patches_of(lowered) if p.cell == (0, 0)] == [0.0]
    removed = Pyramids().apply(map_of([*floor, peak, below]))
    assert [p.height for p in patches_of(removed) if p.cell == (0, 0)] == [-0.5]


def test_walls_fill_a_window_no_larger_than_allowed() -> None:
    wall = [Patch(0, 0, 1.0, 1.0, 0, 9), Patch(0, 0, 3.0, 1.0, 0, 9)]
    closed = patches_of(Walls(max_gap=0.5, max_gap_enhanced=1.0).apply(map_of(wall)))
    assert closed[1] == Patch(0, 0, 2.0, 1.0, 2, 0)
    assert Walls(max_gap=0.5, max_gap_enhanced=0.9).apply(map_of(wall)) == map_of(wall)


def _without_regions(surface: SurfaceMap) -> SurfaceMap:
    return surface.with_columns(region=np.full(surface.size, -1, dtype=np.int32))


def test_a_height_between_equal_ends_is_that_height_and_never_minus_zero() -> None:
    assert (0.1 * 2 + 0.1 * 1) / 3 != 0.1
    assert between(0.1, 0.1, 1, 3) == 0.1
    assert not np.signbit(between(-5e-324, 0.0, 1, 2))


def test_of_equal_heights_the_lower_origin_then_the_greater_depth_stays() -> None:
    ends = [Patch(x, 0, 2.0, depth, 0, 5) for x, depth in ((-1, 1.0), (1, 1.0))]
    # Along y the gap is wider, so that what closes it is artificial, and the wall is deeper.
    ends += [Patch(0, y, 2.0, 1.5, 0, 5) for y in (-2, 2)]
    closed = Walls(max_gap=CELL, max_gap_enhanced=3 * CELL).apply(map_of(ends))
    assert [p for p in patches_of(closed) if p.cell == (0, 0)] == [Patch(0, 0, 2.0, 1.0, 1, 0)]
    alike = [*ends[:2], *[Patch(0, y, 2.0, 1.5, 0, 5) for y in (-1, 1)]]
    closed = Walls(max_gap=CELL, max_gap_enhanced=0).apply(map_of(alike))
    assert [p for p in patches_of(closed) if p.cell == (0, 0)] == [Patch(0, 0, 2.0, 1.5, 1, 0)]


def test_a_hole_is_filled_by_its_length_not_by_whole_cells_and_not_at_the_gap_itself() -> None:
    for space, filled in ((1.25, True), (1.26, False), (GAP, False), (GAP + 0.01, True)):
        wall = [Patch(0, 0, 1.0, 1.0, 0, 9), Patch(0, 0, 2.0 + space, 1.0, 0, 9)]
        closed = Walls(max_gap=0.5, max_gap_enhanced=1.25).apply(map_of(wall))
        assert (closed.size == 3) is filled


def test_what_fills_a_hole_keeps_a_missing_column_from_doubling_it() -> None:
    pierced = [Patch(0, 0, 1.0, 1.0, 0, 9), Patch(0, 0, 4.0, 1.0, 0, 9)]
    # Beside it, at the height of the hole, a wall on both sides, apart from what stands there.
    beside = [Patch(x, 0, 2.1, 0.3, 0, 9) for x in (-1, 1)]
    closed = Walls(height_thresh=0, max_gap=2.0, max_gap_enhanced=0).apply(map_of(pierced + beside))
    inserted = [p for p in patches_of(closed) if p.origin]
    assert inserted == [Patch(0, 0, 3.0, 2.0, 1, 0)]


def test_a_patch_close_to_another_of_its_cell_is_no_pyramid() -> None:
    edge = [(-1, 0), (1, 0), (0, -1), (0, 1)]
    floor = [Patch(*cell, 0.0, 0.0, 0, 5) for cell in edge]
    touching = [Patch(0, 0, 0.6, 0.0, 0, 5), Patch(0, 0, 1.2, 0.6, 1, 0)]
    assert Pyramids().apply(map_of(floor + touching)) == map_of(floor + touching)


def test_snapping_takes_the_higher_of_equals_and_never_meets_another_that_is_moved() -> None:
    low, high = ([Patch(x, y, z, 0.0, 0, 5) for x in (0, 1)] for y, z in ((-1, 0.0), (1, 1.0)))
    between_both = [Patch(0, 0, 0.5, 0.0, 0, 5)]
    snap = Regions(height_thresh=0.1, min_size=2, snap=True)
    moved = snap.apply(map_of(low + high + between_both))
    assert [p.height for p in patches_of(moved) if p.cell == (0, 0)] == [1.0]
    two = [Patch(0, 0, -0.4, 0.0, 0, 5), Patch(0, 0, 0.4, 0.0, 0, 5)]
    # Both would come to lie at 0.
    assert [p for p in patches_of(snap.apply(map_of(low + two))) if p.cell == (0, 0)] == []
