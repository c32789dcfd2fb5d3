"""One map, wherever it is evaluated: in windows, tiles, threads or on disk, turned or shuffled.

How one could cheat: one tile, or one thread, whatever is asked for; margins that are the whole
map; tiles only where there are points, so that what is inserted between them is lost; the default
list of stages; symmetries of single stages only, or of maps without gaps; files left in folders
that have other names, or while nothing was ever put there.
"""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from mlscli.building import large
from mlscli.building.builder import MapBuilder
from mlscli.building.large import build_large
from mlscli.io.reading.recording import open_recording
from mlscli.io.writing.npz import read_map, write_map
from mlscli.keyframes.batches import Points
from mlscli.keyframes.keyframe import Keyframe
from mlscli.maps.cells import CellSet, Limits, pack
from mlscli.maps.grid import Grid
from mlscli.maps.surface_map import SurfaceMap
from mlscli.pipeline.grouping import group
from mlscli.pipeline.pipeline import Pipeline
from mlscli.pipeline.report import Report
from mlscli.pipeline.stages.orphans import Orphans
from mlscli.pipeline.stages.plaster import Plaster
from mlscli.pipeline.stages.pyramids import Pyramids
from mlscli.pipeline.stages.stage import MapStage, Stage
from mlscli.pipeline.stages.walls import Walls
from mlscli.pipeline.tilewise import tiles as tilewise
from mlscli.pipeline.tilewise.blocks import PointBlocks
from mlscli.pipeline.tilewise.tiles import (
    Threads,
    evaluate,
    evaluate_tiles,
    join,
    points_around,
    tiles_of,
)
from tests.helpers.bags import Sent, write_bag
from tests.helpers.maps import (
    CELL,
    GAP,
    THICKNESS,
    Patch,
    map_of,
    symmetries,
    turned_map,
    turned_points,
)
from tests.helpers.pipelines import (
    clouds,
    eventful_points,
    flights,
    in_batches,
    parameters_of,
    points_at,
    stage_lists,
)
from tests.pipeline.test_growing import one_pass, together


@settings(max_examples=25)
@given(clouds(), stage_lists(), st.integers(0, 5), st.data())
def test_a_window_shows_what_the_whole_map_has_there(
    points: Points, stages: tuple[Stage, ...], shift: int, data: st.DataObject
) -> None:
    pipeline = Pipeline(parameters_of(stages), "map", Report())
    expected = one_pass(points, parameters_of(stages), final=False)
    blocks = in_blocks(points, shift)
    cells = np.floor(points.xyz[:, :2] / CELL).astype(np.int64).tolist() or [(0, 0)]
    for _ in range(5):
        # Some lie beside all points; some have no end on a side.
        low = [at - data.draw(st.integers(-2, 7)) for at in data.draw(st.sampled_from(cells))]
        high = [least + data.draw(st.integers(0, 8)) for least in low]
        ends = [data.draw(st.sampled_from([end, end, end, None])) for end in (*low, *high)]
        limits = Limits(ends[0], ends[2], ends[1], ends[3])
        points_there = points_around(pipeline, blocks, limits)
        assert evaluate(pipeline, points_there, limits).surface == expected.crop(*limits)


@pytest.mark.parametrize(
    "stage",
    [
        Orphans(horizontal=1.3, vertical=0.3, min_neighbours=2),
        Walls(max_gap=1.1, max_gap_enhanced=1.6, join=0.5),
        Plaster(max_gap=1.0, max_gap_enhanced=1.0, height_clearance=0.5),
        Pyramids(height_factor_thresh=0.0, max_height=GAP, pits=True),
    ],
)
def test_a_cell_needs_what_lies_within_the_reach_and_nothing_beyond(stage: MapStage) -> None:
    reach = stage.reach(CELL)
    assert reach is not None
    for seed in range(25):
        surface = group(eventful_points(seed, 200), Grid(CELL, GAP, THICKNESS))
        whole = stage.apply(surface)
        for key in np.unique(pack(whole.ix, whole.iy)):
            cell = CellSet(np.array([key]))
            near = surface.in_cells(cell.widened(reach))
            assert stage.apply(near).in_cells(cell) == whole.in_cells(cell)


def test_what_pass_one_closes_beyond_keeps_pass_two_from_closing() -> None:
    # In pass one (1, 4) is closed, by two cells. So in pass two what looks from -1 meets that,
    # which looks back at 1; without 4 it would meet 3, across the cell 0.
    heights = {-1: 0.0, 1: 1.2, 3: -0.3, 4: 0.9}
    surface = map_of([Patch(x, 0, z, 0.0, 0, 5) for x, z in heights.items()])
    stage = Plaster(
        height_thresh=1, height_clearance=0, max_gap=2 * CELL, max_gap_enhanced=3 * CELL
    )
    cell = CellSet.of(np.array([0]), np.array([0]))
    assert stage.apply(surface).in_cells(cell).size == 0
    assert stage.apply(surface.crop(max_x=3)).in_cells(cell).size == 1
    near = surface.in_cells(cell.widened(stage.reach(CELL)))
    assert stage.apply(near).in_cells(cell).size == 0


@settings(max_examples=25)
@given(
    clouds(), stage_lists(), st.integers(0, 6), st.integers(0, 400), st.sampled_from([1, 2, 3, 8])
)
def test_tiles_from_one_cell_to_the_whole_map_make_the_map_of_one_pass(
    points: Points, stages: tuple[Stage, ...], shift: int, most: int, threads: int
) -> None:
    report = Report()
    pipeline = Pipeline(parameters_of(stages), "map", report)
    blocks = in_blocks(points, shift)
    tiles = tiles_of(blocks, pipeline.reach, most)
    if most == shift == 0:
        assert len(tiles) == max(1, len(blocks.occupied().points))
    surface = join(pipeline.grid, list(evaluate_tiles(pipeline, blocks, tiles, Threads(threads))))
    assert surface == one_pass(points, parameters_of(stages), final=False)
    once = Report()
    counted = Pipeline(parameters_of(stages), "map", once)
    counted.run_map_stages(counted.filter_and_group(points))
    assert report.dropped == once.dropped


@settings(max_examples=15)
@given(flights(), stage_lists(), st.integers(1, 100))
def test_a_builder_makes_one_map_with_any_number_of_threads(
    flight: list[Points], stages: tuple[Stage, ...], worthwhile: int
) -> None:
    before = tilewise.WORTHWHILE_POINTS
    maps = []
    try:
        tilewise.WORTHWHILE_POINTS = worthwhile
        for jobs in (None, 1, 2, 3, 8):
            builder = MapBuilder(parameters_of(stages), jobs=jobs)
            for batch in flight:
                builder.add(Keyframe(batch.xyz))
            maps.append(builder.finish())
    finally:
        tilewise.WORTHWHILE_POINTS = before
    points = together(flight)
    expected = one_pass(points, parameters_of(stages), final=True)
    for surface in maps:
        assert surface == expected
        assert surface.meta == maps[0].meta


@settings(max_examples=20)
@given(clouds(), stage_lists(), st.sampled_from([1, 2, 3, 8]), st.data())
def test_a_map_made_on_disk_is_the_map_of_one_pass(
    tmp_path_factory: pytest.TempPathFactory,
    cloud: Points,
    stages: tuple[Stage, ...],
    jobs: int,
    data: st.DataObject,
) -> None:
    points = together([*in_batches(cloud, [30, 90])])
    expected = one_pass(points, parameters_of(stages), final=True)
    assume(expected.size > 0)
    folder = tmp_path_factory.mktemp("disk")
    rows = np.column_stack(points)
    (folder / "cloud.txt").write_text("\n".join(" ".join(map(repr, row)) for row in rows.tolist()))
    (folder / "scratch").mkdir()
    recording = open_recording(folder / "cloud.txt", columns="x,y,z,keyframe")
    with pytest.MonkeyPatch.context() as patch:
        # Memory for so many points to be sorted, patches to be put in order, points in a tile.
        room = 2 * large.LEAST_BYTES
        patch.setattr(large, "resident", lambda: 100 * 2**20)
        patch.setattr(large, "SORTED", room // (2 * data.draw(st.integers(1, 300))))
        patch.setattr(large, "ORDERED", room // (2 * data.draw(st.integers(1, 300))))
        patch.setattr(large, "COMFORTABLE_POINTS", data.draw(st.integers(1, 400)))
        with build_large(
            recording,
            parameters_of(stages),
            100 * 2**20 + room,
            scratch=folder / "scratch",
            jobs=jobs,
        ) as made:
            write_map(folder / "map.npz", made.surface)
    assert read_map(folder / "map.npz") == expected
    assert list((folder / "scratch").iterdir()) == []


def in_blocks(points: Points, shift: int) -> PointBlocks:
    """Return blocks of ``2**shift`` cells of points that came in two runs."""
    blocks = PointBlocks(CELL, shift=shift)
    for part in np.array_split(np.arange(points.size), 2):
        blocks.add(points_at(points, part))
    return blocks


@settings(max_examples=25)
@given(clouds(), stage_lists(limits=False))
def test_shuffling_and_turning_the_points_shuffles_and_turns_the_map(
    cloud: Points, stages: tuple[Stage, ...]
) -> None:
    parameters = parameters_of(stages)
    batches = list(in_batches(cloud, [90, 1, 40]))
    points = together(batches)
    surface = one_pass(points, parameters, final=True)
    order = np.random.default_rng(points.size).permutation(points.size)
    for symmetry in symmetries():
        expected = renumbered(turned_map(surface, symmetry))
        shuffled = points_at(turned_points(points, symmetry), order)
        assert renumbered(one_pass(shuffled, parameters, final=True)) == expected
        builder = MapBuilder(parameters)
        for batch in batches:
            builder.process_cloud(turned_points(batch, symmetry).xyz)
        assert renumbered(builder.finish()) == expected


def renumbered(surface: SurfaceMap) -> SurfaceMap:
    """Return the map with its regions numbered in the order of the patches that are left."""
    known = surface.region >= 0
    _, first, which = np.unique(surface.region[known], return_index=True, return_inverse=True)
    region = surface.region.copy()
    region[known] = np.argsort(np.argsort(first))[which]
    return surface.with_columns(region=region)


# --- nothing is left behind ---


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="no /proc tells of open files")
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_a_build_that_is_ended_half_way_leaves_no_file(
    tmp_path: Path, number: signal.Signals
) -> None:
    rng = np.random.default_rng(1)
    write_bag(tmp_path / "flight.bag", [Sent(rng.uniform(0, 60, (100_000, 3)))] * 4)
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    command = [sys.executable, "-m", "mlscli", "build", "flight.bag", "--memory", "1G"]
    command += ["--set", "map.cell_size=0.2", "--scratch", str(scratch)]
    with subprocess.Popen(
        command,
        cwd=tmp_path,
        stderr=subprocess.PIPE,
        text=True,
        # Where tests run in the background, interrupts are ignored.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    ) as process:
        while not opened_in(scratch, process.pid):
            assert process.poll() is None
            time.sleep(0.02)
        process.send_signal(number)
        _, errors = process.communicate(timeout=60)
    assert process.returncode == (143 if number == signal.SIGTERM else -number)
    assert "Traceback" not in errors
    assert sorted(path.name for path in tmp_path.iterdir()) == ["flight.bag", "scratch"]
    assert list(scratch.iterdir()) == []


def opened_in(folder: Path, process: int) -> bool:
    """Tell whether a process has put something into a file in a folder, its name gone or not."""
    for descriptor in Path(f"/proc/{process}/fd").iterdir():
        try:
            if descriptor.readlink().is_relative_to(folder) and descriptor.stat().st_size > 0:
                return True
        except OSError:
            continue
    return False
