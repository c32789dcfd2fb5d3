"""The map evaluated tile by tile: one pass over all points, whatever the tiles and the threads.

How one could cheat: one tile only; a margin that is the whole map; maps in which nothing reaches
over the edge of a tile; tiles that cover only the cells with points, so that nothing inserted is
lost between them.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mlscli.building.builder import MapBuilder
from mlscli.keyframes.batches import Points, gather
from mlscli.keyframes.keyframe import Keyframe
from mlscli.maps.cells import Limits
from mlscli.maps.change import points_in
from mlscli.pipeline.pipeline import Pipeline
from mlscli.pipeline.report import Report
from mlscli.pipeline.tilewise import tiles as tilewise
from mlscli.pipeline.tilewise.blocks import PointBlocks
from mlscli.pipeline.tilewise.tiles import Threads, evaluate_tiles, join, tiles_of
from tests.helpers.maps import CELL, random_points
from tests.pipeline.test_growing import PIPELINES, one_pass, parameters

seeds = st.integers(0, 2**32 - 1)


def two_runs(points: Points, shift: int) -> PointBlocks:
    """Return blocks of ``2**shift`` cells of points that came in two runs."""
    blocks = PointBlocks(CELL, shift=shift)
    half = points.size // 2
    for part in (slice(0, half), slice(half, None)):
        blocks.add(points.take(part))
    return blocks


@settings(max_examples=35, deadline=None)
@given(
    seeds,
    st.sampled_from(sorted(PIPELINES)),
    st.integers(0, 3),
    st.sampled_from([0, 10, 50, 10**9]),
    st.sampled_from([1, 2, 5]),
)
def test_tiles_of_any_size_make_the_map_of_one_pass(
    seed: int, stages: str, shift: int, most: int, threads: int
) -> None:
    points = random_points(np.random.default_rng(seed))
    pipeline = Pipeline(parameters(PIPELINES[stages]), "map", Report())
    blocks = two_runs(points, shift)
    tiles = tiles_of(blocks, pipeline.reach, most)
    surface = join(pipeline.grid, list(evaluate_tiles(pipeline, blocks, tiles, Threads(threads))))
    expected = one_pass(points, parameters(PIPELINES[stages]), final=False)
    assert surface == expected
    assert pipeline.report.dropped.total() == points.size - points_in(expected)
    assert all(count > 0 for count in pipeline.report.dropped.values())


def test_tiles_cover_the_plane_once_and_each_has_points() -> None:
    rng = np.random.default_rng(3)
    blocks = PointBlocks(1.0, shift=1)
    xyz = rng.normal(0, 20, (500, 3))
    xyz[:4, :2] = [[-(2.0**31), 0], [2.0**31 - 1, 5], [0, -(2.0**31)], [1e6, 2.0**31 - 1]]
    blocks.add(Points.of(xyz, np.zeros(500, dtype=np.int32)))
    tiles = tiles_of(blocks, reach=3, most=40)
    assert len(tiles) > 20
    ix, iy = rng.integers(-60, 60, (2, 1000), dtype=np.int32)
    ix[:2], iy[2:4] = [-(2**31), 2**31 - 1], [-(2**31), 2**31 - 1]
    covered = np.sum([tile.limits.contain(ix, iy) for tile in tiles], axis=0)
    assert set(covered.tolist()) == {1}
    for tile in tiles:
        own = blocks.extract(tile.limits)
        assert own.size > 0
        assert tile.points >= blocks.extract(tile.limits.widened(3)).size


def test_points_are_had_by_area_from_however_many_runs() -> None:
    rng = np.random.default_rng(5)
    points = Points.of(rng.uniform(-20, 20, (400, 3)), np.arange(400, dtype=np.int32))
    for shift in (0, 2, 5):
        blocks = PointBlocks(0.5, shift=shift)
        for begin in range(0, 400, 80):
            part = slice(begin, begin + 80)
            blocks.add(points.take(part))
        blocks.add(gather([]).points)
        assert blocks.occupied().points.sum() == 400
        for _ in range(20):
            low, high = np.sort(rng.integers(-45, 45, (2, 2)), axis=0)
            limits = Limits(low[0], high[0], low[1], None)
            cells = np.floor(points.xyz[:, :2] / 0.5)
            inside = (cells[:, 0] >= low[0]) & (cells[:, 0] <= high[0]) & (cells[:, 1] >= low[1])
            assert (
                sorted(blocks.extract(limits).keyframe.tolist()) == np.flatnonzero(inside).tolist()
            )


def test_a_builder_with_jobs_makes_the_same_map(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tilewise, "WORTHWHILE_POINTS", 1)
    points = random_points(np.random.default_rng(7), 3000)
    surfaces = []
    for jobs in (None, 1, 4):
        told: list[tuple[str, int, int | None]] = []
        builder = MapBuilder(
            parameters(PIPELINES["regions last"]),
            jobs=jobs,
            progress=lambda *now, told=told: told.append(now),
        )
        builder.add(Keyframe(points.xyz))
        surfaces.append(builder.finish())
        tiles = [(done, of) for what, done, of in told if what == "tiles"]
        assert tiles == [(n + 1, len(tiles)) for n in range(len(tiles))]
        assert (len(tiles) > 1) == (jobs is not None)
    assert surfaces[0] == surfaces[1] == surfaces[2]
    assert surfaces[0].meta == surfaces[1].meta == surfaces[2].meta
