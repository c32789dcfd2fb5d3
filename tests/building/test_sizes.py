"""`cell_size: auto` and `gap_size: auto`.

How one could cheat: fit the sizes to the number of points; take sizes that are given for ones to be
found; choose a small gap wherever there is no wall in sight, or wherever there is one; be silent
about sizes of no use, or doubt every one.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import mlscli
from mlscli.building.build import build
from mlscli.building.gap_size import AskedPoints
from mlscli.building.sizes import FittedSizes, auto_cell_size, fit_sizes
from mlscli.config import loads
from mlscli.errors import InputError, UsageError
from mlscli.geometry.roughness import ASKED
from mlscli.geometry.spacing import Neighbourhoods
from mlscli.keyframes.batches import Points
from mlscli.keyframes.keyframe import Keyframe
from mlscli.parameters.lengths import Cells
from mlscli.pipeline.parameters import MapParameters, Parameters, Vehicle
from mlscli.pipeline.stages.pyramids import Pyramids
from mlscli.runtime.arrays import Float64
from mlscli.runtime.notices import hear
from tests.helpers.maps import symmetries, turned_points

seeds = st.integers(0, 2**32 - 1)


def floor(rng: np.random.Generator, size: int, side: float = 10.0, sigma: float = 0.01) -> Float64:
    return np.column_stack([rng.uniform(0, side, (size, 2)), rng.normal(0, sigma, size)])


def walls(rng: np.random.Generator, size: int, side: float = 10.0) -> Float64:
    return np.column_stack([floor(rng, size, side)[:, [0, 2]], rng.uniform(0, side / 2, size)])


# --- cell_size ---


def test_the_cells_of_a_lattice_are_two_spacings_wide() -> None:
    x, y = np.meshgrid(np.arange(40) * 0.13, np.arange(40) * 0.13)
    assert auto_cell_size(np.c_[x.ravel(), y.ravel(), 0 * x.ravel()]) == 0.26


@settings(max_examples=5, deadline=None)
@given(seeds)
def test_order_symmetry_and_a_few_outliers_do_not_change_the_sizes(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = Points.of(rng.uniform(0, 5, (400, 3)), np.zeros(400, dtype=np.int32))
    sizes = fit_sizes(points.xyz)
    assert fit_sizes(rng.permutation(points.xyz)) == sizes
    for symmetry in symmetries():
        assert fit_sizes(turned_points(points, symmetry).xyz) == sizes
    outliers = np.concatenate((points.xyz, rng.uniform(-1e6, 1e6, (8, 3))))
    assert auto_cell_size(outliers) == pytest.approx(auto_cell_size(points.xyz), rel=0.1)


@pytest.mark.parametrize("cloud", [np.zeros((3, 3)), np.zeros((50, 3)), np.empty((0, 3))])
def test_where_auto_has_no_answer_it_asks_for_a_number(cloud: Float64) -> None:
    with pytest.raises(InputError, match=r"distinct points.*set map\.cell_size to a number"):
        auto_cell_size(cloud)


def test_the_fourth_neighbour_counts() -> None:
    # On a line the fourth neighbour of most points is two spacings away.
    line = np.c_[np.arange(200) * 0.5, np.zeros((200, 2))]
    assert auto_cell_size(line) == 2.0
    # In a row of fives, far from each other, the fives count as one each.
    fives = np.concatenate([np.arange(5) * 0.1 + 100 * k for k in range(50)])
    assert auto_cell_size(np.c_[fives, np.zeros((250, 2))]) == 400


def test_points_that_are_not_finite_do_not_count() -> None:
    cloud = floor(np.random.default_rng(1), 500)
    broken = np.concatenate([cloud, [[np.nan, 0, 0], [0, np.inf, 0]]])
    assert fit_sizes(broken) == fit_sizes(cloud)


def scans(count: int) -> list[Keyframe]:
    """Return scans of a room of 10 x 10 m from one place, 900 beams each, off by 5 mm in range."""
    rng = np.random.default_rng(2)
    angle = 2 * np.pi * np.arange(900) / 900
    reach = 5 / np.maximum(np.abs(np.cos(angle)), np.abs(np.sin(angle)))
    beams = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(900)])
    return [
        Keyframe(np.round(beams * (reach + rng.normal(0, 0.005, 900))[:, None], 4) + 0.0)
        for _ in range(count)
    ]


def test_a_sensor_that_stands_still_does_not_shrink_the_cells() -> None:
    few, many = (fit_sizes(scans(count)) for count in (1, 60))
    # The beams lie 3 to 5 cm apart on the walls.
    assert few.parameters.map.cell_size == pytest.approx(0.17, abs=0.01)
    assert many.parameters.map.cell_size == pytest.approx(0.17, abs=0.01)
    assert "in one keyframe, as they see the same again" in many.reasons["cell_size"]
    assert "keyframe" not in few.reasons["cell_size"]
    # Without the keyframes, the beams are clusters of points.
    whole = np.concatenate([keyframe.points for keyframe in scans(60)])
    together = fit_sizes(whole)
    assert 0.05 < float(together.parameters.map.cell_size) < 0.2
    assert "clusters of points count as one each" in together.reasons["cell_size"]
    assert "equal others" in together.reasons["cell_size"]


def test_a_flight_has_the_cells_of_all_its_points_together() -> None:
    rng = np.random.default_rng(3)
    keyframes = [Keyframe(np.add(floor(rng, 200), (k, 0, 0))) for k in range(20)]
    whole = np.concatenate([keyframe.points for keyframe in keyframes])
    assert fit_sizes(keyframes).parameters.map.cell_size == auto_cell_size(whole)


# --- gap_size ---


def gap_in_cells(sizes: FittedSizes) -> float:
    grid = sizes.parameters.grid()
    return grid.gap_size / grid.cell_size


def test_the_gap_is_the_height_of_the_vehicle_where_there_are_walls() -> None:
    rng = np.random.default_rng(4)
    room = np.concatenate([floor(rng, 3000), walls(rng, 1000)])
    sizes = fit_sizes(room, Parameters(vehicle=Vehicle(height=Cells(4))))
    assert gap_in_cells(sizes) == pytest.approx(4)
    assert "the height of the vehicle, as" in sizes.reasons["gap_size"]


def test_levels_stay_apart_where_no_wall_was_sampled() -> None:
    rng = np.random.default_rng(5)
    deck = floor(rng, 400) * (1, 0.2, 1) + (0, 4, 0.3)
    scene = np.concatenate([floor(rng, 3000), deck])
    sizes = fit_sizes(scene)
    assert gap_in_cells(sizes) == pytest.approx(0.5)
    why = "auto: half a cell, as only 0.0% of the surfaces stand upright"
    assert sizes.reasons["gap_size"] == why
    surface = build(scene, loads("pipeline: []")).surface
    size, levels = surface.cell_size, np.diff(surface.cells.start)
    under_deck = (surface.cells.iy * size > 4) & ((surface.cells.iy + 1) * size < 6)
    assert np.mean(levels[under_deck] == 2) > 0.9
    assert np.mean(levels[surface.cells.iy * size > 6] == 1) == 1


def test_noise_does_not_part_a_floor() -> None:
    rng = np.random.default_rng(6)
    cell = auto_cell_size(floor(rng, 3000))
    noisy = floor(rng, 3000, sigma=0.3 * cell)
    sizes = fit_sizes(noisy)
    assert 0.6 < gap_in_cells(sizes) < 1
    assert "three times the noise" in sizes.reasons["gap_size"]
    surface = build(noisy, loads("pipeline: []")).surface
    assert np.mean(np.diff(surface.cells.start) == 1) > 0.95


def test_nothing_is_concluded_from_few_points_or_from_noise_alone() -> None:
    rng = np.random.default_rng(7)
    for cloud in (floor(rng, 30), rng.uniform(0, 5, (3000, 3))):
        sizes = fit_sizes(cloud)
        assert gap_in_cells(sizes) == pytest.approx(3)
        assert "too few points lie on surfaces" in sizes.reasons["gap_size"]


def test_the_gap_is_never_more_than_the_vehicle_is_high() -> None:
    cloud = floor(np.random.default_rng(8), 3000)
    low = fit_sizes(cloud, Parameters(vehicle=Vehicle(height=Cells(0.2))))
    assert gap_in_cells(low) == pytest.approx(0.2)
    assert "the height of the vehicle, though" in low.reasons["gap_size"]


def test_sizes_that_are_given_stay() -> None:
    cloud = floor(np.random.default_rng(9), 3000)
    own = fit_sizes(cloud, Parameters(map=MapParameters(gap_size=0.7)))
    assert own.parameters.grid().gap_size == 0.7
    assert own.reasons.keys() == {"cell_size"}
    null = fit_sizes(cloud, Parameters(map=MapParameters(gap_size=None)))
    assert gap_in_cells(null) == pytest.approx(3)
    both = Parameters(map=MapParameters(cell_size=0.5, gap_size=None))
    assert fit_sizes(cloud, both) == FittedSizes(both, {}, [])
    cells = Parameters(map=MapParameters(cell_size=0.5))
    assert fit_sizes(cloud, cells).parameters.map.cell_size == 0.5
    assert cells.grid().gap_size == 1.5
    assert cells.with_cell_size(0.5, 0.1).grid().gap_size == 0.1
    fixed = Parameters(map=MapParameters(gap_size=Cells(2)))
    assert fixed.with_cell_size(0.5, 0.1).grid().gap_size == 1.0


def test_what_was_set_beside_it_contradicts_no_gap_that_was_found() -> None:
    cloud = floor(np.random.default_rng(10), 3000)
    tall = Parameters(pipeline=(Pyramids(max_height=Cells(2)),))
    sizes = fit_sizes(cloud, tall)
    assert gap_in_cells(sizes) == pytest.approx(3)
    assert "which pyramids.max_height needs" in sizes.reasons["gap_size"]


@pytest.mark.parametrize("cell_size", [0.15, 0.3, 1.2])
def test_a_gap_is_found_for_cells_of_any_size(cell_size: float) -> None:
    rng = np.random.default_rng(5)
    ground = np.concatenate([floor(rng, 3000), floor(rng, 400) * (1, 0.2, 1) + (0, 4, 0.3)])
    given = Parameters(map=MapParameters(cell_size=cell_size))
    open_, walled = (fit_sizes(each, given) for each in (ground, np.r_[ground, walls(rng, 1500)]))
    assert gap_in_cells(open_) == pytest.approx(0.5)
    assert open_.reasons.keys() == walled.reasons.keys() == {"gap_size"}
    assert gap_in_cells(walled) == pytest.approx(3)
    assert "the height of the vehicle, as" in walled.reasons["gap_size"]


def test_with_the_cells_that_it_would_find_a_given_size_makes_the_same_map() -> None:
    cloud = floor(np.random.default_rng(15), 3000)
    found = fit_sizes(cloud)
    given = Parameters(map=MapParameters(cell_size=float(found.parameters.map.cell_size)))
    assert fit_sizes(cloud, given).parameters == found.parameters
    assert build(cloud, given).surface == build(cloud).surface


@settings(max_examples=10, deadline=None)
@given(seeds)
def test_points_that_are_asked_do_not_depend_on_how_they_come(seed: int) -> None:
    rng = np.random.default_rng(seed)
    # More than are asked, some of them twice, and some that lie alike about the origin.
    cloud = np.round(rng.uniform(-3, 3, (9000, 3)), 2) + 0.0
    cloud = np.concatenate([cloud, cloud[:500], cloud[:50] * (-1, 1, 1) + 0.0])
    expected = Neighbourhoods(cloud)
    asked = AskedPoints(0.3)
    for part in np.array_split(rng.permutation(cloud), rng.integers(1, 9)):
        asked.add(part)
    rows = expected.points[expected.some(ASKED)]
    assert set(map(tuple, asked.points.tolist())) == set(map(tuple, rows.tolist()))
    assert len(asked.points) == len(rows)


def test_what_lies_in_no_cell_tells_nothing_of_gaps() -> None:
    cloud = floor(np.random.default_rng(16), 3000)
    beyond = np.array([[1e12, 0, 0], [0, 0, 1e9], [np.nan, 0, 0], [0, 0, np.inf]])
    given = Parameters(map=MapParameters(cell_size=0.3))
    looks = [Keyframe(np.concatenate([cloud, beyond]))]
    assert fit_sizes(looks, given) == fit_sizes(cloud, given)


def test_a_map_that_grows_needs_a_cell_size_and_takes_the_vehicle_for_the_gap() -> None:
    with pytest.raises(UsageError, match=r"map\.cell_size: a growing map needs a number"):
        mlscli.MapBuilder(Parameters())
    growing = mlscli.MapBuilder(loads("map: {cell_size: 0.2}\nvehicle: {height: 0.7}"))
    assert growing.parameters.map.gap_size == 0.7
    assert growing.finish().meta["parameters"]["map"]["gap_size"] == 0.7
    assert mlscli.MapBuilder(Parameters().with_cell_size(0.2)).parameters.grid().gap_size == (
        pytest.approx(0.6)
    )


# --- real recordings ---


def test_a_robot_that_hardly_moves_has_the_cells_of_one_scan(shared_data: Path) -> None:
    bag = shared_data / "bags" / "ros1_jackal_scan_pose.bag"
    recording = mlscli.open_recording(bag, pose_topic="/vrpn_client_node/jackal/pose")
    sizes = fit_sizes(recording)
    assert 0.02 < float(sizes.parameters.map.cell_size) < 0.2


@pytest.mark.parametrize(
    ("file", "has_walls"),
    [
        ("als_bridge_samp21.pcd", False),
        ("als_underpass_samp22.pcd", False),
        ("building_floors_cgal.ply", True),
        ("unitree_ISR_scan_01_raw.xyz", True),
    ],
)
def test_airborne_scans_keep_levels_apart_and_scans_of_buildings_walls_whole(
    file: str, has_walls: bool, shared_data: Path
) -> None:
    sizes = fit_sizes(mlscli.open_recording(shared_data / "multilevel" / file))
    assert gap_in_cells(sizes) == pytest.approx(3 if has_walls else 0.5)


# --- what is told ---


def doubts(points: Float64 | Sequence[Keyframe]) -> list[str]:
    return fit_sizes(points).doubts


def cell_in(sizes: FittedSizes) -> float:
    size = sizes.parameters.map.cell_size
    assert isinstance(size, float)
    return size


def test_a_dense_noisy_floor_gets_cells_that_hold_its_noise() -> None:
    points = floor(np.random.default_rng(11), 12_000, 6.0, 0.15)
    sizes = fit_sizes(points)
    # Noise of this sigma is as wide as sqrt(12) of it, where it is even.
    assert 2.4 < cell_in(sizes) / 0.15 < 4.2
    (doubt,) = sizes.doubts
    assert "is finer than the noise" in doubt
    assert doubt.endswith(f"; {cell_in(sizes):g} is taken")
    surface = mlscli.build_map(points)
    assert np.mean(surface.depth > 0) < 0.03
    assert doubts(floor(np.random.default_rng(11), 6000, sigma=0.01)) == []


def test_cells_stay_as_fine_as_points_that_lie_on_no_surface() -> None:
    cube = np.random.default_rng(11).uniform(0, 10, (9000, 3))
    sizes = fit_sizes(cube)
    assert cell_in(sizes) == auto_cell_size(cube)
    (doubt,) = sizes.doubts
    assert "is finer than the noise" in doubt
    # Its advice is right: wider cells.
    assert float(doubt.split("to ")[-1].split()[0]) > auto_cell_size(cube)


def test_noise_that_a_stage_moves_points_out_of_makes_no_cells_wider() -> None:
    points = floor(np.random.default_rng(11), 8000, 6.0, 0.15)
    moved, left = (fit_sizes(points, Parameters().with_noise(noise)) for noise in (0.01, 0.0))
    assert cell_in(moved) == auto_cell_size(points) < cell_in(left)


def test_cells_beyond_number_are_doubted() -> None:
    rng = np.random.default_rng(12)
    # Two floors of 10 m, 10 km apart.
    far = np.concatenate([floor(rng, 9000), np.add(floor(rng, 9000), (1e4, 1e4, 0))])
    (doubt,) = doubts(far)
    assert "cells of a scene of 1.001e+04 by 1.001e+04" in doubt
    # Not for a few points that lie astray.
    assert doubts(np.concatenate([floor(rng, 9000), rng.uniform(-1e8, 1e8, (20, 3))])) == []


def test_cells_coarse_for_the_scene_are_doubted() -> None:
    (doubt,) = doubts(floor(np.random.default_rng(13), 50))
    assert "is coarse for a scene of" in doubt
    assert doubts(floor(np.random.default_rng(13), 1000)) == []


def test_a_map_says_why_its_sizes_were_chosen_and_doubts_are_notices() -> None:
    heard: list[str] = []
    hear(heard.append)
    cloud = floor(np.random.default_rng(14), 50)
    surface = build(cloud, loads("pipeline: []")).surface
    assert surface.meta["sizes"] == fit_sizes(cloud).reasons
    assert surface.meta["parameters"]["map"]["cell_size"] == surface.cell_size
    assert heard == doubts(cloud)
    sizes = "map: {cell_size: 0.5, gap_size: null}\npipeline: []"
    assert build(cloud, loads(sizes)).surface.meta["sizes"] == {}
    assert len(heard) == 1
