"""A growing map is the map of one pass over the points so far, whatever grows and however.

How one could cheat: batches of one size, in one order, never of a single point; the default list
of stages, or clouds in which no stage finds anything; states looked at in the end only, or all
compared with a map that grew, too; a change that tells the whole map, or one that tells what
stays; a map that is made anew from all points with every batch; keyframes lost on the way.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np
import pytest
from hypothesis import given, seed, settings
from hypothesis import strategies as st

from mlscli.building.builder import MapBuilder
from mlscli.keyframes.batches import Points
from mlscli.keyframes.keyframe import Keyframe
from mlscli.maps.cells import CellSet
from mlscli.maps.change import Change
from mlscli.maps.grid import Grid
from mlscli.maps.records import records_of
from mlscli.maps.surface_map import SurfaceMap
from mlscli.pipeline.grouping import group
from mlscli.pipeline.parameters import Parameters
from mlscli.pipeline.stages.median import Median
from mlscli.pipeline.stages.orphans import Orphans
from mlscli.pipeline.stages.plaster import Plaster
from mlscli.pipeline.stages.pyramids import Pyramids
from mlscli.pipeline.stages.stage import MapStage, PointStage, Stage
from mlscli.pipeline.stages.walls import Walls
from mlscli.runtime.arrays import Float64
from tests.helpers.maps import CELL, GAP, THICKNESS, add_measured, random_map
from tests.helpers.pipelines import flights, parameters_of, points_at, stage_lists
from tests.helpers.stages import Onlooker
from tests.pipeline.test_growing import one_pass, together


@settings(max_examples=35)
@given(flights(), stage_lists())
def test_after_every_batch_the_map_is_that_of_one_pass(
    flight: list[Points], stages: tuple[Stage, ...]
) -> None:
    parameters = parameters_of(stages)
    told: list[Change] = []
    builder = MapBuilder(parameters, follow=told.append)
    # What a follower knows of the map, who has been told of nothing but changes.
    seen = builder.surface
    for number, batch in enumerate(flight, 1):
        change = builder.process_cloud(batch.xyz)
        expected = one_pass(in_another_order(flight[:number]), parameters, final=False)
        assert builder.surface == expected
        assert told.pop() is change
        assert not told
        assert change.removed == without(seen, expected)
        assert change.added == without(expected, seen)
        seen = change.applied_to(seen)
        assert seen == expected
    if flight:
        surface = builder.finish()
        surface.check()
        assert surface == one_pass(in_another_order(flight), parameters, final=True)
        assert surface.meta["points"] == at_once(flight, parameters).meta["points"]


@settings(max_examples=25)
@given(flights(), stage_lists(), st.integers(1, 300), st.data())
def test_keyframes_make_one_map_whatever_waits_for_a_batch_and_whoever_looks(
    flight: list[Points], stages: tuple[Stage, ...], min_points: int, data: st.DataObject
) -> None:
    parameters = parameters_of(stages)
    expected = at_once(flight, parameters)
    looks = data.draw(st.sets(st.integers(0, max(0, len(flight) - 1)), max_size=5))
    batch = replace(parameters.batch, min_points=min_points)
    follow = data.draw(st.sampled_from([None, ignored]))
    builder = MapBuilder(replace(parameters, batch=batch), follow=follow)
    for number, points in enumerate(flight):
        builder.add(Keyframe(points.xyz, stamp=float(number)))
        if number in looks:
            _ = builder.surface
    surface = builder.finish()
    assert surface == expected
    assert surface.route[:, 0].tolist() == list(range(len(flight)))
    assert surface.meta["points"] == expected.meta["points"]


@settings(max_examples=25)
@given(flights().filter(lambda flight: len(flight) < 60), stage_lists())
def test_a_sequential_map_is_fed_back_into_its_stages_batch_by_batch(
    flight: list[Points], stages: tuple[Stage, ...]
) -> None:
    builder = MapBuilder(parameters_of(stages, "sequential"))
    expected = builder.surface
    bounded, final = divided(stages)
    for batch in flight:
        before = expected
        change = builder.process_cloud(batch.xyz)
        expected = fed_back(before, batch, bounded)
        assert builder.surface == expected
        assert change.removed == without(before, expected)
        assert change.added == without(expected, before)
    for stage in final:
        expected = stage.apply(expected)
    assert builder.finish() == expected


def ignored(_: Change) -> None:
    """Follow a map without looking."""


def in_another_order(batches: Sequence[Points]) -> Points:
    points = together(batches)
    return points_at(points, np.random.default_rng(points.size).permutation(points.size))


def at_once(flight: Sequence[Points], parameters: Parameters) -> SurfaceMap:
    """Return the map that is made in one pass in the end, each batch a keyframe."""
    builder = MapBuilder(parameters)
    for batch in flight:
        builder.add(Keyframe(batch.xyz))
    return builder.finish()


def without(surface: SurfaceMap, other: SurfaceMap) -> SurfaceMap:
    """Return the patches of a map that the other has not, bit for bit."""
    others = {record.tobytes() for record in records_of(other)}
    return surface.take(
        np.array([r.tobytes() not in others for r in records_of(surface)], dtype=np.bool_)
    )


def divided(stages: Sequence[Stage]) -> tuple[list[Stage], list[MapStage]]:
    """Return the stages that run with every batch, and those that wait for the end."""
    unbounded = [isinstance(s, MapStage) and s.reach(CELL) is None for s in stages]
    first = unbounded.index(True) if any(unbounded) else len(stages)
    return list(stages[:first]), [s for s in stages[first:] if isinstance(s, MapStage)]


def fed_back(surface: SurfaceMap, points: Points, stages: Sequence[Stage]) -> SurfaceMap:
    """Return a sequential map after a batch, every step taken on the whole map."""
    for stage in stages:
        if isinstance(stage, PointStage):
            points = stage.apply(points, CELL)
    new = group(points, Grid(CELL, GAP, THICKNESS))
    changed = CellSet.of(new.ix, new.iy)
    surface = add_measured(surface, new)
    for stage in stages:
        if isinstance(stage, MapStage):
            around = changed.widened(stage.reach(CELL) or 0)
            surface = surface.replace(around, stage.apply(surface))
    return surface


@pytest.mark.parametrize("mode", ["consistent", "sequential"])
def test_what_lies_within_reach_keeps_the_neighbours_that_lie_beyond(mode: str) -> None:
    builder = MapBuilder(parameters_of([Orphans(horizontal=CELL, vertical=0.5)], mode))
    builder.process_cloud(at_heights([(0.6, 0.0), (1.1, 0.0)]))
    # High above the cell beside the two, of which one alone is within reach.
    change = builder.process_cloud(at_heights([(0.1, 5.0)]))
    assert change.removed.size == change.added.size == 0
    assert builder.surface.ix.tolist() == [1, 2]


# --- the properties say something ---

Kind = TypeVar("Kind", bound=Stage)


def test_every_stage_changes_something_in_these_lists_and_clouds() -> None:
    changed: Counter[str] = Counter()

    @settings(max_examples=200, derandomize=True, database=None)
    @given(flights(), stage_lists())
    def look(flight: list[Points], stages: tuple[Stage, ...]) -> None:
        if flight:
            changed.update(set(changes(together(flight), stages)))

    missing = {
        "median drops",
        "median moves",
        *(f"{stage} heeds {name}" for stage, rules in RULES.items() for name in rules),
        "orphans drops",
        "walls inserts 1",
        "walls inserts 2",
        "walls moves",
        "plaster inserts 1",
        "plaster inserts 2",
        "pyramids moves",
        "regions drops",
        "regions moves",
        "regions numbers",
    }
    # What is drawn depends on the modules that are imported, so that few may lack something.
    for number in range(10):
        seed(number)(look)()
        missing -= {*changed}
        if not missing:
            break
    assert not missing


RULES: dict[str, dict[str, Any]] = {
    "median": {"recentre": 0, "level": 0, "min_share": 0, "max_slope": 0},
    "walls": {"join": 0, "along": 0, "support": 0},
    "plaster": {"slope_reach": 0, "support": 0, "over_lower": True},
    "pyramids": {"pits": False},
}
"""By stage, parameters and the value with which they do nothing."""


def changes(points: Points, stages: Sequence[Stage]) -> list[str]:
    """Return what each stage does in one pass."""
    did = []
    for stage in stages:
        if isinstance(stage, PointStage):
            kept = stage.apply(points, CELL)
            for name, without_it in without_each_rule(stage):
                other = without_it.apply(points, CELL)
                did += [f"{stage.name} heeds {name}"] * (not np.array_equal(kept.xyz, other.xyz))
            did += [f"{stage.name} drops"] * (kept.size < points.size)
            moved = kept.size == points.size and bool((kept.xyz != points.xyz).any())
            did += [f"{stage.name} moves"] * moved
            points = kept
    surface = group(points, Grid(CELL, GAP, THICKNESS))
    for stage in stages:
        if isinstance(stage, MapStage):
            before, surface = surface, stage.apply(surface)
            for name, simpler in without_each_rule(stage):
                did += [f"{stage.name} heeds {name}"] * (simpler.apply(before) != surface)
            for origin in (1, 2):
                more = (surface.origin == origin).sum() > (before.origin == origin).sum()
                did += [f"{stage.name} inserts {origin}"] * bool(more)
            did += [f"{stage.name} drops"] * (surface.size < before.size)
            did += [f"{stage.name} numbers"] * bool(
                surface.region.max(initial=0) > before.region.max(initial=0)
            )
            extents, were = extents_of(surface), extents_of(before)
            moved = any(were[patch] != extents[patch] for patch in extents.keys() & were.keys())
            did += [f"{stage.name} moves"] * moved
    return did


def without_each_rule(stage: Kind) -> Iterator[tuple[str, Kind]]:
    """Yield each rule of a stage that can be switched off, and the stage without it."""
    for name, nothing in RULES.get(stage.name, {}).items():
        yield name, replace(stage, **{name: nothing})


def extents_of(surface: SurfaceMap) -> dict[tuple[float, ...], tuple[float, float]]:
    """Return height and depth of the measured patches by what was measured."""
    surface = surface.take(surface.origin == 0)
    names = ("ix", "iy", "top", "bottom", "height", "depth")
    rows = zip(*(getattr(surface, name).tolist() for name in names), strict=True)
    return {row[:4]: row[4:] for row in rows}


def test_batches_take_back_what_was_inserted_and_change_cells_that_they_do_not_measure() -> None:
    seen: Counter[str] = Counter()

    @settings(max_examples=200, derandomize=True, database=None)
    @given(flights(), stage_lists())
    def look(flight: list[Points], stages: tuple[Stage, ...]) -> None:
        builder = MapBuilder(parameters_of(stages))
        if flight[:-30]:
            builder.process_cloud(together(flight[:-30]).xyz)
        for batch in flight[-30:]:
            change = builder.process_cloud(batch.xyz)
            measured = CellSet.of(*np.floor(batch.xyz[:, :2] / CELL).astype(np.int64).T)
            gone = change.removed
            seen["single points"] += batch.size == 1
            seen["nothing in it"] += batch.size == 0
            seen["inserted ones go"] += bool((gone.origin > 0).any())
            beyond = ~measured.contains(gone.ix, gone.iy)
            seen["beyond its cells"] += bool(beyond.any())
            seen["measured ones change"] += bool((gone.origin[beyond] == 0).any())
            left = CellSet.of(builder.surface.ix, builder.surface.iy)
            seen["cells are emptied"] += not left.contains(gone.ix, gone.iy).all()

    look()
    assert len(seen) == 6
    assert {what: n for what, n in seen.items() if n < 3} == {}


def test_a_tile_that_a_batch_empties_is_empty() -> None:
    # Between the two ends lie more cells than a tile is wide, all of them inserted; the point in
    # the second batch lies beside one end, which then no longer looks for the other.
    level = Plaster(height_thresh=0, height_clearance=0.25, max_gap=130.0, max_gap_enhanced=0)
    builder = MapBuilder(parameters_of([level]))
    builder.process_cloud(at_heights([(30.1, 0.2), (150.1, 0.0)]))
    assert builder.surface.size == 241
    change = builder.process_cloud(at_heights([(30.6, 0.3)]))
    assert change.removed.size == 239
    assert builder.surface.ix.tolist() == [60, 61, 300]
    builder.process_cloud(at_heights([(100.1, 0.0)]))
    assert builder.surface.ix.tolist() == [60, 61, *range(200, 301)]


def at_heights(points: Sequence[tuple[float, float]]) -> Float64:
    """Return points on a line along x."""
    return np.array([(x, 0.1, z) for x, z in points])


def test_a_patch_that_differs_in_any_column_is_a_change() -> None:
    surface = random_map(np.random.default_rng(1))
    for name in set(surface.columns) - {"ix", "iy"}:
        column = surface.columns[name].copy()
        column[3:4].view(np.uint8)[0] ^= 1
        other = replace(surface, **{name: column})
        change = Change.between(records_of(surface), records_of(other), surface.grid)
        assert (change.removed.size, change.added.size) == (1, 1), name
        assert change.removed == surface.take(np.array([3]))


# --- what a batch costs ---


@dataclass(frozen=True)
class SeenPoints(Onlooker):
    """Changes nothing, and says of how many points."""

    name = "seen points"
    sizes: list[int] = field(default_factory=list)

    def reach(self, cell_size: float) -> int:  # noqa: ARG002
        return 1

    def look_at(self, points: Points) -> None:
        self.sizes.append(points.size)


@dataclass(frozen=True)
class SeenPatches(MapStage):
    """Changes nothing, and says of how many patches."""

    name = "seen patches"
    cells: int = 1
    sizes: list[int] = field(default_factory=list)

    def reach(self, cell_size: float) -> int:  # noqa: ARG002
        return self.cells

    def transform(self, surface: SurfaceMap) -> SurfaceMap:
        self.sizes.append(surface.size)
        return surface


@pytest.mark.parametrize("mode", ["consistent", "sequential"])
def test_stages_are_given_what_lies_around_a_batch_and_no_more(mode: str) -> None:
    of_points, of_patches, last = SeenPoints(), SeenPatches(), SeenPatches(cells=2)
    stages = (Median(0.6, 6, 1), of_points, Orphans(), of_patches, Walls(), Plaster(), Pyramids())
    builder = MapBuilder(parameters_of((*stages, last), mode))
    side = 200
    x, y = (axis.ravel() * CELL + 0.2 for axis in np.meshgrid(np.arange(side), np.arange(side)))
    rng = np.random.default_rng(1)
    builder.process_cloud(np.column_stack((x, y, rng.normal(0, 0.1, len(x)))))
    for stage in (of_points, of_patches, last):
        assert max(stage.sizes) > 0.9 * side**2
        stage.sizes.clear()
    surface = builder.surface
    # Three places far apart, one of them where nothing was: a box around them is the whole map.
    places = [(5, 5, 0), (90, 90, 0), (1e6, -1e6, 0)]
    batch = np.concatenate([place + rng.uniform(0, 1, (17, 3)) * (1, 1, 0.1) for place in places])
    builder.process_cloud(batch)
    assert builder.surface.size > surface.size
    reach = sum(s.reach(CELL) or 0 for s in (*stages, last) if isinstance(s, PointStage | MapStage))
    around = len(places) * (4 * reach + 3) ** 2
    for stage in (of_points, of_patches, last):
        assert 0 < max(stage.sizes) <= around < 0.9 * side**2


def test_the_slowest_batch_is_the_one_that_took_longest(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = [0.0]
    monkeypatch.setattr(time, "perf_counter", lambda: clock[0])
    takes: list[float] = []

    class Slow(SeenPatches):
        def transform(self, surface: SurfaceMap) -> SurfaceMap:
            clock[0] += takes.pop() if takes else 0.0
            return surface

    builder = MapBuilder(parameters_of([Slow()]), follow=ignored)
    for seconds in (2.0, 7.0, 3.0):
        # Between batches, while points are gathered, time does not count.
        clock[0] += 100
        takes.append(seconds)
        builder.process_cloud(np.zeros((1, 3)) + seconds)
    assert builder.report.slowest_batch == 7.0
    assert builder.report.batches == 3
    assert builder.finish().meta["batches"] == 3
