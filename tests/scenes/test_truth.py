"""The truth of scenes, against dense points put through the rule for points.

Ways to pass without being right: a truth that is empty where the reference is; comparing only what
both have; scenes without slopes, walls or openings; a reference that shares code with the truth.
"""

from __future__ import annotations

import json
import math
from collections import Counter, defaultdict
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from mlscli.errors import InputError, UsageError
from mlscli.keyframes.batches import Points
from mlscli.maps.grid import Grid
from mlscli.maps.surface_map import SurfaceMap
from mlscli.pipeline.grouping import group
from mlscli.runtime.arrays import Float64
from mlscli.scenes.parts import floor, ramp, wall
from mlscli.scenes.presets import make
from mlscli.scenes.surfaces import Scene, add_horizontal, add_vertical
from mlscli.scenes.truth import truth, truth_from_meta
from tests.helpers.maps import symmetries, turned_map
from tests.scenes.scenes import cloud, random_scene

CELL, GAP, THICKNESS = 0.25, 0.4, 0.2
FINE = CELL / 16
Cell = tuple[int, int]
Patches = list[tuple[float, float]]


def by_cell(surface: SurfaceMap) -> dict[Cell, Patches]:
    cells: dict[Cell, Patches] = defaultdict(list)
    for ix, iy, height, depth in zip(
        surface.ix.tolist(), surface.iy.tolist(), surface.height.tolist(), surface.depth.tolist(),
        strict=True,
    ):  # fmt: skip
        cells[ix, iy].append((height, depth))
    return cells


def reference(scene: Scene, half: float) -> Points:
    """Return dense points of what covers enough: floors of a cell's area, walls of its side."""
    kept = []
    for surface, (xyz, _) in zip(scene.surfaces, cloud(scene, FINE), strict=True):
        steps = [edge / math.ceil(edge / FINE) for edge in surface.lengths]
        if surface.upright:
            # At each height, how much of the cell's side.
            share = steps[0] * math.hypot(*surface.along[:2]) / surface.lengths[0] / CELL
            heights = np.floor(xyz[:, 2] / steps[1])
        else:
            slant = math.hypot(*surface.normal) / abs(surface.normal[2])
            share = steps[0] * steps[1] / slant / CELL**2
            heights = np.zeros(len(xyz))
        rows = np.column_stack((np.floor(xyz[:, :2] / CELL), heights))
        _, number, counts = np.unique(rows, axis=0, return_inverse=True, return_counts=True)
        kept.append(xyz[counts[number.reshape(-1)] * share >= half])
    xyz = np.concatenate(kept)
    return Points.of(xyz, np.zeros(len(xyz), dtype=np.int32))


def test_dense_points_of_random_scenes_give_the_truth() -> None:
    rng = np.random.default_rng(4)
    kinds: Counter[str] = Counter()
    clear = unclear = 0
    for _ in range(50):
        scene = random_scene(rng, int(rng.integers(1, 8)))
        true = truth(scene, CELL, GAP, THICKNESS)
        true.check()
        found = by_cell(true)
        # Where half a cell, the gap or the thickness is a close call, points cannot decide.
        variants = [
            by_cell(group(points, Grid(CELL, gap, thickness)))
            for points in (reference(scene, 0.45), reference(scene, 0.55))
            for gap in (GAP - 2 * FINE, GAP + 2 * FINE)
            for thickness in (THICKNESS - 0.03, THICKNESS + 0.03)
        ]
        for cell in {*found, *(cell for variant in variants for cell in variant)}:
            shapes = {tuple(depth > 0 for _, depth in v.get(cell, [])) for v in variants}
            heights = [np.array(v.get(cell, [])) for v in variants]
            agree = len(shapes) == 1 and all(
                np.abs(h - heights[0]).max(initial=0) < 0.02 for h in heights
            )
            if not agree:
                unclear += 1
                continue
            clear += 1
            expected = variants[0].get(cell, [])
            kinds[f"{len(expected)} patches"] += 1
            assert len(found.get(cell, [])) == len(expected), (cell, found.get(cell), expected)
            for (height, depth), (true_height, true_depth) in zip(
                expected, found.get(cell, []), strict=True
            ):
                kinds["vertical" if depth else "horizontal"] += 1
                assert true_height == pytest.approx(height, abs=0.025)
                assert true_depth == pytest.approx(depth, abs=0.04)
    assert clear > 2 * unclear
    assert min(kinds[k] for k in ("1 patches", "2 patches", "vertical", "horizontal")) > 100


def patches(scene: Scene, cell: Cell, gap_size: float = 0.5) -> Patches:
    return by_cell(truth(scene, 1.0, gap_size, 0.2)).get(cell, [])


def test_a_surface_counts_where_it_covers_half_of_a_cell() -> None:
    covering = floor(Scene(""), (0.5, 1.49), (0, 1), 2.0)
    assert patches(covering, (0, 0)) == [(2.0, 0.0)]
    assert patches(covering, (1, 0)) == []


def test_surfaces_in_one_plane_count_together_and_others_do_not() -> None:
    quarter = floor(Scene(""), (0, 0.3), (0, 1), 1.0)
    assert patches(floor(quarter, (0.7, 1), (0, 1), 1.0), (0, 0)) == [(1.0, 0.0)]
    assert patches(floor(quarter, (0.7, 1), (0, 1), 1.1), (0, 0)) == []


def test_a_slope_has_the_height_of_its_middle_and_its_exact_variance() -> None:
    scene = ramp(Scene(""), (0, 4), (0, 1), (0.0, 0.4))
    true = truth(scene, 1.0, 0.5, 0.2)
    assert true.height == pytest.approx([0.05, 0.15, 0.25, 0.35])
    assert true.variance == pytest.approx(np.full(4, 0.1**2 / 12))
    assert true.bottom == pytest.approx([0.0, 0.1, 0.2, 0.3])
    assert true.top == pytest.approx([0.1, 0.2, 0.3, 0.4])


def test_a_steep_slope_is_vertical_with_exact_top_and_depth() -> None:
    scene = ramp(Scene(""), (0, 1), (0, 1), (1.0, 3.0))
    (patch,) = patches(scene, (0, 0))
    assert patch == pytest.approx((3.0, 2.0))


def test_a_turned_slope_has_the_variance_of_the_square() -> None:
    scene = add_horizontal(Scene(""), (0.5, 0.5, 0.0), (9, 9), 30, grade=0.1)
    true = truth(scene, 1.0, 0.5, 0.2)
    (middle,) = np.flatnonzero((true.ix == 0) & (true.iy == 0))
    assert true.mean[middle] == pytest.approx(0.0, abs=1e-12)
    # Heights are 0.1 (cos 30 x + sin 30 y); x and y are independent.
    assert true.variance[middle] == pytest.approx(0.1**2 / 12)


def test_a_wall_is_there_where_half_a_side_of_it_is() -> None:
    scene = wall(Scene(""), (0.5, 0.5), (2.4, 0.5), (1.0, 3.0))
    assert patches(scene, (0, 0)) == [(3.0, 2.0)]
    assert patches(scene, (1, 0)) == [(3.0, 2.0)]
    assert patches(scene, (2, 0)) == []


def test_a_wall_that_rises_is_there_at_the_heights_where_half_a_side_of_it_is() -> None:
    rising = add_vertical(Scene(""), (1.5, 0.5, 1.75), (3.0, 2.0), grade=0.5)
    # From 0 to 0.5 at its foot, within a cell; half a side of it stands from 0.25 on.
    assert patches(rising, (0, 0)) == [pytest.approx((2.25, 2.0), abs=1e-5)]
    assert patches(rising, (2, 0)) == [pytest.approx((3.25, 2.0), abs=1e-5)]
    steep = add_vertical(Scene(""), (0.5, 0.5, 1.5), (1.0, 1.0), grade=2.0)
    assert patches(steep, (0, 0)) == [pytest.approx((2.0, 1.0), abs=1e-5)]
    assert patches(add_vertical(Scene(""), (0.5, 0.5, 1.5), (1.0, 0.9), grade=2.0), (0, 0)) == []


def test_a_wall_on_an_edge_stands_in_one_row_of_cells() -> None:
    true = truth(wall(Scene(""), (1.0, 0.0), (1.0, 2.0), (0.0, 1.0)), 1.0, 0.5, 0.2)
    assert list(zip(true.ix.tolist(), true.iy.tolist(), strict=True)) == [(1, 0), (1, 1)]


def test_a_window_is_open_where_half_a_side_of_it_is() -> None:
    window = ((1.0, 2.6), (1.0, 2.0))
    scene = wall(Scene(""), (0.0, 0.5), (4.0, 0.5), (0.0, 3.0), openings=[window])
    assert patches(scene, (0, 0)) == [(3.0, 3.0)]
    for column in (1, 2):
        assert patches(scene, (column, 0)) == [(1.0, 1.0), (3.0, 1.0)]
    assert patches(scene, (3, 0)) == [(3.0, 3.0)]
    assert patches(scene, (1, 0), gap_size=1.0) == [(3.0, 3.0)]


def test_a_hole_in_a_floor_is_open() -> None:
    scene = floor(Scene(""), (0, 3), (0, 3), 0.0, openings=[((1, 2), (1, 2))])
    assert {cell for cell in product(range(3), range(3)) if patches(scene, cell)} == {
        cell for cell in product(range(3), range(3)) if cell != (1, 1)
    }


def test_openings_that_overlap_or_stick_out_are_cut_once() -> None:
    holes = [((0.5, 2), (-1, 1)), ((1, 5), (0.5, 2)), ((1.2, 1.4), (0.6, 0.7))]
    scene = floor(Scene(""), (0, 3), (0, 3), 0.0, openings=holes)
    clear = {cell for cell in product(range(3), range(3)) if patches(scene, cell)}
    # (0, 0) keeps its half; (2, 0) loses its upper half, and keeps the other.
    assert clear == {(0, 0), (2, 0), (0, 1), (0, 2), (1, 2), (2, 2)}


def test_under_a_bridge_it_is_open_and_both_levels_are_exact() -> None:
    true = truth(make("bridge", 2.0), 0.15, 0.5, 0.15)
    under = by_cell(true.crop(-6, 5, -6, 5))
    assert len(under) == 144
    assert set(map(tuple, under.values())) == {((0.0, 0.0), (2.0, 0.0))}


def test_texture_does_not_matter_to_truth() -> None:
    scene = make("village-thesis")
    textured = replace(scene, surfaces=tuple(replace(s, texture=1.0) for s in scene.surfaces))
    assert textured.surfaces != scene.surfaces
    assert truth(textured, 0.15, 0.5, 0.15) == truth(scene, 0.15, 0.5, 0.15)


def test_turning_a_scene_turns_its_truth() -> None:
    scene = make("house-storeys")
    true = truth(scene, 0.15, 0.5, 0.15)

    def turned(vector: tuple[float, float, float], symmetry: tuple[bool, bool, bool]) -> Float64:
        swap, negate_x, negate_y = symmetry
        x, y, z = vector[0] * (-1) ** negate_x, vector[1] * (-1) ** negate_y, vector[2]
        return np.array((y, x, z) if swap else (x, y, z)) + 0.0

    for symmetry in symmetries():
        surfaces = [
            replace(
                s,
                corner=tuple(turned(s.corner, symmetry)),
                along=tuple(turned(s.along, symmetry)),
                across=tuple(turned(s.across, symmetry)),
            )
            for s in scene.surfaces
        ]
        found, expected = (
            truth(Scene("", tuple(surfaces)), 0.15, 0.5, 0.15),
            turned_map(true, symmetry),
        )
        assert found.ix.tobytes() == expected.ix.tobytes()
        assert found.iy.tobytes() == expected.iy.tobytes()
        assert found.height == pytest.approx(expected.height, abs=1e-12)
        assert found.depth == pytest.approx(expected.depth, abs=1e-12)


def test_the_meta_of_a_truth_gives_the_truth_on_any_grid() -> None:
    scene = make("house")
    meta = json.loads(json.dumps(truth(scene, 0.15, 0.5, 0.15).meta))
    for lengths in ((0.15, 0.5, 0.15), (0.2, 0.3, 0.1), (0.07, 0.5, 0.05)):
        assert truth_from_meta(meta, *lengths) == truth(scene, *lengths)


@pytest.mark.parametrize("meta", [{}, {"scene": 3}, {"scene": {"name": "a", "surfaces": []}}])
def test_a_meta_without_a_scene_is_refused(meta: dict[str, object]) -> None:
    with pytest.raises(InputError, match="holds no scene"):
        truth_from_meta(meta, 0.15, 0.5, 0.15)


@pytest.mark.parametrize(
    ("lengths", "named"),
    [
        ((0.0, 0.5, 0.1), "cell size"),
        ((math.nan, 0.5, 0.1), "cell size"),
        ((0.1, -1.0, 0.1), "gap size"),
        ((0.1, 0.5, math.inf), "thickness"),
        ((1e-5, 0.5, 0.1), "cells of"),
    ],
)
def test_lengths_out_of_range_are_refused_before_any_work(
    lengths: tuple[float, float, float], named: str
) -> None:
    with pytest.raises(UsageError, match=named):
        truth(make("bridge"), *lengths)
