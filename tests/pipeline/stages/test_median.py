"""The median filter on points.

How one could cheat: clouds without equal distances, or a radius that holds every point, or
points as dense everywhere, so that the nearest are never far from where they were sought before.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest

from mlscli.keyframes.batches import Points
from mlscli.parameters.lengths import Cells
from mlscli.pipeline.stages.median import Median
from tests.helpers import point_references as references
from tests.helpers.maps import random_points, symmetries, turned_points


def rows(points: Points) -> list[tuple[tuple[float, float, float], int]]:
    return [
        ((x, y, z), keyframe)
        for (x, y, z), keyframe in zip(points.xyz.tolist(), points.keyframe.tolist(), strict=True)
    ]


def test_the_filter_agrees_with_its_rule_read_plainly() -> None:
    rng = np.random.default_rng(1)
    limited = dropped = moved = 0
    for _ in range(300):
        points = random_points(rng)
        radius = float(rng.choice([0.25, 0.5, 0.8, 1.0]))
        most = int(rng.choice([0, 1, 4, 7, 100]))
        least = int(rng.integers(0, (most or 6) + 1))
        again = float(rng.choice([0, 0.05, 0.1, 0.3]))
        result = Median(radius, most, least, again).apply(points, 0.5)
        expected = references.median(points, radius, most, least, again)
        assert rows(result) == expected
        dropped += len(expected) < points.size
        limited += expected != references.median(points, radius, 0, least, again)
        moved += expected != references.median(points, radius, most, least)
    assert dropped > 100
    assert limited > 50
    assert moved > 20


def test_a_point_is_held_against_its_own_surroundings_as_the_rule_says() -> None:
    rng = np.random.default_rng(8)
    dropped = 0
    for _ in range(200):
        points = random_points(rng)
        most, least = int(rng.choice([0, 4, 9])), int(rng.integers(0, 4))
        level, share = (
            float(rng.choice([0.0625, 0.25, 0.5])),
            float(rng.choice([0.0, 0.3, 0.75, 1])),
        )
        stage = Median(0.8, most, least, 0.1, level, share)
        expected = references.median(points, 0.8, most, least, 0.1, level, share)
        assert rows(stage.apply(points, 0.5)) == expected
        dropped += len(references.median(points, 0.8, most, least, 0.1)) - len(expected)
    assert dropped > 1000


def test_where_little_was_seen_little_is_enough_as_the_rule_says() -> None:
    rng = np.random.default_rng(11)
    dropped = kept = 0
    for _ in range(200):
        points = random_points(rng)
        most, least = int(rng.choice([0, 4, 9])), int(rng.integers(2, 6))
        rule = 0.8, most, least, 0.1, float(rng.choice([0.0625, 0.25])), float(rng.choice([0, 0.5]))
        share = float(rng.choice([0.3, 0.6, 0.9]))
        expected = references.median(points, *rule, share)
        assert rows(Median(*rule, layer_share=share).apply(points, 0.5)) == expected
        dropped += points.size - len(expected)
        kept += len(expected) - len(references.median(points, *rule))
    assert min(dropped, kept) > 500


def test_tall_columns_of_many_levels_are_filtered_as_the_rule_says() -> None:
    rng = np.random.default_rng(8)
    # Some levels were seen well, others by two points; the rest lies at any height between them.
    heights = np.repeat(np.arange(60.0), np.repeat([9, 2], [40, 20]))
    heights = np.append(heights + 0.05 * rng.normal(size=heights.size), 60 * rng.random(80))
    xyz = np.column_stack((0.9 * rng.random((heights.size, 2)), heights))
    points = Points.of(xyz, np.arange(heights.size, dtype=np.int32))
    rule = 0.8, 9, 4, 0.1, 0.25, 0.5
    expected = references.median(points, *rule, 0.6)
    assert rows(Median(*rule, layer_share=0.6).apply(points, 0.5)) == expected
    assert 100 < len(expected) < points.size - 50


def test_a_thin_line_in_the_open_stays_and_outliers_over_a_floor_go() -> None:
    rng = np.random.default_rng(12)
    floor = np.c_[rng.uniform(0, 4, (800, 2)), rng.normal(0, 0.03, 800)]
    wire = np.c_[np.arange(6, 10, 0.45), np.full(9, 2.0), np.full(9, 3.0)]
    over = np.c_[rng.uniform(1, 3, (8, 2)), rng.uniform(2, 4, 8)]
    points = Points.of(np.concatenate((floor, wire, over)), np.zeros(817, dtype=np.int32))
    usual = Median(1.0, 24, 5, 0, 0.3, 0.3, 2.0)
    assert (usual.apply(points, 0.35).xyz[:, 0] > 5).sum() == 0
    kept = replace(usual, layer_share=0.3).apply(points, 0.35).xyz
    assert (kept[:, 0] > 5).sum() == 9
    assert kept[kept[:, 0] < 5, 2].max() < 0.2


def test_a_mast_over_a_floor_stays_as_all_its_layers_are_thin() -> None:
    rng = np.random.default_rng(13)
    floor = np.c_[rng.uniform(0, 4, (400, 2)), rng.normal(0, 0.03, 400)]
    mast = np.c_[rng.normal(2, 0.02, (48, 2)), np.linspace(1, 13, 48)]
    over = np.c_[rng.uniform(0.5, 1, (3, 2)), [3.0, 6.0, 9.0]]
    points = Points.of(np.concatenate((floor, mast, over)), np.zeros(451, dtype=np.int32))
    kept = Median(1.0, 24, 9, 0, 0.3, 0.3, 2.0, 0.3).apply(points, 0.35).xyz
    assert (kept[:, 2] > 0.5).sum() == 48
    assert Median(1.0, 24, 9, 0, 0.3, 0.3, 2.0).apply(points, 0.35).xyz[:, 2].max() < 0.5


@pytest.mark.parametrize("sideways", [0.0, 0.04])
def test_a_short_pole_over_a_floor_that_was_seen_well_stays_to_its_end(sideways: float) -> None:
    rng = np.random.default_rng(14)
    floor = np.c_[rng.uniform(0, 5, (2500, 2)), rng.normal(0, 0.03, 2500)]
    pole = np.c_[rng.normal(3.8, sideways, (40, 2)), np.arange(0.05, 2.01, 0.05)]
    over = np.c_[rng.uniform(0.5, 2.5, (9, 2)), rng.uniform(0.8, 3, 9)]
    xyz = np.concatenate((floor, pole, over))
    stage = Median(0.9, 24, 4, 0.225, 0.225, 0.4, 2.0, 0.3)
    kept = stage.apply(Points.of(xyz, np.zeros(len(xyz), dtype=np.int32)), 0.3).xyz
    of_pole = np.isin(kept[:, 0], pole[:, 0]) & (kept[:, 2] > 0.3)
    assert of_pole.sum() >= 33
    assert kept[of_pole, 2].max() == pole[-1, 2]
    assert kept[~of_pole, 2].max() < 0.32


def poles_over_a_floor(rng: np.random.Generator, rings: int) -> Points:
    """Return poles of rings of so many points, and an outlier beside every second, over a floor."""
    parts = [np.c_[rng.uniform(-2, 2, (60, 2)), rng.normal(0, 0.03, 60)]]
    for x, y, apart in rng.uniform((-2, -2, 0.05), (2, 2, 0.3), (5, 3)):
        z = np.repeat(np.arange(0.1, rng.uniform(0.5, 2), apart), rings)
        angle = 2 * np.pi / rings * np.arange(z.size)
        wide = rng.uniform(0, 0.2) if rings > 1 else 0.0
        parts.append(np.c_[x + wide * np.cos(angle), y + wide * np.sin(angle), z])
    xyz = np.concatenate((*parts, rng.uniform((-2, -2, 0), 2, (6, 3))))
    return Points.of(xyz, np.zeros(len(xyz), dtype=np.int32))


def test_ends_of_lines_of_points_stay_as_the_rule_says(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(15)
    clouds = [poles_over_a_floor(rng, 1) for _ in range(20)]
    rule = 0.9, 24, 4, 0.225, 0.225, 0.4
    expected = [references.median(points, *rule, 0.6) for points in clouds]
    for points, each in zip(clouds, expected, strict=True):
        assert rows(Median(*rule, layer_share=0.6).apply(points, 0.3)) == each
    monkeypatch.setattr(references, "of_pole", lambda *_: False)
    kept = sum(map(len, expected)) - sum(len(references.median(c, *rule, 0.6)) for c in clouds)
    assert kept > 50


def test_ends_of_poles_of_many_points_keep_their_heights_as_the_rule_says() -> None:
    rng = np.random.default_rng(16)
    stays = unsure = 0
    for _ in range(2):
        points = poles_over_a_floor(rng, 9)
        stage = Median(0.9, 24, 0, level=0.225, max_slope=2.0, layer_share=0.3)
        got = stage.apply(points, 0.3).xyz[:, 2]
        without = replace(stage, layer_share=0.0).apply(points, 0.3).xyz[:, 2]
        for i, height in enumerate(references.along_slope(points, 0.9, 24, 2.0, 0.225)):
            if height is None:
                unsure += 1
                continue
            assert abs(got[i] - height) < 1e-3
            stays += abs(without[i] - height) > 0.01
    assert stays > 10
    assert unsure < 10


@pytest.mark.parametrize(("rings", "apart"), [(1, 0.06), (1, 0.08), (9, 0.02), (9, 0.04)])
def test_a_thin_pole_keeps_its_end(rings: int, apart: float) -> None:
    rng = np.random.default_rng(17)
    floor = np.c_[rng.uniform(-1, 1, (280, 2)), rng.normal(0, 0.02, 280)]
    angle = 2 * np.pi / rings * np.arange(rings * 20)
    wide = apart * rings / (2 * np.pi) if rings > 1 else 0.0
    z = np.repeat(np.arange(1, 21) * apart, rings)
    xyz = np.concatenate((floor, np.c_[wide * np.cos(angle), wide * np.sin(angle), z]))
    stage = Median(Cells(3), 24, 4, Cells(0.75), Cells(0.75), 0.4, 2.0, 0.3)
    kept = stage.apply(Points.of(xyz, np.zeros(len(xyz), dtype=np.int32)), 0.15).xyz
    assert kept[:, 2].max() == z[-1]


def test_heights_are_compared_along_the_slope_as_the_rule_says() -> None:
    rng = np.random.default_rng(9)
    upright = sloping = unsure = 0
    for _ in range(60):
        points = random_points(rng, 150)
        if rng.random() < 0.5:
            points.xyz[:, 2] += points.xyz[:, :2] @ rng.uniform(-1, 1, 2)
        most = int(rng.choice([0, 6, 12]))
        got = Median(0.8, most, 0, max_slope=1.0).apply(points, 0.5).xyz[:, 2]
        plain = Median(0.8, most, 0).apply(points, 0.5).xyz[:, 2]
        for i, height in enumerate(references.along_slope(points, 0.8, most, 1.0)):
            if height is None:
                unsure += 1
                continue
            # Offsets are rounded to a 2^15th of the radius, which several of a slope add up.
            assert abs(got[i] - height) < 1e-3
            upright += got[i] == points.xyz[i, 2] != plain[i]
            sloping += abs(got[i] - plain[i]) > 0.01 and got[i] != points.xyz[i, 2]
    assert min(upright, sloping) > 500
    assert unsure < 200


def wall(height: float, spacing: float) -> Points:
    """Return a wall along x, without noise, on a floor; it stands between two rows of cells."""
    x, z = np.meshgrid(np.arange(-3, 3, spacing), np.arange(0, height + 1e-9, spacing))
    upright = np.column_stack((x.ravel(), np.full(x.size, 0.07), z.ravel()))
    floor = np.stack(np.meshgrid(*[np.arange(-3, 3, spacing)] * 2, [0.0]), axis=-1).reshape(-1, 3)
    xyz = np.concatenate((upright, floor[np.abs(floor[:, 1]) > 0.1]))
    off_edges = np.array([0.01, 0.013, 0.0])
    return Points.of(xyz + off_edges, np.zeros(len(xyz), dtype=np.int32))


def test_a_wall_keeps_its_top_and_the_rim_of_its_window() -> None:
    points = wall(1.0, 0.05)
    window = (np.abs(points.xyz[:, 0]) < 0.35) & (np.abs(points.xyz[:, 2] - 0.5) < 0.2)
    points = points.take(~window)
    for recentre in (0.0, 0.1):
        better = Median(0.45, 24, 4, recentre, 0.15, 0.3, 2.0).apply(points, 0.15)
        assert better.size == points.size
        standing = np.abs(points.xyz[:, 2]) > 0.25
        np.testing.assert_array_equal(better.xyz[standing, 2], points.xyz[standing, 2])
        # The thesis's rule eats both, by more than a spacing.
        thesis = Median(0.45, 24, 4, recentre).apply(points, 0.15).xyz[:, 2]
        assert thesis.max() < 0.96
        rim = (np.abs(points.xyz[:, 0]) < 0.3) & (np.abs(points.xyz[:, 2] - 0.25) < 0.06)
        assert np.mean(points.xyz[rim, 2] - thesis[rim]) > 0.03


def known(points: Points) -> Points:
    """Return the points, of which it is known how they err, but for the first."""
    noise = np.full(points.size, 0.01, dtype=np.float32)
    noise[:1] = np.nan
    return points._replace(noise=noise)


def test_points_move_across_what_stands_upright_as_the_rule_says() -> None:
    rng = np.random.default_rng(10)
    moved = stays = unsure = 0
    for _ in range(30):
        xyz = rng.uniform(-1, 1, (150, 3)) * (1, rng.choice([0.05, 0.3]), 1)
        turn = rng.uniform(0, np.pi)
        xyz[:, :2] @= np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        points = known(Points.of(xyz, np.zeros(150, dtype=np.int32)))
        most, across = int(rng.choice([0, 8, 20])), float(rng.choice([0.03, 0.3]))
        # No slope is flat enough: all points keep their heights.
        got = Median(0.8, most, 4, max_slope=1e-9, across=across).apply(points, 0.5).xyz
        assert (got[0] == points.xyz[0]).all()
        for i, move in enumerate(references.aside(points, 0.8, most, across)[1:], 1):
            if move is None:
                unsure += 1
                continue
            # Offsets are rounded to a 2^15th of the radius.
            assert np.abs(got[i] - points.xyz[i] - move).max() < 1e-3
            moved += any(move)
            stays += not any(move)
    assert min(moved, stays) > 500
    assert unsure < 300


def test_a_noisy_wall_is_drawn_together_and_a_mast_and_a_floor_stay() -> None:
    rng = np.random.default_rng(11)
    facade = rng.uniform((-3, 0, 0), (3, 0, 2), (400, 3))
    facade[:, 1] = rng.normal(0.6, 0.05, 400)
    points = known(Points.of(facade, np.zeros(400, dtype=np.int32)))
    stage = Median(Cells(3), 24, 4, max_slope=2.0, across=Cells(0.75))
    after = stage.apply(points, 0.4).xyz
    assert after[:, 1].std() < 0.5 * facade[:, 1].std()
    assert (after[:, 2] == facade[:, 2]).all()
    mast = rng.normal(0, 0.05, (300, 3)) + np.linspace(0, 3, 300)[:, None] * (0, 0, 1)
    floor = rng.uniform(-3, 3, (1500, 3)) * (1, 1, 0.02)
    for xyz in (mast, floor):
        points = known(Points.of(xyz, np.zeros(len(xyz), dtype=np.int32)))
        after = stage.apply(points, 0.4).xyz
        assert np.mean((after[:, :2] == xyz[:, :2]).all(axis=1)) > 0.9


def test_outliers_above_a_roof_go_and_thin_regions_stay() -> None:
    rng = np.random.default_rng(10)
    dense = np.c_[rng.uniform(0, 4, (800, 2)), rng.normal(0, 0.03, 800)]
    thin = np.c_[rng.uniform(6, 10, (40, 2)), rng.normal(2, 0.03, 40)]
    above = np.c_[rng.uniform(1, 3, (12, 2)), rng.uniform(0.5, 0.9, 12)]
    points = Points.of(np.concatenate((dense, thin, above)), np.zeros(852, dtype=np.int32))
    kept = Median(1.0, 24, 3, 0, 0.3, 0.3, 2.0).apply(points, 0.35).xyz
    is_thin = kept[:, 0] > 5
    assert kept[~is_thin, 2].max() < 0.1
    assert (~is_thin).sum() == 800
    assert is_thin.sum() >= 36
    # With a fixed number of neighbours the thin region is an outlier as a whole.
    assert (Median(1.0, 16, 8).apply(points, 0.35).xyz[:, 0] > 5).sum() < 25


def test_slopes_keep_their_ends() -> None:
    x, y = np.meshgrid(np.arange(0, 3, 0.1), np.arange(0, 3, 0.1))
    roof = np.column_stack((x.ravel() + 0.01, y.ravel() + 0.01, 0.8 * x.ravel()))
    points = Points.of(roof, np.zeros(len(roof), dtype=np.int32))
    along = Median(0.45, 24, 4, 0, 0.3, 0.3, 2.0).apply(points, 0.3)
    np.testing.assert_allclose(along.xyz[:, 2], roof[:, 2], atol=1e-4)
    assert np.abs(Median(0.45, 24, 4).apply(points, 0.3).xyz[:, 2] - roof[:, 2]).max() > 0.05


def test_of_equally_distant_neighbours_the_lower_count() -> None:
    # Two neighbours at distance 1, above and below; where only one counts, it is the lower.
    xyz = np.array([[0.0, 0.0, 5.0], [0.0, 0.0, 6.0], [0.0, 0.0, 4.0], [0.0, 0.6, 4.2]])
    points = Points.of(xyz, np.zeros(4, dtype=np.int32))
    # Heights 4, 4.2 and 5 of the point, the near one and the lower of the equal ones.
    assert Median(1.0, 2, 1).apply(points, 1.0).xyz[0, 2] == 4.2
    # All: 4, 4.2, 5, 6, of which index 4 // 2 is the third.
    assert Median(1.0, 0, 1).apply(points, 1.0).xyz[0, 2] == 5.0


def test_an_outlier_that_looks_again_comes_nearer_to_its_surface() -> None:
    rng = np.random.default_rng(6)
    floor = np.c_[rng.uniform(0, 4, (600, 2)), rng.normal(0, 0.1, 600)]
    outliers = np.c_[rng.uniform(1, 3, (20, 2)), rng.uniform(0.4, 0.8, 20)]
    points = Points.of(np.concatenate((floor, outliers)), np.zeros(620, dtype=np.int32))
    once, again = (
        Median(1.0, 16, 4, recentre).apply(points, 0.5).xyz[600:, 2] for recentre in (0, 0.2)
    )
    assert np.mean(once) > 0.08
    assert abs(np.mean(again)) < np.mean(once) / 2


def test_the_nearest_are_found_however_dense_the_points_are() -> None:
    rng = np.random.default_rng(7)
    # Clusters a thousand times denser than the rest, points that coincide, a wall, and equal steps.
    clusters = rng.normal(0, 0.003, (300, 3)) + rng.uniform(0, 3, (3, 3)).repeat(100, axis=0)
    coinciding = np.full((40, 3), 1.5)
    wall = np.c_[np.full(300, 0.7), rng.uniform(0, 3, (300, 2))]
    steps = np.stack(np.meshgrid(*[np.arange(7) / 4] * 3), axis=-1).reshape(-1, 3)
    sparse = rng.uniform(0, 3, (200, 3))
    xyz = rng.permutation(np.concatenate((clusters, coinciding, wall, steps, sparse)))
    points = Points.of(xyz, np.zeros(len(xyz), dtype=np.int32))
    for radius, most, least, again in ((1.0, 16, 8, 0.1), (0.5, 30, 3, 0.0), (0.3, 1, 1, 0.05)):
        result = Median(radius, most, least, again).apply(points, 0.5)
        assert rows(result) == references.median(points, radius, most, least, again)


def test_a_median_is_always_a_height_that_was_measured() -> None:
    rng = np.random.default_rng(2)
    points = random_points(rng, 500)
    result = Median(Cells(2), 5, 0).apply(points, 0.5)
    assert np.isin(result.xyz[:, 2], points.xyz[:, 2]).all()


def test_neighbours_are_found_across_columns_and_far_from_the_origin() -> None:
    for offset in (0.0, 1e3, -1e8, 1e8):
        # Points a radius apart, to the last bit, wherever the edges of the columns lie.
        steps = np.arange(200) * 0.5
        xyz = np.c_[offset + steps, np.full(200, -offset), np.zeros(200)]
        points = Points.of(xyz, np.zeros(200, dtype=np.int32))
        kept = Median(0.5, 0, 2).apply(points, 0.5)
        assert kept.size == 198


def test_turning_and_shuffling_the_points_turns_and_shuffles_the_result() -> None:
    rng = np.random.default_rng(3)
    for _ in range(50):
        points = random_points(rng)
        points = known(points)
        slope = float(rng.choice([0.0, 1.0]))
        stage = Median(0.7, 8, 2, max_slope=slope, across=0.3 if slope else 0)
        result = stage.apply(points, 0.5)
        order = rng.permutation(points.size)
        shuffled = stage.apply(points.take(order), 0.5)
        assert sorted(rows(shuffled)) == sorted(rows(result))
        for symmetry in symmetries():
            turned = stage.apply(turned_points(points, symmetry), 0.5)
            assert rows(turned) == rows(turned_points(result, symmetry))


def test_threads_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    points = random_points(np.random.default_rng(4), 30_000)
    spread = Points.of(points.xyz * (30, 30, 1), points.keyframe)
    results = []
    for processors in (1, 2, 5):
        monkeypatch.setattr("mlscli.runtime.threads.processors", lambda n=processors: n)
        monkeypatch.setattr("mlscli.runtime.threads.WORTHWHILE", 100)
        results.append(Median(0.7, 5, 2).apply(spread, 0.5))
    assert results[0].size > 1000
    for result in results[1:]:
        assert rows(result) == rows(results[0])


@pytest.mark.parametrize("most", [0, 16])
def test_points_that_coincide_cost_no_more_than_others(most: int) -> None:
    # Each against each took ten seconds.
    xyz = np.random.default_rng(8).random((1000, 3))
    xyz = np.concatenate((xyz, np.full((30_000, 3), 0.5)))
    points = known(Points.of(xyz, np.zeros(len(xyz), dtype=np.int32)))
    begin = time.process_time()
    result = Median(0.2, most, 8, level=0.1, max_slope=2.0, across=0.1).apply(points, 0.5)
    assert time.process_time() - begin < 3
    assert (result.xyz[-30_000:, :2] == 0.5).all()
    assert len(np.unique(result.xyz[-30_000:, 2])) == 1


def test_points_that_coincide_have_the_result_of_the_rule() -> None:
    rng = np.random.default_rng(9)
    for most in (0, 3, 16):
        xyz = np.round(rng.random((40, 3)), 1)[rng.integers(0, 40, 300)]
        points = Points.of(xyz, np.arange(300, dtype=np.int32))
        noise = np.where(rng.random(300) < 0.5, 0.01, np.nan).astype(np.float32)
        for mixed in (points, points._replace(noise=noise)):
            result = Median(0.3, most, 2, 0.05).apply(mixed, 0.5)
            assert rows(result) == references.median(mixed, 0.3, most, 2, 0.05)


def test_points_reach_no_farther_than_declared() -> None:
    rng = np.random.default_rng(5)
    cell_size = 0.5
    for slope in (0.0, 1.0) * 50:
        stage = Median(0.7, 5, 1, 0.1, 0.3, 0.3, slope, across=0.6 if slope else 0)
        points = known(random_points(rng))
        cells = np.floor(points.xyz[:, :2] / cell_size)
        near = np.flatnonzero((np.abs(cells) <= stage.reach(cell_size)).all(axis=1))
        alone = stage.apply(points.take(near), cell_size)
        everything = stage.apply(points, cell_size)
        for one, other in ((alone, everything), (everything, alone)):
            inside = (np.floor(one.xyz[:, :2] / cell_size) == 0).all(axis=1)
            assert set(rows(one.take(inside))) <= set(rows(other))


def test_as_many_neighbours_as_count_at_most_may_be_asked_for() -> None:
    assert list(Median(1.0, 4, 4).faults(None, None)) == []
    assert [fault.field for fault in Median(1.0, 4, 5).faults(None, None)] == ["min_nb"]
    assert list(Median(1.0, 0, 5).faults(None, None)) == []


def test_a_share_of_neighbours_at_any_level_is_refused() -> None:
    assert [fault.field for fault in Median(min_share=0.3).faults(None, None)] == ["min_share"]
    assert list(Median(level=0.1, min_share=0.3).faults(None, None)) == []


def test_points_in_one_cell_cost_no_more_than_others() -> None:
    # Whether each is of a pole took nine seconds.
    points = Points.of(np.random.default_rng(8).random((50_000, 3)), np.zeros(50_000, np.int32))
    rule = Median(3.0, 24, 4, level=0.75, min_share=0.4, layer_share=0.3, max_slope=2.0)
    begin = time.process_time()
    assert rule.apply(points, 1.0).size == points.size
    assert time.process_time() - begin < 3
