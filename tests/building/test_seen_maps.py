"""One map where sight lines count: in batches, tiles, threads and on disk, as in one pass.

How one could cheat: flights in which nothing is seen through a gap, or all of them from the start;
crafts that hover above their points, so that no line leaves its cell; tiles as wide as the map.
Hence a test that lines matter to many of these flights, and that later batches open what earlier
ones closed.
"""

from __future__ import annotations

import pickle
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import event, given, settings
from hypothesis import strategies as st

from mlscli.building.builder import MapBuilder
from mlscli.building.large import build_large
from mlscli.errors import ConfigError
from mlscli.io.reading.recording import open_recording
from mlscli.io.writing.npz import read_map, write_map
from mlscli.keyframes.batches import Points, gather
from mlscli.keyframes.keyframe import UNKNOWN_POSITION, Keyframe
from mlscli.maps.cells import Limits
from mlscli.maps.change import Change
from mlscli.maps.grid import Grid
from mlscli.maps.surface_map import SurfaceMap
from mlscli.parameters.lengths import Cells
from mlscli.pipeline.grouping import group
from mlscli.pipeline.parameters import Parameters
from mlscli.pipeline.pipeline import Pipeline
from mlscli.pipeline.report import Report
from mlscli.pipeline.stages.median import Median
from mlscli.pipeline.stages.orphans import Orphans
from mlscli.pipeline.stages.plaster import Plaster
from mlscli.pipeline.stages.pyramids import Pyramids
from mlscli.pipeline.stages.rays import Rays
from mlscli.pipeline.stages.regions import Regions
from mlscli.pipeline.stages.sights import Sights
from mlscli.pipeline.stages.stage import MapStage, PointStage, Stage
from mlscli.pipeline.tilewise import tiles as tilewise
from mlscli.pipeline.tilewise.blocks import PointBlocks
from mlscli.pipeline.tilewise.cluster import Order, carry_out, versions
from mlscli.pipeline.tilewise.tiles import (
    Threads,
    evaluate,
    evaluate_tiles,
    join,
    points_around,
    tiles_of,
)
from mlscli.runtime.arrays import Float64
from tests.helpers.maps import CELL, GAP, THICKNESS
from tests.helpers.pipelines import flights, parameters_of

_median = st.builds(Median, nb_radius=st.just(0.8), max_nb=st.just(6), min_nb=st.integers(0, 2))
_rays = st.builds(
    Rays, noise=st.sampled_from([0.02, 0.05]), depth=st.just(1.0), min_nb=st.just(4),
    min_share=st.sampled_from([0.0, 0.2]),
)  # fmt: skip
_plaster = st.builds(
    Plaster,
    max_gap=st.sampled_from([0.0, 0.0, 0.5]),
    max_gap_enhanced=st.sampled_from([1.6, Cells(4)]),
    height_thresh=st.sampled_from([0.5, 1.0]),
    height_clearance=st.just(0.2),
    support=st.sampled_from([0, 0, 0, 1]),
    sight=st.sampled_from([0.5, Cells(3), 4.0, 1e9]),
    max_x=st.sampled_from([None, None, None, 2]),
)
_others = st.sampled_from(
    [
        Orphans(horizontal=0.5, vertical=0.3, min_neighbours=1),
        Pyramids(height_factor_thresh=0.5, max_height=0.6, pits=True),
    ]
)


@st.composite
def seeing_stages(draw: st.DrawFn) -> tuple[Stage, ...]:
    on_points = draw(st.lists(_median | _rays, max_size=2))
    on_map = draw(st.lists(_others, max_size=2)) + draw(st.lists(_plaster, min_size=1, max_size=2))
    return *on_points, *draw(st.permutations(on_map))


@st.composite
def seen_flights(draw: st.DrawFn) -> list[Keyframe]:
    """Draw keyframes whose craft is above or below, near or far, in some not known to be."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    keyframes = []
    for batch in draw(flights()):
        middle = np.median(batch.xyz, axis=0) if batch.size else np.zeros(3)
        craft = middle + rng.uniform((-2, -2, -1), (2, 2, 8))
        known = rng.random() < 0.9
        position = tuple(craft.tolist()) if known else UNKNOWN_POSITION
        keyframes.append(Keyframe(batch.xyz, position=position))
    return keyframes


def one_pass(keyframes: Sequence[Keyframe], stages: Sequence[Stage]) -> SurfaceMap:
    """Return what the stages make of all points at once, by nothing but their definition."""
    points, route = gather(keyframes)
    for stage in stages:
        if isinstance(stage, PointStage):
            points = stage.apply(points, CELL)
    surface = group(points, Grid(CELL, GAP, THICKNESS))
    for stage in stages:
        if isinstance(stage, MapStage):
            surface = stage.apply(surface, Sights(route, lambda _: points))
    return surface


def seeing_pipeline(keyframes: Sequence[Keyframe], stages: Sequence[Stage]) -> Pipeline:
    pipeline = Pipeline(parameters_of(stages), "map", Report())
    pipeline.route = gather(keyframes).route
    return pipeline


def without_sight(stages: Sequence[Stage]) -> list[Stage]:
    return [replace(stage, sight=0) if isinstance(stage, Plaster) else stage for stage in stages]


@settings(max_examples=12)
@given(seen_flights(), seeing_stages(), st.integers(0, 100))
def test_batches_make_the_map_of_one_pass(
    flight: list[Keyframe], stages: tuple[Stage, ...], early: int
) -> None:
    changes: list[Change] = []
    builder = MapBuilder(batchwise(stages), follow=changes.append)
    surface = builder.surface
    for number, keyframe in enumerate(flight):
        builder.add(keyframe)
        if number == early:
            assert builder.surface == one_pass(flight[: number + 1], stages)
    finished = builder.finish()
    assert finished == one_pass(flight, stages)
    for change in changes:
        surface = change.applied_to(surface)
    assert surface == finished


def batchwise(stages: Sequence[Stage]) -> Parameters:
    """Return parameters with which each keyframe is a batch."""
    parameters = parameters_of(stages)
    return replace(parameters, batch=replace(parameters.batch, min_points=1))


@settings(max_examples=25)
@given(st.integers(0, 2**32 - 1), st.booleans())
def test_points_far_beside_a_gap_open_it_when_they_come(seed: int, is_filtered: bool) -> None:
    rng = np.random.default_rng(seed)
    stages: list[Stage] = [Median(nb_radius=0.3, max_nb=0, min_nb=1)] * is_filtered
    sight = Cells(int(rng.integers(3, 13)))
    stages.append(Plaster(height_clearance=0.1, max_gap=0, max_gap_enhanced=1.5, sight=sight))
    # A roof at height 4 with a gap of three cells; the ground is 2 to 12 cells beside it.
    ends = [(x + dx, y, 4.0) for x in (-0.25, 1.75) for y in (0.25, 0.75) for dx in (0, 0.1)]
    builder = MapBuilder(batchwise(stages))
    flight = [Keyframe(np.array(ends))]
    builder.add(flight[0])
    closed = [builder.surface.size]
    for _ in range(8):
        point = np.array([rng.uniform(2.5, 6.5), rng.uniform(0, 1), 0.0])
        through = np.array([rng.uniform(0, 1.5), rng.uniform(0, 1), 4.0])
        points = point + rng.uniform(-0.1, 0.1, (rng.integers(1, 3), 3))
        flight.append(Keyframe(points, position=tuple((2 * through - point).tolist())))
        builder.add(flight[-1])
        assert builder.surface == one_pass(flight, stages)
        closed.append(int((builder.surface.origin == 2).sum()))
    event("opened" if min(closed) < closed[1] else "closed all along")


def test_lines_open_gaps_in_many_flights_and_later_batches_what_was_closed() -> None:
    seen: Counter[str] = Counter()

    @settings(max_examples=35, derandomize=True, database=None)
    @given(seen_flights(), seeing_stages())
    def look(flight: list[Keyframe], stages: tuple[Stage, ...]) -> None:
        surface = one_pass(flight, stages)
        seen["lines matter"] += surface != one_pass(flight, without_sight(stages))
        if len(flight) > 1:
            half = len(flight) // 2
            dark = [replace(each, position=UNKNOWN_POSITION) for each in flight[half:]]
            seen["later lines matter"] += surface != one_pass([*flight[:half], *dark], stages)

    look()
    assert seen["lines matter"] > 5
    assert seen["later lines matter"] > 2


@settings(max_examples=25)
@given(
    seen_flights(),
    seeing_stages(),
    st.integers(0, 6),
    st.integers(0, 400),
    st.sampled_from([1, 3]),
    st.data(),
)
def test_tiles_and_windows_make_the_map_of_one_pass(
    flight: list[Keyframe],
    stages: tuple[Stage, ...],
    shift: int,
    most: int,
    threads: int,
    data: st.DataObject,
) -> None:
    pipeline, expected = seeing_pipeline(flight, stages), one_pass(flight, stages)
    points = gather(flight).points
    blocks = PointBlocks(CELL, shift=shift)
    blocks.add(points)
    tiles = tiles_of(blocks, pipeline.reach, most)
    surface = join(pipeline.grid, list(evaluate_tiles(pipeline, blocks, tiles, Threads(threads))))
    assert surface == expected
    x, y = data.draw(st.sampled_from(cells_of(points) or [(0, 0)]))
    west, south = x - data.draw(st.integers(-2, 5)), y - data.draw(st.integers(-2, 5))
    limits = Limits(west, west + data.draw(st.integers(0, 5)), south, None)
    there = points_around(pipeline, blocks, limits)
    assert evaluate(pipeline, there, limits).surface == expected.crop(*limits)


def cells_of(points: Points) -> list[tuple[int, int]]:
    return [(x, y) for x, y in np.floor(points.xyz[:, :2] / CELL).astype(int).tolist()]


def roof() -> tuple[list[Keyframe], list[Stage]]:
    """Return a flight over a roof with a gap, through which the ground is seen by its last half."""
    rng = np.random.default_rng(3)
    xyz: Float64 = rng.uniform((0, 0, 0), (12, 6, 0.02), (3000, 3))
    xyz[:, 2] += 2.0
    inside = (xyz[:, 0] > 5) & (xyz[:, 0] < 6.4)
    xyz[inside, 2] -= 1.8
    above = (xyz[:, 0] - 5.7, xyz[:, 1] - 3)
    inside &= above[0] ** 2 + above[1] ** 2 < 1
    parts = [*np.array_split(xyz[~inside], 6), *np.array_split(xyz[inside], 3)]
    keyframes = [Keyframe(part, position=(5.7, 3.0, 9.0)) for part in parts]
    return keyframes, [Plaster(max_gap=CELL, max_gap_enhanced=2.0, sight=Cells(4))]


def test_threads_disk_and_workers_follow_sight_lines(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    keyframes, stages = roof()
    expected = one_pass(keyframes, stages)
    assert expected != one_pass(keyframes, without_sight(stages))
    monkeypatch.setattr(tilewise, "WORTHWHILE_POINTS", 50)
    builder = MapBuilder(parameters_of(stages), jobs=2)
    for keyframe in keyframes:
        builder.add(keyframe)
    assert builder.finish() == expected
    rows = [
        (*point, number, *keyframe.position)
        for number, keyframe in enumerate(keyframes)
        for point in keyframe.points.tolist()
    ]
    (tmp_path / "roof.txt").write_text("\n".join(" ".join(map(repr, row)) for row in rows))
    recording = open_recording(tmp_path / "roof.txt", columns="x,y,z,keyframe,cx,cy,cz")
    with build_large(recording, parameters_of(stages), 4 * 2**30, jobs=2) as made:
        write_map(tmp_path / "roof.npz", made.surface)
    assert read_map(tmp_path / "roof.npz") == expected
    # As a tile is sent to a worker.
    pipeline = seeing_pipeline(keyframes, stages).reporting_to(Report())
    order = Order(pipeline, gather(keyframes).points, Limits(), versions())
    assert carry_out(pickle.loads(pickle.dumps(order))).surface == expected


def test_in_the_sequential_mode_the_lines_of_a_batch_count() -> None:
    keyframes, stages = roof()
    maps = []
    for chosen in (stages, without_sight(stages)):
        builder = MapBuilder(parameters_of(chosen, "sequential"))
        for keyframe in keyframes:
            builder.add(keyframe)
        builder.finish().check()
        maps.append(builder.finish())
    assert maps[0] != maps[1]


def test_sight_lines_cannot_be_followed_once_only_the_map_is_left() -> None:
    _, (plaster,) = roof()
    with pytest.raises(ConfigError, match=r"^plaster\.sight: sight lines cannot be followed after"):
        parameters_of([Regions(), plaster]).check()
    parameters_of([plaster, Regions()]).check()
    parameters_of([Regions(), *without_sight([plaster])]).check()
