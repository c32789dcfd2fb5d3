"""Maps that grow: single cases, and recorded flights.

How one could cheat: look at the map in the end only; compare with a map that grew, too; batches
of one size; points that never come near each other; a change that is the whole map. What holds
whatever grows is tested in test_growing_properties.py.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import strategies as st

import mlscli
from mlscli.building.builder import MapBuilder
from mlscli.config import loads
from mlscli.keyframes.batches import Points, gather
from mlscli.keyframes.keyframe import Keyframe
from mlscli.maps.cells import cell_indices
from mlscli.maps.grid import Grid
from mlscli.maps.surface_map import SurfaceMap
from mlscli.parameters.lengths import Cells, in_units
from mlscli.pipeline.grouping import group
from mlscli.pipeline.parameters import Parameters
from mlscli.pipeline.stages.median import Median
from mlscli.pipeline.stages.stage import MapStage, PointStage
from mlscli.pipeline.tilewise import tiles as tilewise
from tests.helpers.maps import CELL, random_points

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
    assert isinstance(sizes.gap_size, float | Cells)
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
        surface = group(points, Grid(*grid)) if surface is None else surface
        bounded = bounded and stage.reach(cell_size) is not None
        surface = stage.apply(surface) if bounded or final else surface
    return group(points, Grid(*grid)) if surface is None else surface


def batches_of(points: Points, size: int) -> Iterator[Points]:
    """Yield the points `size` at a time, each batch a keyframe of its own."""
    for number, begin in enumerate(range(0, points.size, size)):
        xyz = points.xyz[begin : begin + size]
        yield Points.of(xyz, np.full(len(xyz), number, dtype=np.int32))


def together(batches: Iterable[Points]) -> Points:
    columns = zip(gather([]).points, *batches, strict=True)
    return Points(*(np.concatenate(column) for column in columns))


def _dropped(points: Points, given_parameters: Parameters) -> dict[str, int]:
    """Count what each stage drops in one pass."""
    builder = MapBuilder(given_parameters)
    for number in range(int(points.keyframe.max()) + 1):
        builder.add(Keyframe(points.xyz[points.keyframe == number]))
    dropped: dict[str, int] = builder.finish().meta["points"]["dropped"]
    return dropped


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
    for surface in (change.removed, change.added):
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
    given_parameters = mlscli.load_parameters(None, ["map.cell_size=0.05", "map.gap_size=null"])
    ends = np.cumsum([20, 52, 80, 300, 1000] * (len(xyz) // 1452 + 1))
    clouds = np.split(xyz, ends[ends < len(xyz)])
    batches = [
        Points.of(cloud, np.full(len(cloud), number, dtype=np.int32))
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
        Points.of(cloud, np.full(len(cloud), number, dtype=np.int32))
        for number, cloud in enumerate(np.split(xyz, ends[::-1]))
    ]
    expected = one_pass(together(batches), given_parameters, final=True)
    growing = MapBuilder(given_parameters)
    for batch in batches:
        growing.process_cloud(batch.xyz)
    assert growing.surface == expected
    monkeypatch.setattr(tilewise, "WORTHWHILE_POINTS", 1)
    tiled = MapBuilder(given_parameters, jobs=2)
    for batch in batches:
        tiled.add(Keyframe(batch.xyz))
    assert tiled.finish() == expected
