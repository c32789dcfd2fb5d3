"""Points on surfaces, texture, holes, and the statistics of what is wrong with the points.

Ways to pass without being right: statistics of the sum of all faults, which one fault could make
alone; bounds so wide that twice the sigma passes.
"""

from __future__ import annotations

import numpy as np
import pytest

from mlscli.runtime.arrays import Float64
from mlscli.scenes.noise import REFERENCE_DISTANCE, Chances, Noise, displace, scatter_outliers
from mlscli.scenes.parts import floor, wall
from mlscli.scenes.presets import make
from mlscli.scenes.sampling import outside_holes, sample
from mlscli.scenes.surfaces import Scatter, Scene

MANY = 40_000
SIGMA = Scatter(0.02, 0.05)


def test_the_grid_begins_half_a_step_from_the_edges() -> None:
    samples = sample(floor(Scene(""), (0, 1), (0, 0.5), 2.0), 0.25)
    assert samples.xyz.tolist() == [
        [x, y, 2.0] for x in (0.125, 0.375, 0.625, 0.875) for y in (0.125, 0.375)
    ]


def test_steps_divide_the_edges_and_are_at_most_the_spacing() -> None:
    samples = sample(floor(Scene(""), (0, 1), (0, 0.1), 0.0), 0.3)
    assert samples.xyz[:, 0] == pytest.approx((0.125, 0.375, 0.625, 0.875))
    assert len(sample(floor(Scene(""), (0, 6), (0, 6), 0.0), 0.1).xyz) == 3600


def test_openings_hold_no_points_and_walls_do() -> None:
    hole = [((0.2, 0.8), (0.2, 0.8))]
    scene = floor(Scene(""), (0, 1), (0, 1), 0.0, openings=hole)
    scene = wall(scene, (0, 0), (0, 1), (0, 2))
    samples = sample(scene, 0.1)
    on_floor = samples.xyz[samples.surface == 0]
    assert len(on_floor) == 100 - 36
    assert not ((np.abs(on_floor[:, :2] - 0.5) < 0.3).all(axis=1)).any()
    assert np.count_nonzero(samples.surface == 1) == 200


def test_texture_is_a_chance_and_none_where_there_is_none() -> None:
    bare = [((0.0, 0.5), (0.0, 1.0))]
    scene = floor(Scene(""), (0, 1), (0, 1), 0.0, texture=0.3, textureless=bare)
    samples = sample(scene, 0.1)
    assert np.array_equal(samples.texture, np.where(samples.xyz[:, 0] < 0.5, 0.0, 0.3))


def test_white_roofs_are_in_the_truth_and_not_in_the_flight() -> None:
    from mlscli.scenes.flight import fly
    from mlscli.scenes.truth import truth

    scene = make("village-thesis")
    roof = next(s for s in scene.surfaces if s.texture == 0)
    exact = Noise(sigma=Scatter(0, 0), salt_pepper=0)
    points = np.concatenate([k.points for k in fly(scene, noise=exact).keyframes])
    edge = np.array([0.15, 0.15, -0.01])
    low = np.array(roof.corner) + edge
    high = np.array(roof.corner) + np.array(roof.along) + np.array(roof.across) - edge
    assert not ((points > low) & (points < high)).all(axis=1).any()
    true = truth(scene, 0.15, 0.5, 0.15)
    assert np.count_nonzero(true.height == roof.corner[2]) > 100


def test_holes_are_round_places_on_the_surfaces() -> None:
    scene = floor(Scene(""), (0, 10), (0, 10), 0.0)
    xyz = sample(scene, 0.05).xyz
    kept = outside_holes(scene, xyz, 1, 2.0, Chances(1).of("holes"))
    gone = xyz[~kept]
    middle = (gone.min(axis=0) + gone.max(axis=0)) / 2
    assert np.ptp(gone, axis=0) == pytest.approx((2.0, 2.0, 0.0), abs=0.11)
    assert len(gone) * 0.05**2 == pytest.approx(np.pi, rel=0.02)
    assert np.linalg.norm(gone - middle, axis=1).max() < 1.05
    assert outside_holes(scene, xyz, 0, 2.0, Chances(1).of("holes")).all()


def test_holes_fall_evenly_on_the_area() -> None:
    scene = floor(floor(Scene(""), (0, 3), (0, 1), 0.0), (10, 11), (0, 1), 5.0)
    xyz = np.array([[1.5, 0.5, 0.0], [10.5, 0.5, 5.0]])
    hit = [~outside_holes(scene, xyz, 1, 6.0, Chances(seed).of("holes")) for seed in range(400)]
    assert np.mean(hit, axis=0) == pytest.approx((0.75, 0.25), abs=0.07)


# --- displacements ---


def displaced(noise: Noise, distance: float = 2.0, seed: int = 1) -> Float64:
    """Return how points straight below their cameras are displaced."""
    xyz = np.zeros((MANY, 3))
    cameras = np.tile([0.0, 0.0, distance], (MANY, 1))
    sigma = np.tile(noise.sigma, (MANY, 1))
    return displace(xyz, cameras, sigma, noise, Chances(seed))


def test_the_scatter_has_the_sigmas_asked_for() -> None:
    moved = displaced(Noise(sigma=SIGMA, salt_pepper=0))
    assert moved.std(axis=0) == pytest.approx((0.02, 0.02, 0.05), rel=0.02)
    assert np.abs(moved.mean(axis=0)).max() < 0.001
    assert np.abs(np.corrcoef(moved.T) - np.eye(3)).max() < 0.02


def test_salt_and_pepper_is_five_times_as_wide_in_z_with_the_chance_asked_for() -> None:
    plain = displaced(Noise(sigma=SIGMA, salt_pepper=0))
    salted = displaced(Noise(sigma=SIGMA, salt_pepper=0.2))
    assert np.array_equal(plain[:, :2], salted[:, :2])
    wide = plain[:, 2] != salted[:, 2]
    assert wide.mean() == pytest.approx(0.2, abs=0.01)
    assert salted[wide, 2] == pytest.approx(5 * plain[wide, 2])


def test_a_surface_can_have_a_scatter_of_its_own() -> None:
    from mlscli.scenes.flight import fly
    from mlscli.scenes.surfaces import add_horizontal

    rough, smooth = Scatter(0.0, 0.2), Scatter(0.0, 0.0)
    scene = add_horizontal(Scene(""), (0, 0, 0), (4, 4), scatter=rough)
    scene = add_horizontal(scene, (9, 0, 0), (4, 4), scatter=smooth)
    points = np.concatenate([k.points for k in fly(scene, noise=Noise(salt_pepper=0)).keyframes])
    assert points[points[:, 0] < 4.5, 2].std() == pytest.approx(0.2, rel=0.08)
    assert set(points[points[:, 0] > 4.5, 2].tolist()) == {0.0}


@pytest.mark.parametrize("distance", [1.0, 2.0, 4.0, 8.0])
def test_depth_errs_with_the_square_of_the_distance_and_the_image_with_the_distance(
    distance: float,
) -> None:
    moved = displaced(Noise("slam", SIGMA, salt_pepper=0), distance)
    far = distance / REFERENCE_DISTANCE
    assert moved.std(axis=0) == pytest.approx((0.02 * far, 0.02 * far, 0.05 * far**2), rel=0.02)


def test_depth_errs_along_the_ray_wherever_the_camera_is() -> None:
    noise = Noise("slam", Scatter(0.0, 0.1), salt_pepper=0)
    cameras = np.tile([3.0, 4.0, 0.0], (MANY, 1))
    xyz, sigma = np.zeros((MANY, 3)), np.tile(noise.sigma, (MANY, 1))
    moved = displace(xyz, cameras, sigma, noise, Chances(1))
    assert moved[:, 0] / 3 == pytest.approx(moved[:, 1] / 4)
    assert np.abs(moved[:, 2]).max() < 1e-12
    assert np.linalg.norm(moved, axis=1).max() > 1


def test_wrong_correspondences_come_with_the_chance_asked_for() -> None:
    plain = displaced(Noise("slam", Scatter(0, 0), salt_pepper=0))
    wrong = displaced(Noise("slam", Scatter(0, 0), salt_pepper=0.3))
    moved = np.abs(plain - wrong).max(axis=1) > 1e-9
    assert moved.mean() == pytest.approx(0.3, abs=0.01)
    depth = 2.0 - wrong[moved, 2]
    assert (depth.min(), depth.max()) == pytest.approx((1.0, 4.0), abs=0.02)
    # Even in the inverse of the depth.
    quarters = np.quantile(1 / depth, (0.25, 0.5, 0.75))
    assert quarters == pytest.approx((0.4375, 0.625, 0.8125), abs=0.01)


def test_outliers_are_anywhere_in_the_height_of_the_scene() -> None:
    xyz = np.full((MANY, 3), 7.0)
    found = scatter_outliers(xyz, 0.25, -1.0, 3.0, Chances(5))
    gross = found[:, 2] != 7.0
    assert gross.mean() == pytest.approx(0.25, abs=0.01)
    assert np.array_equal(found[:, :2], xyz[:, :2])
    quarters = np.quantile(found[gross, 2], (0, 0.25, 0.5, 0.75, 1))
    assert quarters == pytest.approx((-1, 0, 1, 2, 3), abs=0.07)
