"""From keyframes to a map, in both modes, with an account of every point.

How one could cheat: one batch only; pipelines without map stages; clouds from which nothing is
dropped; a sequential reference that uses the tiles.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mlscli.building.batching import BEYOND_GRID
from mlscli.building.build import build_map
from mlscli.building.builder import MapBuilder
from mlscli.config import loads
from mlscli.errors import ConfigError, UsageError
from mlscli.io.reading.recording import open_recording
from mlscli.keyframes.batches import Points, batches
from mlscli.keyframes.keyframe import Keyframe
from mlscli.maps.cells import CellSet
from mlscli.maps.grid import Grid
from mlscli.maps.surface_map import SurfaceMap
from mlscli.pipeline.grouping import group
from mlscli.pipeline.parameters import Parameters
from mlscli.pipeline.stages.stage import MapStage, PointStage
from tests.helpers.maps import add_measured, random_points, symmetries, turned_map, turned_points

SIZES = "map: {cell_size: 0.5, gap_size: 0.75, thickness: 0.25}\n"
EVERYTHING = """
pipeline:
  - median: {nb_radius: 0.8, max_nb: 6, min_nb: 2}
  - orphans: {horizontal: 1.0, vertical: 0.5, min_neighbours: 1}
  - walls: {height_thresh: 0.5, max_gap: 0.5, max_gap_enhanced: 1.5}
  - plaster: {height_thresh: 0.5, height_clearance: 0.2, max_gap: 0.5, max_gap_enhanced: 1.5}
  - pyramids: {height_factor_thresh: 0.5}
"""
REGIONS = "  - regions: {height_thresh: 0.3, min_size: 2, snap: true}\n"
NO_MEDIAN = EVERYTHING.replace("  - median: {nb_radius: 0.8, max_nb: 6, min_nb: 2}\n", "")
SAMPLE = Path(__file__).resolve().parents[2] / "data/samples/bridge.txt"
seeds = st.integers(0, 2**32 - 1)


def parameters(pipeline: str, mode: str = "consistent", min_points: int = 1) -> Parameters:
    return loads(f"mode: {mode}\nbatch: {{min_points: {min_points}}}\n{SIZES}{pipeline}")


def keyframes_of(points: Points) -> list[Keyframe]:
    numbers = range(int(points.keyframe.max(initial=-1)) + 1)
    return [Keyframe(points.xyz[points.keyframe == number]) for number in numbers]


def built(keyframes: Sequence[Keyframe], given_parameters: Parameters) -> SurfaceMap:
    builder = MapBuilder(given_parameters)
    for keyframe in keyframes:
        builder.add(keyframe)
    surface = builder.finish()
    surface.check()
    return surface


def sequential_reference(keyframes: Sequence[Keyframe], given_parameters: Parameters) -> SurfaceMap:
    """Return the sequential map with every step taken on the whole map."""
    sizes = given_parameters.map
    assert isinstance(sizes.cell_size, float)
    grid = sizes.cell_size, float(str(sizes.gap_size)), float(str(sizes.thickness))
    surface = SurfaceMap.of(Grid(*grid))
    for batch in batches(keyframes, given_parameters.batch.min_points):
        points = batch.points
        for stage in given_parameters.pipeline:
            if isinstance(stage, PointStage):
                points = stage.apply(points, grid[0])
        new = group(points, Grid(*grid))
        surface = add_measured(surface, new)
        for stage in given_parameters.pipeline:
            if isinstance(stage, MapStage) and (reach := stage.reach(grid[0])) is not None:
                changed = CellSet.of(new.ix, new.iy).widened(reach)
                surface = surface.replace(changed, stage.apply(surface))
    for stage in given_parameters.pipeline:
        if isinstance(stage, MapStage) and stage.reach(grid[0]) is None:
            surface = stage.apply(surface)
    return surface


@settings(max_examples=35, deadline=None)
@given(seeds, st.integers(1, 150), st.sampled_from([EVERYTHING, EVERYTHING + REGIONS, NO_MEDIAN]))
def test_sequential_tiles_do_what_the_whole_map_would(
    seed: int, min_points: int, pipeline: str
) -> None:
    keyframes = keyframes_of(random_points(np.random.default_rng(seed)))
    given_parameters = parameters(pipeline, "sequential", min_points)
    surface = built(keyframes, given_parameters)
    expected = sequential_reference(keyframes, given_parameters)
    assert replace(surface, route=expected.route) == expected


@settings(max_examples=35, deadline=None)
@given(seeds)
def test_one_batch_makes_the_same_map_in_both_modes(seed: int) -> None:
    keyframes = keyframes_of(random_points(np.random.default_rng(seed)))
    pipeline = EVERYTHING + REGIONS
    sequential = built(keyframes, parameters(pipeline, "sequential", 10_000))
    assert sequential == built(keyframes, parameters(pipeline))


def test_sequential_maps_depend_on_the_batch_and_consistent_ones_do_not() -> None:
    keyframes = keyframes_of(random_points(np.random.default_rng(1), 400))
    for mode, differ in (("sequential", True), ("consistent", False)):
        small, large = (built(keyframes, parameters(EVERYTHING, mode, n)) for n in (1, 1000))
        assert (small != large) is differ


@settings(max_examples=40, deadline=None)
@given(seeds)
def test_shuffling_and_turning_the_points_shuffles_and_turns_the_map(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = random_points(rng)
    given_parameters = parameters(EVERYTHING)
    surface = built(keyframes_of(points), given_parameters)
    order = rng.permutation(points.size)
    shuffled = points.take(order)
    assert built(keyframes_of(shuffled), given_parameters) == surface
    for symmetry in symmetries():
        turned = built(keyframes_of(turned_points(points, symmetry)), given_parameters)
        assert turned == turned_map(surface, symmetry)


@settings(max_examples=35, deadline=None)
@given(seeds, st.sampled_from(["consistent", "sequential"]), st.integers(1, 100))
def test_every_point_read_is_kept_or_dropped_for_a_reason(
    seed: int, mode: str, min_points: int
) -> None:
    points = random_points(np.random.default_rng(seed))
    surface = built(keyframes_of(points), parameters(EVERYTHING + REGIONS, mode, min_points))
    account = surface.meta["points"]
    assert account["read"] == points.size
    assert account["kept"] == surface.count.sum()
    assert account["read"] == account["kept"] + sum(account["dropped"].values())
    assert all(count > 0 for count in account["dropped"].values())


def test_batches_have_enough_points_and_lose_none() -> None:
    sizes = [3, 0, 5, 1, 1, 1, 9, 2]
    keyframes = [Keyframe(np.full((size, 3), float(k)), stamp=k) for k, size in enumerate(sizes)]
    gathered = list(batches(keyframes, 6))
    assert [batch.points.size for batch in gathered] == [8, 12, 2]
    assert np.concatenate([batch.route[:, 0] for batch in gathered]).tolist() == list(range(8))
    for batch in gathered:
        # Each point lies at the number of its keyframe.
        assert batch.points.xyz[:, 0].tolist() == batch.points.keyframe.tolist()


def test_the_route_has_a_row_for_each_keyframe_and_patches_name_theirs() -> None:
    clouds = [np.array([[0.1, 0.1, z]]) for z in (0.0, 0.1, 5.0)]
    keyframes = [
        Keyframe(cloud, stamp=10.0 + k, position=(k, 2.0, 3.0)) for k, cloud in enumerate(clouds)
    ]
    surface = built(keyframes, parameters("pipeline: []"))
    assert surface.route.tolist() == [[10.0 + k, k, 2.0, 3.0] for k in range(3)]
    assert surface.first_keyframe.tolist() == [0, 2]
    assert surface.last_keyframe.tolist() == [1, 2]


def test_points_beyond_the_grid_are_dropped_and_counted() -> None:
    far = 0.5 * 2.0**31
    xyz = np.array([[0.1, 0.1, 0.0], [far, 0.1, 0.0], [-far, 0.1, 0.0], [0.1, -far - 1, 0.0]])
    surface = built([Keyframe(xyz)], parameters("pipeline: []"))
    assert surface.ix.tolist() == [-(2**31), 0]
    assert surface.meta["points"]["dropped"] == {BEYOND_GRID: 2}


def test_stray_points_at_the_corners_of_the_grid_are_one_patch_each() -> None:
    edge = 0.5 * (2.0**31 - 1)
    xyz = np.array([[x, y, 0.0] for x in (-edge, edge) for y in (-edge, edge)])
    pipeline = "pipeline: [walls, plaster, pyramids, regions]"
    for mode in ("consistent", "sequential"):
        surface = built([Keyframe(xyz)], parameters(pipeline, mode))
        assert surface.size == 4
        assert surface.origin.tolist() == [0, 0, 0, 0]


def test_a_library_user_feeds_clouds_and_what_is_not_finite_is_counted() -> None:
    builder = MapBuilder(parameters("pipeline: []"))
    builder.process_cloud(np.array([[0.1, 0.1, 1.0], [np.nan, 0.0, 0.0]]))
    builder.process_cloud(np.array([[0.1, 0.1, -0.0]]))
    surface = builder.finish()
    assert surface.meta["points"] == {"read": 3, "dropped": {"not finite": 1}, "kept": 2}
    assert surface.meta["batches"] == 2
    assert not np.signbit(surface.bottom).any()


@pytest.mark.parametrize("looks", [False, True])
def test_a_finished_map_stays_what_it_is(looks: bool) -> None:
    points = random_points(np.random.default_rng(3), 400)
    builder = MapBuilder(parameters(EVERYTHING + REGIONS))
    for keyframe in keyframes_of(points):
        builder.add(keyframe)
        if looks:
            _ = builder.surface
    surface = builder.finish()
    dropped = dict(builder.report.dropped)
    assert surface.size > 0
    assert dropped["regions"] > 0
    for again in (builder.finish(), builder.surface):
        assert again == surface
        assert again.meta == surface.meta
    assert builder.report.dropped == dropped
    with pytest.raises(UsageError, match="the map is finished"):
        builder.process_cloud(points.xyz)


def test_a_growing_map_needs_a_number_for_its_cell_size() -> None:
    with pytest.raises(UsageError, match="cell_size"):
        MapBuilder(Parameters())


@pytest.mark.parametrize("workers", [{"jobs": 2}, {"scheduler": "tcp://nowhere:1"}])
def test_workers_for_a_map_that_grows_batch_by_batch_are_refused_unread(
    workers: dict[str, Any],
) -> None:
    recording = open_recording(SAMPLE)
    (name,) = workers
    with pytest.raises(UsageError, match=f"`{name}`: a sequential map is made batch by batch"):
        build_map(recording, parameters("", "sequential"), **workers)
    with pytest.raises(UsageError, match=f"`{name}`: does not go with `follow`; leave one"):
        build_map(recording, follow=lambda _: None, **workers)
    with pytest.raises(
        UsageError, match="`jobs`: does not go with `scheduler`, whose workers have"
    ):
        build_map(recording, jobs=2, scheduler="tcp://nowhere:1")
    assert recording.tally.keyframes == 0


def test_a_builder_refuses_workers_without_work() -> None:
    cluster: Any = object()
    with pytest.raises(UsageError, match="`cluster`: a sequential map is made batch by batch"):
        MapBuilder(parameters("", "sequential"), cluster=cluster)
    with pytest.raises(UsageError, match="`cluster`: does not go with `follow`; leave one"):
        MapBuilder(parameters(""), follow=lambda _: None, cluster=cluster)
    with pytest.raises(UsageError, match="`jobs`: does not go with `cluster`, whose workers have"):
        MapBuilder(parameters(""), jobs=2, cluster=cluster)


def test_what_the_reader_dropped_and_what_the_stages_dropped_are_both_told(tmp_path: Path) -> None:
    cloud = tmp_path / "cloud.xyz"
    rows = [f"{x / 10} {y / 10} 0" for x in range(20) for y in range(20)]
    cloud.write_text("\n".join([*rows, "nan 0 0", "50 50 50"]))
    surface = build_map(open_recording(cloud, frame="hall"), loads("map: {cell_size: 0.1}"))
    account = surface.meta["points"]
    assert account["dropped"] == {"orphans": 1, "not finite": 1}
    assert account["read"] == account["kept"] + 2 == 402
    assert surface.frame_id == "hall"


@pytest.mark.parametrize(
    ("value", "axis"),
    [*product((np.inf, -np.inf, np.nan), range(3)), (1.1e8, 2), (-1e300, 2)],
)
def test_a_builder_drops_what_is_no_measurement_and_says_so(value: float, axis: int) -> None:
    points = random_points(np.random.default_rng(2), 60).xyz
    spoilt = np.insert(points, 7, points[0], axis=0)
    spoilt[7, axis] = value
    given_parameters = parameters("pipeline: []")
    sound = built([Keyframe(points)], given_parameters)
    builder = MapBuilder(given_parameters)
    builder.add(Keyframe(spoilt))
    assert builder.finish() == sound
    reason = "beyond 1e8" if np.isfinite(value) else "not finite"
    assert builder.report.dropped == {reason: 1}
    assert builder.report.points_read == 61
    grown = MapBuilder(given_parameters)
    grown.process_cloud(spoilt)
    assert grown.finish() == sound
    assert grown.report.dropped == {reason: 1}


def test_zeros_have_no_sign_in_a_map_and_places_without_numbers_are_not_known() -> None:
    points = np.array([[-0.0, 0.25, 0.0], [0.25, 0.25, -0.0], [0.25, -0.0, -0.0]])
    given = points.copy()
    surface = built([Keyframe(given, np.inf, (0.0, -np.inf, 1.0))], parameters("pipeline: []"))
    assert surface == built([Keyframe(points + 0.0)], parameters("pipeline: []"))
    assert not np.signbit(surface.height).any()
    assert np.isnan(surface.route).all()
    # The caller's points are the caller's.
    assert given.tobytes() == points.tobytes()


def test_a_keyframe_must_hold_points() -> None:
    wrong: Any = np.zeros((6, 4))
    with pytest.raises(UsageError, match=r"`keyframe.points`: has shape \(6, 4\)"):
        MapBuilder(parameters("pipeline: []")).add(Keyframe(wrong))
    for rows in (6, 3, 4):
        with pytest.raises(UsageError, match=rf"`points`: found an array of shape \({rows}, 4\)"):
            MapBuilder(parameters("pipeline: []")).process_cloud(np.zeros((rows, 4)))


@pytest.mark.parametrize("cell_size", [5e-324, 1e-300, 1e200, 1e300])
def test_cells_that_no_arithmetic_holds_are_refused(cell_size: float) -> None:
    with pytest.raises(ConfigError, match=r"map\.cell_size: found .* at least 1e-09"):
        MapBuilder(Parameters().with_cell_size(cell_size))
