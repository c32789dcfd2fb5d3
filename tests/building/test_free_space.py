"""The free space of a map: the same however it is built, and true to what was there.

How one could cheat: batches whose points no later batch moves or drops; tiles as wide as the map;
free space that holds nothing, which is never wrong.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mlscli.building import large
from mlscli.building.build import build
from mlscli.building.builder import MapBuilder
from mlscli.building.large import build_large
from mlscli.errors import InputError, UsageError
from mlscli.io.reading.recording import open_recording
from mlscli.io.writing.npz import read_map, write_map
from mlscli.keyframes.batches import Points, gather
from mlscli.keyframes.keyframe import UNKNOWN_POSITION, Keyframe
from mlscli.maps.change import Change
from mlscli.maps.free_space import FreeSpace
from mlscli.maps.space import FREE, space_at
from mlscli.pipeline.line_counts import LineCounts
from mlscli.pipeline.parameters import Parameters
from mlscli.pipeline.pipeline import Pipeline
from mlscli.pipeline.report import Report
from mlscli.pipeline.stages.median import Median
from mlscli.pipeline.stages.stage import PointStage, Stage
from mlscli.pipeline.tilewise.blocks import PointBlocks
from mlscli.pipeline.tilewise.tiles import Threads, evaluate_tiles, tiles_of
from mlscli.runtime.arrays import Bool, Float64
from mlscli.runtime.notices import hear
from mlscli.scenes.flight import Flight
from mlscli.trials.quality import flown
from tests.building.test_seen_maps import roof, seeing_stages, seen_flights
from tests.helpers.maps import CELL
from tests.helpers.pipelines import parameters_of


def keeping(stages: Sequence[Stage], mode: str = "consistent") -> Parameters:
    """Return parameters with which each keyframe is a batch, and free space is kept."""
    parameters = parameters_of(stages, mode).with_free_space()
    return replace(parameters, batch=replace(parameters.batch, min_points=1))


def filtered(points: Points, stages: Sequence[Stage]) -> Points:
    for stage in stages:
        if isinstance(stage, PointStage):
            points = stage.apply(points, CELL)
    return points


def seen_through(keyframes: Sequence[Keyframe], stages: Sequence[Stage]) -> FreeSpace:
    """Return the free space of all points at once, by nothing but its definition."""
    points, route = gather(keyframes)
    counts = LineCounts(CELL)
    counts.add(filtered(points, stages), route)
    return counts.free_space()


@settings(max_examples=9)
@given(seen_flights(), seeing_stages(), st.integers(0, 100))
def test_batches_make_the_free_space_of_one_pass(
    flight: list[Keyframe], stages: tuple[Stage, ...], early: int
) -> None:
    changes: list[Change] = []
    builder, growing = (
        MapBuilder(keeping(stages)),
        MapBuilder(keeping(stages), follow=changes.append),
    )
    for number, keyframe in enumerate(flight):
        builder.add(keyframe)
        growing.add(keyframe)
        if number == early:
            assert growing.surface.free == seen_through(flight[: number + 1], stages)
    expected = seen_through(flight, stages)
    assert builder.finish().free == expected
    assert growing.finish().free == expected
    assert growing.surface == builder.surface


@settings(max_examples=9)
@given(
    seen_flights(), seeing_stages(), st.integers(0, 6), st.integers(0, 400), st.sampled_from([1, 3])
)
def test_tiles_make_the_free_space_of_one_pass(
    flight: list[Keyframe], stages: tuple[Stage, ...], shift: int, most: int, threads: int
) -> None:
    pipeline = Pipeline(keeping(stages), "map", Report())
    points, pipeline.route = gather(flight)
    blocks = PointBlocks(CELL, shift=shift)
    blocks.add(points)
    tiles = tiles_of(blocks, pipeline.reach, most)
    counts = pipeline.line_counts()
    assert counts is not None
    list(evaluate_tiles(pipeline, blocks, tiles, Threads(threads), counts=counts))
    assert counts.free_space() == seen_through(flight, stages)


def test_what_a_batch_drops_or_moves_of_earlier_ones_counts_as_it_stands_at_last() -> None:
    rng = np.random.default_rng(1)
    stages = [Median(nb_radius=0.8, max_nb=6, min_nb=3)]
    flight = [
        Keyframe(rng.uniform((0, 0, 0), (2, 2, 0.3), (9, 3)), position=(1.1, 1.2, 6.3))
        for _ in range(12)
    ]
    changes: list[Change] = []
    builder = MapBuilder(keeping(stages), follow=changes.append)
    apart = LineCounts(CELL)
    for number, keyframe in enumerate(flight):
        builder.add(keyframe)
        apart.add(filtered(gather([keyframe]).points, stages), gather([keyframe]).route)
        assert builder.surface.free == seen_through(flight[: number + 1], stages)
    assert builder.finish().free != apart.free_space()


def test_in_the_sequential_mode_each_batch_counts_as_it_was_filtered() -> None:
    keyframes, stages = roof()
    stages = [Median(nb_radius=0.8, max_nb=6, min_nb=2), *stages]
    builder, expected = MapBuilder(keeping(stages, "sequential")), LineCounts(CELL)
    for keyframe in keyframes:
        builder.add(keyframe)
        expected.add(filtered(gather([keyframe]).points, stages), gather([keyframe]).route)
    assert builder.finish().free == expected.free_space()
    assert builder.finish().free != seen_through(keyframes, stages)


def written(keyframes: Sequence[Keyframe], path: Path) -> Path:
    rows = [
        (*point, number, *keyframe.position)
        for number, keyframe in enumerate(keyframes)
        for point in keyframe.points.tolist()
    ]
    path.write_text("\n".join(" ".join(map(repr, row)) for row in rows))
    return path


COLUMNS = "x,y,z,keyframe,cx,cy,cz"


def test_threads_and_limited_memory_make_the_same_and_files_keep_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    keyframes, stages = roof()
    expected = seen_through(keyframes, stages)
    assert expected.size > 1000
    path = written(keyframes, tmp_path / "roof.txt")
    monkeypatch.setattr("mlscli.pipeline.tilewise.tiles.WORTHWHILE_POINTS", 50)
    for jobs in (None, 2):
        recording = open_recording(path, columns=COLUMNS)
        assert build(recording, keeping(stages), jobs=jobs).surface.free == expected
    recording = open_recording(path, columns=COLUMNS)
    with build_large(recording, keeping(stages), 4 * 2**30, jobs=2) as made:
        write_map(tmp_path / "roof.npz", made.surface)
    surface = read_map(tmp_path / "roof.npz")
    assert surface.free == expected
    assert surface == build(open_recording(path, columns=COLUMNS), keeping(stages)).surface
    # Nobody asked for it.
    assert build(recording, parameters_of(stages)).surface.free is None


def test_too_little_memory_is_told_with_how_much_is_enough(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    keyframes, stages = roof()
    path = written(keyframes, tmp_path / "roof.txt")
    room = 2 * large.LEAST_BYTES
    monkeypatch.setattr(large, "resident", lambda: 100 * 2**20)
    monkeypatch.setattr(large, "FREE_SHARE", 10**5)
    with (
        pytest.raises(UsageError, match=r"`memory`: 164M is too little: so much space was seen"),
        build_large(open_recording(path, columns=COLUMNS), keeping(stages), 100 * 2**20 + room),
    ):
        pass


def test_without_any_position_there_is_an_error_and_with_some_a_notice() -> None:
    keyframes, stages = roof()
    heard: list[str] = []
    hear(heard.append)
    blind = np.concatenate([keyframe.points for keyframe in keyframes])
    with pytest.raises(InputError, match=r"`free_space`: where the craft was is not known of any"):
        build(blind, keeping(stages))
    builder = MapBuilder(keeping(stages))
    builder.process_cloud(blind)
    assert builder.finish().free == FreeSpace.of_none()
    assert heard == []


def test_some_keyframes_without_a_position_are_told(tmp_path: Path) -> None:
    keyframes, stages = roof()
    path = written(keyframes[:3], tmp_path / "roof.txt")
    rows = path.read_text().splitlines()
    first = len(keyframes[0].points)
    rows[:first] = [" ".join([*row.split()[:4], "nan nan nan"]) for row in rows[:first]]
    path.write_text("\n".join(rows))
    heard: list[str] = []
    hear(heard.append)
    surface = build(open_recording(path, columns=COLUMNS), keeping(stages)).surface
    dark = [replace(keyframes[0], position=UNKNOWN_POSITION), *keyframes[1:3]]
    assert surface.free == seen_through(dark, stages)
    assert [line for line in heard if "is not known of 1 of 3 keyframes" in line]


def test_lines_that_are_too_long_are_left_out_and_told(tmp_path: Path) -> None:
    keyframes, stages = roof()
    far = replace(keyframes[0], position=(5.0, 3.0, 1e9 * CELL))
    heard: list[str] = []
    hear(heard.append)
    path = written([far, *keyframes[1:]], tmp_path / "far.txt")
    surface = build(open_recording(path, columns=COLUMNS), keeping(stages)).surface
    assert surface.free == seen_through(keyframes[1:], stages)
    (told,) = (line for line in heard if "sight lines are left out" in line)
    assert f"{len(far.points):,} sight lines" in told


def hidden(places: Float64, flight: Flight) -> Bool:
    """Return which places no keyframe could see: a surface of the scene lies between."""
    craft = np.array([keyframe.position for keyframe in flight.keyframes])[:, None]
    blocked = np.zeros((len(craft), len(places)), dtype=np.bool_)
    for surface in flight.scene.surfaces:
        corner, along, across = map(np.array, (surface.corner, surface.along, surface.across))
        normal = np.cross(along, across)
        above, beyond = (craft - corner) @ normal, (places - corner) @ normal
        with np.errstate(invalid="ignore", divide="ignore"):
            share = above / (above - beyond)
            met = craft + share[..., None] * (places - craft) - corner
        edges = np.column_stack((along, across))
        at = met @ np.linalg.pinv(edges).T
        inside = (share > 0) & (share < 1) & ((at >= 0) & (at <= 1)).all(axis=2)
        a, b = (at * np.array(surface.lengths)).transpose(2, 0, 1)
        for open_ in surface.openings:
            inside &= ~(
                (open_.a_low < a) & (a < open_.a_high) & (open_.b_low < b) & (b < open_.b_high)
            )
        blocked |= inside
    everywhere: Bool = np.all(blocked, axis=0)
    return everywhere


@pytest.mark.parametrize("scene", ["bridge-walls", "house-storeys"])
def test_what_is_free_could_be_seen_and_what_nobody_could_see_is_not_free(scene: str) -> None:
    flight = flown(scene, 0.1, seed=1)
    builder = MapBuilder(Parameters().with_cell_size(0.15).with_free_space())
    for keyframe in flight.keyframes:
        builder.add(keyframe)
    surface = builder.finish()
    assert surface.free is not None
    sides = np.array([0.15, 0.15, 0.075])
    rng = np.random.default_rng(2)
    free = surface.free.voxels[rng.permutation(np.flatnonzero(surface.free.lines > 1))[:1200]]
    in_sight = np.zeros(len(free), dtype=np.bool_)
    for part in product((0.02, 0.5, 0.98), repeat=3):
        left = np.flatnonzero(~in_sight)
        in_sight[left] = ~hidden((free[left] + np.array(part)) * sides, flight)
    assert in_sight.mean() > 0.998
    # Deep in the ground, and anywhere in the scene.
    low, high = flight.scene.bounds
    places = rng.uniform(low, high + np.array([0, 0, 1]), (3000, 3))
    dark = hidden(places, flight)
    free_there = space_at(surface, places) == FREE
    # Each point is seen once, so that lines are sparse.
    assert free_there[~dark].mean() > 0.4
    assert free_there[dark].mean() < 0.02
    ground = rng.uniform((*low[:2], low[2] - 3), (*high[:2], low[2] - 0.15), (3000, 3))
    assert not (space_at(surface, ground) == FREE).any()
