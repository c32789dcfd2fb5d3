"""How thick surfaces are, and how many of them stand upright.

How one could cheat: measure along an axis, so the surfaces are tilted; take the extent of the
surroundings for noise; call the ends of floors, lines, or heaps of points walls.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mlscli.geometry.roughness import Roughness, roughness
from mlscli.geometry.spacing import Neighbourhoods, spacing
from mlscli.runtime.arrays import Float64


def measured(points: Float64) -> Roughness:
    whole = spacing(points)
    assert whole is not None
    return roughness(whole.cloud, 4 * whole.distance)


def sheet(rng: np.random.Generator, size: int, sigma: float) -> Float64:
    return np.column_stack([rng.uniform(-5, 5, (size, 2)), rng.normal(0, sigma, size)])


@pytest.mark.parametrize("sigma", [0.002, 0.02, 0.06])
@pytest.mark.parametrize("tilt", [0.0, 30.0, 90.0])
def test_noise_is_measured_across_surfaces_whatever_their_slope(sigma: float, tilt: float) -> None:
    rng = np.random.default_rng(1)
    turn = Rotation.from_euler("xyz", [tilt, 20, 40], degrees=True)
    cloud = np.add(turn.apply(sheet(rng, 4000, sigma)), (3e5, 5e6, 100))
    assert measured(cloud).noise == pytest.approx(sigma, rel=0.3)


def test_outliers_and_a_wall_do_not_make_a_floor_noisy() -> None:
    rng = np.random.default_rng(2)
    wall = sheet(rng, 2000, 0.02)[:, [0, 2, 1]]
    outliers = rng.uniform(-5, 5, (400, 3))
    cloud = np.concatenate([sheet(rng, 4000, 0.02), wall, outliers])
    assert measured(cloud).noise == pytest.approx(0.02, rel=0.3)


def test_points_that_fill_space_are_as_thick_as_their_surroundings() -> None:
    cloud = np.random.default_rng(3).uniform(0, 1, (5000, 3))
    whole = spacing(cloud)
    assert whole is not None
    assert measured(cloud).noise > 0.5 * whole.distance
    assert measured(cloud).flat < 0.2


def test_noise_along_a_line_is_what_spreads_beside_it() -> None:
    rng = np.random.default_rng(4)
    line = np.column_stack([np.linspace(0, 100, 4000), rng.normal(0, 0.005, 4000), np.zeros(4000)])
    told = roughness(Neighbourhoods(line), 0.5)
    assert told.noise == pytest.approx(0.005, rel=0.3)
    # A line is no surface, and stands no more upright than it lies.
    assert (told.asked, told.flat, told.upright) == (0, 0.0, 0.0)


def test_walls_are_upright_and_floors_slopes_and_decks_are_not() -> None:
    rng = np.random.default_rng(5)
    floor, wall = sheet(rng, 6000, 0.02), sheet(rng, 3000, 0.02)[:, [0, 2, 1]]
    slope = Rotation.from_euler("y", 40, degrees=True).apply(floor)
    deck = floor[np.abs(floor[:, 0]) < 2] + (0, 0, 3)
    for level in (floor, slope, np.concatenate([floor, deck])):
        assert measured(level).upright < 0.005
        assert measured(level).flat > 0.8
    both = measured(np.concatenate([floor, np.add(wall, (0, 0, 5))]))
    assert both.upright == pytest.approx(1 / 3, abs=0.1)


def test_too_few_points_tell_nothing() -> None:
    points = np.random.default_rng(6).uniform(0, 1, (7, 3))
    assert roughness(Neighbourhoods(points), 9.0) == Roughness(0.0, 0, 0.0, 0.0)
