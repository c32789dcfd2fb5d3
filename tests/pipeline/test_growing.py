"""Maps that grow: after every batch the map of all points so far, bit for bit.

How one could cheat: look at the map in the end only; compare with a map that grew, too; batches
of one size; points that never come near each other; a change that is the whole map; maps without
inserted patches, so that none has to vanish.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import mlscli
from mlscli.cells import cell_indices
from mlscli.config import Parameters, loads
from mlscli.keyframes import Keyframe, Points
from mlscli.parameters import in_units
from mlscli.pipeline import tilewise
from mlscli.pipeline.builder import MapBuilder
from mlscli.pipeline.change import Change
from mlscli.pipeline.grouping import group
from mlscli.pipeline.median import Median
from mlscli.pipeline.stage import MapStage, PointStage
from mlscli.surface_map import SurfaceMap
from mlscli.typing import Array
from tests.maps import CELL, random_points

SIZES = "map: {cell_size: 0.5, gap_size: 0.75, thickness: 0.25}\n"
MEDIAN = "  - median: {nb_radius: 0.8, max_nb: 6, min_nb: 2, recentre: 0.3}\n"
TWICE = MEDIAN + "  - median: {nb_radius: 0.6, max_nb: 0, min_nb: 1}\n"
ORPHANS = "  - orphans: {horizontal: 1.0, vertical: 0.5, min_neighbours: 1}\n"
GAPS = """
  - walls: {height_thresh: 0.5, max_gap: 0.5, max_gap_enhanced: 1.5, join: 0.6}
  - plaster: {height_thresh: 0.5, height_clearance: 0.2, max_gap: 0.5, max_gap_enhanced: 1.5}
"""
PYRAMIDS = "  - pyramids: {height_factor_thresh: 0.5, pits: true}\n"
LIMITED = "  - plaster: {max_gap: 1.0, max_gap_enhanced: 0, min_x: -2, max_x: 1, min_y: -1}\n"
REGIONS = "  - regions: {height_thresh: 0.3, min_size: 2}\n"
PIPELINES = {
    "no stage": "pipeline: []",
    "points only": "pipeline:\n" + TWICE,
    "map only": "pipeline:\n" + ORPHANS + GAPS + PYRAMIDS,
    "every stage": "pipeline:\n" + MEDIAN + ORPHANS + GAPS + PYRAMIDS,
    "within limits": "pipeline:\n" + MEDIAN + LIMITED + PYRAMIDS,
    "twice": "pipeline:\n" + TWICE + GAPS + PYRAMIDS + GAPS,
    "regions last": "pipeline:\n" + MEDIAN + GAPS + REGIONS + PYRAMIDS,
}
seeds = st.integers(0, 2**32 - 1)


def parameters(pipeline: str, mode: str = "consistent") -> Parameters:
    return loads(f"mode: {mode}\n{SIZES}{pipeline}")


def one_pass(points: Points, given_parameters: Parameters, *, final: bool) -> SurfaceMap:
    """Return what the stages make of all points at once, by nothing but their definition."""
    sizes = given_parameters.map
    cell_size = float(sizes.cell_size)
    grid = (
        cell_size,
        in_units(sizes.gap_size, cell_size),
        in_units(sizes.thickness, cell_size),
    )
    bounded = True
    surface = None
    for stage in given_parameters.pipeline:
        if isinstance(stage, PointStage):
            points = stage.apply(points, cell_size)
            continue
        assert isinstance(stage, MapStage)
        surface = group(points, *grid) if surface is None else surface
        bounded = bounded and stage.reach(cell_size) is not None
        surface = stage.apply(surface) if bounded or final else surface
    return group(points, *grid) if surface is None else surface


def batches_of(points: Points, size: int) -> Iterator[Points]:
    """Yield the points `size` at a time, each batch a keyframe of its own."""
    for number, begin in enumerate(range(0, points.size, size)):
        xyz = points.xyz[begin : begin + size]
        yield Points(xyz, np.full(len(xyz), number, dtype=np.int32))


def together(batches: list[Points]) -> Points:
    return Points(*(np.concatenate(column) for column in zip(*batches, strict=True)))


@settings(max_examples=30, deadline=None)
@given(seeds, st.integers(1, 60), st.sampled_from(sorted(PIPELINES)))
def test_after_every_batch_the_map_is_that_of_one_pass(seed: int, size: int, stages: str) -> None:
    rng = np.random.default_rng(seed)
    points = random_points(rng)
    far = rng.random(points.size) < 0.02
    points.xyz[far, :2] += rng.choice([-1e6, 40.0, 1e6], (int(far.sum()), 2))
    given_parameters = parameters(PIPELINES[stages])
    followed: list[Change] = []
    builder = MapBuilder(given_parameters, follow=followed.append)
    so_far: list[Points] = []
    # What a follower knows of the map, who has been told of nothing but changes.
    seen = builder.surface
    assert not followed
    for batch in batches_of(points, size):
        before = seen
        so_far.append(batch)
        change = builder.process_cloud(batch.xyz)
        expected = one_pass(together(so_far), given_parameters, final=False)
        assert builder.surface == expected
        assert followed.pop() is change
        assert not followed
        seen = change.applied_to(before)
        assert seen == expected
        # Nothing that stays is told to go and come again.
        assert change.removed == _without(before, expected)
        assert change.added == _without(expected, before)
    if so_far:
        expected = one_pass(together(so_far), given_parameters, final=True)
        surface = builder.finish()
        assert surface == expected
        surface.check()
        account = surface.meta["points"]
        assert account["read"] == points.size
        assert account["kept"] == expected.count.sum()
        assert account["dropped"] == _dropped(together(so_far), given_parameters)


def _without(surface: SurfaceMap, other: SurfaceMap) -> SurfaceMap:
    rows = [
        {row.tobytes() for row in np.stack([_bits(c) for c in each.columns.values()], axis=1)}
        if each.size
        else set()
        for each in (surface, other)
    ]
    mine = [_bits(column) for column in surface.columns.values()]
    only = [np.array(row).tobytes() not in rows[1] for row in zip(*mine, strict=True)]
    return surface.take(np.array(only, dtype=np.bool_))


def _bits(column: Array) -> Array:
    return column.view(np.int64) if column.dtype == np.float64 else column.astype(np.int64)


def _dropped(points: Points, given_parameters: Parameters) -> dict[str, int]:
    """Count what each stage drops in one pass."""
    builder = MapBuilder(given_parameters)
    for number in range(int(points.keyframe.max()) + 1):
        builder.add(Keyframe(points.xyz[points.keyframe == number]))
    dropped: dict[str, int] = builder.finish().meta["points"]["dropped"]
    return dropped


@settings(max_examples=20, deadline=None)
@given(seeds, st.integers(5, 60), st.sampled_from(sorted(PIPELINES)))
def test_a_sequential_map_tells_what_each_batch_changes(seed: int, size: int, stages: str) -> None:
    points = random_points(np.random.default_rng(seed))
    builder = MapBuilder(parameters(PIPELINES[stages], "sequential"))
    seen = builder.surface
    for batch in batches_of(points, size):
        change = builder.process_cloud(batch.xyz)
        before, seen = seen, builder.surface
        assert change.applied_to(before) == seen
        assert change.removed == _without(before, seen)
        assert change.added == _without(seen, before)


class Again(Median):
    """A median by another name, so that what it drops is counted apart."""

    name = "again"


def test_points_that_two_stages_drop_are_counted_for_each() -> None:
    stages = (Median(1.0, max_nb=4, min_nb=2), Again(0.5, max_nb=0, min_nb=2))
    given_parameters = replace(parameters(PIPELINES["no stage"]), pipeline=stages)
    points = together(list(batches_of(random_points(np.random.default_rng(1), 200), 15)))
    builder = MapBuilder(given_parameters)
    for number in range(int(points.keyframe.max()) + 1):
        builder.process_cloud(points.xyz[points.keyframe == number])
    dropped = builder.surface.meta["points"]["dropped"]
    assert dropped == _dropped(points, given_parameters)
    assert set(dropped) == {"median", "again"}


def test_a_plastered_patch_goes_where_its_cell_is_measured() -> None:
    builder = MapBuilder(parameters(f"pipeline:\n{GAPS}"))
    builder.process_cloud(np.array([[0.1, 0.1, 0.0], [1.1, 0.1, 0.0]]))
    assert builder.surface.origin.tolist() == [0, 1, 0]
    change = builder.process_cloud(np.array([[0.6, 0.1, 0.1]]))
    assert change.removed.origin.tolist() == [1]
    assert change.added.origin.tolist() == [0]
    assert change.removed.ix.tolist() == change.added.ix.tolist() == [1]


def test_a_batch_changes_nothing_beyond_the_reach_of_its_points() -> None:
    x, y = (axis.ravel() * CELL + 0.1 for axis in np.meshgrid(np.arange(60), np.arange(60)))
    rng = np.random.default_rng(3)
    builder = MapBuilder(parameters(PIPELINES["every stage"]))
    builder.process_cloud(np.column_stack((x, y, rng.normal(0, 0.1, len(x)))))
    at = np.array([[10.1, 10.1, 0.05]])
    change = builder.process_cloud(at)
    assert change.added.size > 0
    stages = builder.parameters.pipeline
    reach = sum(s.reach(CELL) or 0 for s in stages if isinstance(s, PointStage | MapStage))
    ix, iy = cell_indices(at[0, :2], CELL)
    for surface in change:
        assert np.abs(surface.ix - ix).max(initial=0) <= reach
        assert np.abs(surface.iy - iy).max(initial=0) <= reach


def test_looking_does_not_change_the_map() -> None:
    points = random_points(np.random.default_rng(5), 300)
    surfaces = []
    for looks in (False, True):
        builder = MapBuilder(parameters(PIPELINES["regions last"]))
        for batch in batches_of(points, 40):
            builder.add(Keyframe(batch.xyz))
            if looks:
                # Points that wait for a batch are not in the map yet.
                assert builder.surface.meta["points"]["read"] >= builder.surface.count.sum()
        surfaces.append(builder.finish())
    assert surfaces[0] == surfaces[1]
    assert surfaces[0].meta == surfaces[1].meta


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("tello_kf_pointData.csv", {"columns": "x,y,z,-,-,-,-,keyframe,cx,cy,cz", "up": "-y"}),
        ("euroc_orb2_MapPoints.txt", {}),
    ],
)
def test_a_recorded_flight_grows_alike_in_batches_of_any_size(
    shared_data: Path, name: str, options: dict[str, Any]
) -> None:
    recording = mlscli.open_recording(shared_data / "sparse" / name, **options)
    xyz = np.concatenate([keyframe.points for keyframe in recording.keyframes()])
    given_parameters = mlscli.load_parameters(None, ["map.cell_size=0.05"])
    ends = np.cumsum([20, 52, 80, 300, 1000] * (len(xyz) // 1452 + 1))
    clouds = np.split(xyz, ends[ends < len(xyz)])
    batches = [
        Points(cloud, np.full(len(cloud), number, dtype=np.int32))
        for number, cloud in enumerate(clouds)
    ]
    builder = MapBuilder(given_parameters)
    for number, batch in enumerate(batches):
        builder.process_cloud(batch.xyz)
        if number % 9 == 0:
            expected = one_pass(together(batches[: number + 1]), given_parameters, final=False)
            assert builder.surface == expected
    surface = builder.finish()
    surface.check()
    assert surface == one_pass(together(batches), given_parameters, final=True)
    assert set(surface.origin.tolist()) == {0, 1, 2}
    assert surface.meta["points"]["dropped"] == _dropped(together(batches), given_parameters)


def test_a_building_of_storeys_grows_and_is_tiled_alike(
    shared_data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ply = shared_data / "multilevel/building_floors_cgal.ply"
    header = ply.read_text()[:2000].partition("end_header")[0].count("\n") + 1
    xyz = np.loadtxt(ply, skiprows=header, usecols=(0, 1, 2))
    xyz = np.random.default_rng(1).permutation(xyz)[:20_000]
    given_parameters = mlscli.load_parameters(None, ["map.cell_size=0.5", "map.gap_size=1.5"])
    ends = len(xyz) - np.cumsum([1000, 300, 80, 52, 20])
    batches = [
        Points(cloud, np.full(len(cloud), number, dtype=np.int32))
        for number, cloud in enumerate(np.split(xyz, ends[::-1]))
    ]
    expected = one_pass(together(batches), given_parameters, final=True)
    growing = MapBuilder(given_parameters)
    for batch in batches:
        growing.process_cloud(batch.xyz)
    assert growing.surface == expected
    monkeypatch.setattr(tilewise, "WORTHWHILE", 1)
    tiled = MapBuilder(given_parameters, jobs=2)
    for batch in batches:
        tiled.add(Keyframe(batch.xyz))
    assert tiled.finish() == expected
