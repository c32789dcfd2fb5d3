"""Points are moved along their rays to the surface there, and dropped where there is none.

How one could cheat: move points along z; leave walls as they are, or lay them flat; choose the
nearest points in space, which the noise has chosen; move what hardly errs; look farther than the
declared reach; let the order of the points, their batches, tiles or the axes show in the bits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mlscli.building.builder import MapBuilder
from mlscli.config import loads
from mlscli.errors import ConfigError
from mlscli.keyframes.batches import Points
from mlscli.keyframes.keyframe import Keyframe
from mlscli.maps.surface_map import SurfaceMap
from mlscli.parameters.lengths import Cells
from mlscli.pipeline.parameters import Parameters
from mlscli.pipeline.stages.median import Median
from mlscli.pipeline.stages.rays import Rays
from mlscli.pipeline.stages.stage import PointStage
from mlscli.runtime.arrays import Float64
from tests.helpers import point_references as references
from tests.helpers.maps import CELL, symmetries, turned_points
from tests.helpers.pipelines import parameters_of

NOISE = 0.02
STAGE = Rays(NOISE)
seeds = st.integers(0, 2**32 - 1)
STAGES = st.sampled_from(
    [
        Rays(0.03, max_nb=12, min_nb=4),
        Rays(0.1, depth=1.3, radius=0.7, max_nb=6, min_nb=4, min_share=0.2),
        Rays(0.05, min_share=0.0, min_nb=4),
    ]
)

THEN = st.sampled_from(
    [
        (),
        (Median(0.6, 4, 1, 0.2),),
        (Median(0.9, 12, 1, 0.2, max_slope=1.0, across=Cells(0.75)),),
        (Rays(0.06, max_nb=8, min_nb=4),),
    ]
)


def displaced(true: Float64, cameras: Float64, rng: np.random.Generator) -> Points:
    """Return points whose depths err as the stage expects."""
    ray = true - cameras
    depth = np.linalg.norm(ray, axis=1)
    error = NOISE * depth * rng.standard_normal(len(true))
    xyz = cameras + ray * (1 + error)[:, None]
    return Points.of(xyz, np.zeros(len(xyz), dtype=np.int32), cameras)


def corner(rng: np.random.Generator, size: int = 6000) -> tuple[Float64, Float64]:
    """Return points on a floor and on a wall that stands on it, and where each was seen from."""
    on_floor = rng.random(size) < 0.5
    y, along = rng.uniform(-4, 4, size), rng.uniform(0, 3, size)
    true = np.column_stack((np.where(on_floor, 3 - along, 3), y, np.where(on_floor, 0, along)))
    cameras = np.column_stack((np.full(size, -2.0), y * 0.8, np.full(size, 2.5)))
    return true, cameras


def test_a_floor_and_a_wall_become_those_that_they_are() -> None:
    rng = np.random.default_rng(1)
    true, cameras = corner(rng)
    points = displaced(true, cameras, rng)
    after = STAGE.evaluate(points, CELL).xyz
    kept = ~np.isnan(after[:, 2])
    # Of a normal distribution, 13 % lie beyond one and a half standard deviations.
    assert 0.8 < kept.mean() < 0.9
    inside = kept & (np.abs(true[:, 1]) < 3)
    wall = inside & (true[:, 2] > 0.6)
    floor = inside & (true[:, 2] == 0) & (true[:, 0] < 2.4)
    for which, axis, at in ((wall, 0, 3.0), (floor, 2, 0.0)):
        before, now = (np.abs(xyz[which, axis] - at) for xyz in (points.xyz, after))
        assert np.median(now) < np.median(before) / 2
        assert np.quantile(now, 0.95) < np.quantile(before, 0.95) / 2
    ray = (true - cameras) / np.linalg.norm(true - cameras, axis=1)[:, None]
    assert np.abs(np.cross(after - points.xyz, ray)[kept]).max() < 1e-6


def test_what_lies_on_no_surface_is_dropped() -> None:
    rng = np.random.default_rng(2)
    true, cameras = corner(rng)
    points = displaced(true, cameras, rng)
    wrong = rng.random(points.size) < 0.05
    nearer = rng.uniform(0.2, 0.5, (points.size, 1)) * (cameras - true)
    points.xyz[wrong] += nearer[wrong]
    dropped = np.isnan(STAGE.evaluate(points, CELL).xyz[:, 2])
    assert dropped[wrong].mean() > 0.8
    assert dropped[~wrong].mean() < 0.2


def test_points_stay_that_hardly_err_or_were_seen_from_nowhere_known() -> None:
    rng = np.random.default_rng(3)
    true, cameras = corner(rng, 800)
    points = displaced(true, cameras, rng)
    nowhere = Points.of(points.xyz, points.keyframe)
    none: list[Rays] = [Rays(), Rays(0), Rays(1e-4)]
    assert all(stage.apply(points, CELL).xyz.tobytes() == points.xyz.tobytes() for stage in none)
    assert STAGE.apply(nowhere, CELL).xyz.tobytes() == points.xyz.tobytes()
    assert (STAGE.apply(points, CELL).size, Rays(0).reach(CELL)) != (points.size, 1)
    # Those that are known to be better stay, and the others come to them.
    good = np.arange(points.size) % 2 == 0
    points.xyz[good] = true[good]
    near = points._replace(sight=np.where(good[:, None], points.sight / 50, points.sight))
    after = STAGE.evaluate(near, CELL).xyz
    assert after[good].tobytes() == true[good].tobytes()
    moved = ~good & ~np.isnan(after[:, 2])
    assert moved.sum() > 300
    assert np.median(np.abs(after - true)[moved]) < np.median(np.abs(points.xyz - true)[moved]) / 2


def test_a_sight_so_far_that_it_could_lie_anywhere_does_not_outvote_near_ones() -> None:
    rng = np.random.default_rng(4)
    flat = np.column_stack((rng.uniform(-1, 1, (600, 2)), np.zeros(600)))
    above = flat + np.array((0, 0, 4.0))
    near = displaced(flat, above, rng)
    far = near.xyz[::2] + np.array((0, 0, 0.4))
    both = Points.of(
        np.concatenate((near.xyz, far)),
        np.zeros(900, dtype=np.int32),
        np.concatenate((above, far + np.array((0, 0, 30.0)))),
    )
    alone = STAGE.evaluate(near, CELL).xyz
    assert STAGE.evaluate(both, CELL).xyz[:600].tobytes() == alone.tobytes()


# --- exactness ---


def cloud(seed: int, size: int = 160) -> Points:
    """Return points on crossing surfaces, some alike, seen from some places or from nowhere."""
    rng = np.random.default_rng(seed)
    xyz = rng.uniform((-1.5, -1.5, -0.2), (1.5, 1.5, 0.2), (size, 3))
    upright = rng.random(size) < 0.4
    xyz[upright] = xyz[upright][:, [2, 1, 0]]
    if rng.random() < 0.5:
        xyz = np.round(xyz * 8) / 8 + (0.0625, 0.0625, 0)
    places = np.round(rng.uniform((-4, -4, 1), (4, 4, 5), (4, 3)) * 4) / 4
    places[0], places[1, :2] = np.nan, xyz[0, :2]
    which = rng.integers(0, 4, size)
    return Points.of(xyz + 0.0, which.astype(np.int32), places[which])


def test_each_point_is_moved_as_the_rule_says() -> None:
    outcomes = {"moved": 0, "dropped": 0, "stays": 0}
    for seed, stage in ((1, Rays(0.03, max_nb=12, min_nb=4)), (2, Rays(0.05)), (5, STAGE)):
        points = cloud(seed, 400)
        expected = references.rays(
            points, 0.1 * CELL, 0.5 * CELL, float(stage.noise), 4 * CELL, 2 * CELL, stage.max_nb,
            stage.min_nb, stage.min_share,
        )  # fmt: skip
        found = stage.evaluate(points, CELL).xyz
        # Where a point lies at a limit, its last bits decide.
        alike = np.isclose(found[:, 2], expected[:, 2], atol=1e-6, rtol=0, equal_nan=True)
        assert alike.mean() > 0.99
        both = alike & ~np.isnan(found[:, 2])
        assert np.abs(found - expected)[both].max() < 1e-6
        outcomes["dropped"] += int(np.isnan(found[:, 2]).sum())
        outcomes["stays"] += int((found == points.xyz).all(axis=1).sum())
        outcomes["moved"] += int((found[both] != points.xyz[both]).any(axis=1).sum())
    assert min(outcomes.values()) > 100


@settings(max_examples=25, deadline=None)
@given(seeds, STAGES)
def test_neither_order_nor_axes_change_a_bit(seed: int, stage: Rays) -> None:
    points = cloud(seed)
    after = stage.apply(points, CELL)
    order = np.random.default_rng(seed).permutation(points.size)
    assert rows(stage.apply(points.take(order), CELL)) == rows(after)
    for symmetry in symmetries():
        turned = stage.apply(turned_points(points, symmetry), CELL)
        assert rows(turned) == rows(turned_points(after, symmetry))


@settings(max_examples=40, deadline=None)
@given(seeds, STAGES)
def test_nothing_farther_off_than_the_stage_looked_changes_a_point(seed: int, stage: Rays) -> None:
    points = cloud(seed)
    before = stage.evaluate(points, CELL, np.ones(points.size, dtype=np.bool_))
    other = cloud(seed + 1, 1)
    more = Points._make(
        np.concatenate(parts) for parts in zip(*map(tuple, (points, other)), strict=True)
    )
    after = stage.evaluate(more, CELL).xyz[:-1]
    dx, dy = (points.xyz - other.xyz)[:, :2].T
    unseen = dx * dx + dy * dy > before.looked
    assert after[unseen].tobytes() == before.xyz[unseen].tobytes()
    reach = stage.reach(CELL) * CELL
    assert before.looked.max() <= reach * reach


def rows(points: Points) -> list[bytes]:
    """Return the bits of each point, sorted."""
    parts = zip(*(np.ascontiguousarray(part) for part in points), strict=True)
    return sorted(b"".join(np.asarray(part + 0).tobytes() for part in row) for row in parts)


@settings(max_examples=25, deadline=None)
@given(seeds, STAGES, st.lists(st.integers(1, 60), min_size=2, max_size=6), THEN)
def test_batches_and_tiles_give_the_map_of_one_pass(
    seed: int, stage: Rays, sizes: list[int], then: tuple[PointStage, ...]
) -> None:
    points = cloud(seed, 200)
    parameters = parameters_of([stage, *then])
    flight = keyframes(points, sizes)
    whole = built(parameters, flight)
    assert whole.size
    every = replace(parameters, batch=replace(parameters.batch, min_points=1))
    batches = MapBuilder(every, follow=lambda _: None)
    for number, keyframe in enumerate(flight, 1):
        batches.add(keyframe)
        assert batches.surface == built(parameters, flight[:number])
    assert batches.finish() == whole
    tiles = MapBuilder(parameters, jobs=2)
    for keyframe in flight:
        tiles.add(keyframe)
    assert tiles.finish() == whole


def keyframes(points: Points, sizes: Sequence[int]) -> list[Keyframe]:
    """Return keyframes of the points with one position, each cut into pieces."""
    found = []
    for place in range(4):
        mine = points.take(points.keyframe == place)
        position = mine.xyz[0] - mine.sight[0] if mine.size else np.full(3, np.nan)
        for part in np.array_split(mine.xyz, len(sizes)):
            found.append(Keyframe(part, position=tuple(position.tolist())))
    order = np.random.default_rng(len(sizes)).permutation(len(found))
    return [found[n] for n in order]


def built(parameters: Parameters, flight: Sequence[Keyframe]) -> SurfaceMap:
    builder = MapBuilder(parameters)
    for keyframe in flight:
        builder.add(keyframe)
    return builder.finish()


# --- parameters ---


def test_more_neighbours_than_count_cannot_be_asked_for() -> None:
    with pytest.raises(ConfigError, match=r"rays\.min_nb: 30 is above max_nb \(24\)"):
        loads("pipeline: [rays: {min_nb: 30}]")


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("far", [1e40, 1e200, 1e300])
def test_a_position_beyond_reason_is_none(far: float) -> None:
    rng = np.random.default_rng(7)
    true, cameras = corner(rng, 400)
    keyframe = np.zeros(400, dtype=np.int32)
    near, beyond = (Points.of(true, keyframe, at) for at in (cameras, cameras + far))
    assert np.isfinite(near.sight).all()
    assert np.isnan(beyond.sight).all()
    assert STAGE.apply(beyond, CELL).xyz.tobytes() == true.tobytes()
    assert Rays(1e308).apply(near, CELL).size < 400
