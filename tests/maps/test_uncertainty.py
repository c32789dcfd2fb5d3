"""How uncertain heights are: the model, and whether heights are as often right as it says.

How one could cheat: call everything uncertain, so that the truth is always within; be sure of
single points; tell something of patches that nobody measured.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from mlscli.errors import InputError
from mlscli.keyframes.batches import Points
from mlscli.keyframes.keyframe import Keyframe
from mlscli.maps.grid import Grid
from mlscli.maps.merging import merge_maps
from mlscli.maps.surface_map import SurfaceMap
from mlscli.pipeline.grouping import group
from mlscli.pipeline.parameters import Parameters
from mlscli.pipeline.stages.median import Median
from mlscli.pipeline.stages.rays import Rays
from mlscli.runtime.arrays import Float64
from tests.helpers.maps import CELL, GAP, THICKNESS, Patch, map_of, random_map
from tests.helpers.pipelines import parameters_of
from tests.pipeline.stages.test_rays import NOISE, built, displaced


def test_the_variance_of_a_height_follows_the_model() -> None:
    rng = np.random.default_rng(1)
    kinds = {"flat": 0, "upright": 0, "inserted": 0, "moved": 0}
    for _ in range(50):
        surface = random_map(rng)
        drawn = rng.random(surface.size) < 0.3
        surface = surface.with_columns(height=surface.height + 0.1 * drawn)
        for i, found in enumerate(surface.height_variance.tolist()):
            n, noise = int(surface.count[i]), float(surface.noise[i])
            if not n:
                kinds["inserted"] += 1
                assert math.isnan(found)
                continue
            if surface.depth[i]:
                kinds["upright"] += 1
                at, extent = surface.top[i], surface.top[i] - surface.bottom[i]
                expected = noise + 2 * extent**2 / ((n + 1) * (n + 2))
            else:
                kinds["flat"] += 1
                at = surface.mean[i]
                expected = noise + (surface.variance[i] + 4 * noise / n) / n
            kinds["moved"] += surface.height[i] != at
            assert found == pytest.approx(expected + (surface.height[i] - at) ** 2, rel=1e-12)
    assert min(kinds.values()) > 100


def test_a_single_point_is_surer_of_nothing_than_several_alike() -> None:
    surface = map_of([Patch(0, 0, 1.0, 0.0, 0, 1), Patch(1, 0, 1.0, 0.0, 0, 9)])
    surface = replace(surface, noise=np.full(2, 0.01, dtype=np.float32))
    alone, several = surface.height_variance
    assert alone > 4 * several > 0.04


@pytest.mark.parametrize("noise", [-1.0, np.inf])
def test_a_noise_that_is_none_is_refused(noise: float) -> None:
    surface = map_of([Patch(0, 0, 1.0, 0.0, 0, 1), Patch(0, 1, 1.0, 0.0, 2, 0)])
    surface.check()
    unknown = np.full(2, np.nan, dtype=np.float32)
    replace(surface, noise=unknown).check()
    with pytest.raises(InputError, match=r"^noise: holds values below 0 or infinite ones"):
        replace(surface, noise=np.array([noise, np.nan], dtype=np.float32)).check()
    with pytest.raises(InputError, match=r"^noise: is not NaN for every inserted patch"):
        replace(surface, noise=np.array([0, 0], dtype=np.float32)).check()


# --- the noise of points ---


def grouped(noise: list[float]) -> SurfaceMap:
    """Return the map of points of one patch, given what is known of each."""
    points = Points.of(np.full((len(noise), 3), 0.1), np.zeros(len(noise), dtype=np.int32))
    points = points._replace(noise=np.array(noise, dtype=np.float32))
    surface = group(points, Grid(CELL, GAP, THICKNESS))
    return replace(surface, route=np.full((1, 4), np.nan))


def test_the_noise_of_a_patch_is_the_mean_of_what_is_known_of_its_points() -> None:
    rng = np.random.default_rng(2)
    for _ in range(50):
        noise = np.where(rng.random(9) < 0.3, np.nan, 10.0 ** rng.uniform(-6, 1, 9))
        found = float(grouped(noise.tolist()).noise[0])
        assert found == pytest.approx(float(np.nanmean(noise)), rel=1e-3, abs=1e-8)
        # Equal heights, in any order: not a bit differs.
        assert float(grouped(rng.permutation(noise).tolist()).noise[0]) == found
    assert np.isnan(grouped([np.nan] * 3).noise[0])
    # What is beyond all reason counts as much as a noise of 32 cells.
    far = grouped([3e38, np.inf, 0.0])
    far.check()
    assert float(far.noise[0]) == pytest.approx((32 * CELL) ** 2 * 2 / 3)


def test_merged_patches_have_the_mean_noise_of_all_their_points() -> None:
    one, other, unknown = grouped([0.25] * 3), grouped([0.5]), grouped([np.nan] * 2)
    for surface, expected in (
        (merge_maps(one, other), 0.3125),
        (merge_maps(other, one), 0.3125),
        (merge_maps(one, unknown), 0.25),
        (merge_maps(unknown, one), 0.25),
        (merge_maps(unknown, unknown), math.nan),
    ):
        surface.check()
        assert surface.noise.tolist() == pytest.approx([expected], nan_ok=True)


def shares(surface: SurfaceMap, error: Float64) -> list[float]:
    """Return how many of the errors are within one and two standard deviations."""
    times = np.abs(error) / np.sqrt(surface.height_variance)
    assert not np.isnan(times).any()
    # Who says that nothing is known is always right.
    assert (surface.height_variance**0.5).mean() < 2.5 * np.sqrt(np.mean(error**2))
    return [float(np.mean(times <= most)) for most in (1, 2)]


def floor(seed: int, size: int = 3000) -> Float64:
    """Return points of a slope, 1.2 in each cell, so that many are alone in theirs."""
    rng = np.random.default_rng(seed)
    side = math.sqrt(size / 1.2) * CELL
    xy = rng.uniform(0, side, (size, 2))
    return np.column_stack((xy, 0.2 * xy[:, 0]))


def test_heights_are_as_often_right_as_they_say_also_of_single_points() -> None:
    true = floor(3)
    noisy = true + np.random.default_rng(3).normal(0, CELL / 4, true.shape) * (0.3, 0.3, 1)
    surface = built(Parameters().with_cell_size(CELL), [Keyframe(noisy)])
    flat = surface.take((surface.origin == 0) & (surface.depth == 0) & (surface.moved == 0))
    assert (flat.count == 1).sum() > 200
    error = flat.height - 0.2 * CELL * (flat.ix + 0.5)
    for which in (flat.count > 0, flat.count == 1, flat.count > 2):
        one, two = shares(flat.take(which), error[which])
        assert 0.55 < one < 0.95
        assert two > 0.9


def test_heights_are_as_often_right_where_the_noise_along_rays_is_known() -> None:
    true = floor(4)
    rng = np.random.default_rng(4)
    # Each was seen from one of 36 places above the slope, not the nearest always.
    near = np.floor(true[:, :2] / 4.2 + rng.uniform(-0.3, 0.3, (len(true), 2))).clip(0, 5)
    which = (near @ (6, 1)).astype(int)
    x, y = (np.arange(36) // 6 + 0.5) * 4.2, (np.arange(36) % 6 + 0.5) * 4.2
    places = np.column_stack((x, y, 0.2 * x + 3))
    points = displaced(true, places[which], rng)
    flight = [
        Keyframe(points.xyz[which == n], position=tuple(place)) for n, place in enumerate(places)
    ]
    stages = [Rays(NOISE), Median(3 * CELL, 24, 4, max_slope=2.0)]
    surface = built(parameters_of(stages), flight)
    flat = surface.take(surface.depth == 0)
    one, two = shares(flat, flat.height - 0.2 * CELL * (flat.ix + 0.5))
    assert 0.55 < one < 0.97
    assert two > 0.9
    # Without any stage on points nobody knows.
    assert np.isnan(built(parameters_of([]), flight).height_variance).all()
