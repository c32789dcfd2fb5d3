"""A mesh scored by a scan: cases whose figures are known, and a slow reference.

How one could cheat, and what would pass without being right: a recall of what the mesh covers only,
by which half a map is whole; a precision of the parts beside the scan left out unsaid, or by which
a roof over a hole in the scan is nobody's; many small triangles, or many points in one place, that
outvote the rest; a triangle judged by its corners or its middle; red blamed for what others got
wrong. And a greater distance, which is met more easily: it stands in the score.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from mlscli.errors import InputError, UsageError
from mlscli.maps.surface_map import ARTIFICIAL, MEASURED
from mlscli.mesh import Mesh, build_mesh
from mlscli.runtime.arrays import Array, Float64
from mlscli.scoring import MeshScore, score_mesh, seen_by
from tests.helpers.maps import Patch, map_of
from tests.scoring import references as slow

CELL = 0.5


def mesh_of(vertices: Any, triangles: Any, origin: Array | None = None) -> Mesh:
    size = len(vertices)
    return Mesh(
        vertices=np.array(vertices, dtype=np.float64),
        colours=np.zeros((size, 3), dtype=np.uint8),
        origin=np.zeros(size, dtype=np.uint8) if origin is None else origin,
        triangles=np.array(triangles, dtype=np.int32),
        lines=np.empty((0, 2), dtype=np.int32),
        points=np.empty(0, dtype=np.int32),
        patch=np.zeros(size, dtype=np.int32),
    )


def sheet(width: float, length: float, z: float = 0.0, x: float = 0.0, origin: int = 0) -> Mesh:
    """Return a level rectangle of two triangles, from x on and from y = 0 on."""
    east = x + width
    corners = np.array([(x, 0, z), (east, 0, z), (east, length, z), (x, length, z)])
    return mesh_of(corners, np.array([(0, 1, 2), (0, 2, 3)]), np.full(4, origin, dtype=np.uint8))


def together(*meshes: Mesh) -> Mesh:
    first = np.cumsum([0, *(len(each.vertices) for each in meshes)])
    return mesh_of(
        np.concatenate([each.vertices for each in meshes]),
        np.concatenate([each.triangles + n for each, n in zip(meshes, first, strict=False)]),
        np.concatenate([each.origin for each in meshes]),
    )


def plane(width: float, length: float, z: float = 0.0, x: float = 0.0) -> Float64:
    """Return points of a level rectangle, a tenth apart."""
    across, along = np.meshgrid(np.arange(0.05, width, 0.1), np.arange(0.05, length, 0.1))
    return np.column_stack((across.ravel() + x, along.ravel(), np.full(across.size, z)))


def rates(score: MeshScore) -> list[Any]:
    return [score.precision, score.recall, score.f]


# --- cases whose figures are known ---


def test_a_plane_and_its_own_map_agree_wholly() -> None:
    surface = map_of([Patch(x, y, 0.0, 0.0, 0, 1) for x in range(10) for y in range(8)])
    score = score_mesh(build_mesh(surface), plane(5, 4), CELL)
    assert rates(score) == [1.0, 1.0, 1.0]
    assert (score.beside, score.unseen, score.points, score.points_found) == (0, 0, 2000, 1)
    # The mesh ends at the centres of the outer cells.
    assert score.area == pytest.approx(4.5 * 3.5)
    assert score.by_origin["measured"].share == 1
    assert score.by_origin["artificial"].precision is None


def test_shifted_by_two_cells_nothing_agrees() -> None:
    score = score_mesh(sheet(5, 4, z=2 * CELL), plane(5, 4), CELL)
    assert rates(score) == [0.0, 0.0, 0.0]
    assert score.beside == 0


def test_a_shift_is_near_up_to_the_distance_and_no_farther() -> None:
    scan = plane(5, 4)
    near, far = (rates(score_mesh(sheet(5, 4, z=z), scan, CELL)) for z in (0.49, 0.51))
    assert near[1] == 1
    # Near the edges, no point of the scan is right below.
    assert near[0] > 0.9
    assert far == [0, 0, 0]


def test_what_half_a_map_has_lost_it_has_not_found() -> None:
    score = score_mesh(sheet(10, 4), plane(20, 4), CELL)
    # The scan is found up to a cell beyond the edge.
    assert rates(score)[:2] == [1.0, pytest.approx(10.5 / 20)]
    assert score.f == pytest.approx(2 * 0.525 / 1.525)


def test_a_phantom_roof_costs_its_share_of_the_area() -> None:
    phantom = together(sheet(10, 4), sheet(6, 4, z=3.0, origin=ARTIFICIAL))
    score = score_mesh(phantom, plane(10, 4), CELL)
    assert rates(score)[:2] == [pytest.approx(10 / 16), 1.0]
    red, measured = score.by_origin["artificial"], score.by_origin["measured"]
    assert [red.share, red.precision, red.recall_won] == [pytest.approx(6 / 16), 0, 0]
    assert red.precision_lost == pytest.approx(6 / 16)
    assert measured.precision == 1
    assert measured.precision_lost == pytest.approx(-10 / 16)
    assert measured.recall_won == 1
    assert score.by_origin["plastered"].share == 0
    assert score.by_origin["plastered"].precision_lost == 0


def test_red_that_is_right_is_told_with_what_it_has_found() -> None:
    closed = together(sheet(6, 4), sheet(4, 4, x=6.0, origin=ARTIFICIAL))
    red = score_mesh(closed, plane(10, 4), CELL).by_origin["artificial"]
    assert [red.share, red.precision, red.precision_lost] == [pytest.approx(0.4), 1, 0]
    # What the rest finds a cell beyond its edge is not its merit.
    assert red.recall_won == pytest.approx(0.35)


def test_a_triangle_between_origins_has_the_last_of_them() -> None:
    origin = np.array([MEASURED, MEASURED, ARTIFICIAL, MEASURED], dtype=np.uint8)
    both = mesh_of(sheet(4, 4).vertices, [(0, 1, 2), (0, 1, 3)], origin)
    by_origin = score_mesh(both, plane(4, 4), CELL).by_origin
    assert by_origin["artificial"].share == by_origin["measured"].share == 0.5


def test_a_long_triangle_is_right_where_it_lies_on_the_scan_only() -> None:
    spike = mesh_of([(0, 0, 0), (0, 0.2, 0), (40, 0.1, 0)], [(0, 1, 2)])
    score = score_mesh(spike, plane(10, 0.3), 0.2, whole=True)
    # What lies beyond x = 10.1 is wrong: a triangle like the whole, as the square of its length.
    assert score.precision == pytest.approx(1 - (29.9 / 40) ** 2, abs=0.01)


# --- what counts ---


def test_what_lies_beside_the_scan_is_not_judged_but_told() -> None:
    scan, wide = plane(10, 4), sheet(20, 4)
    score = score_mesh(wide, scan, CELL)
    # Three distances beyond the last column of half a distance.
    assert score.beside == pytest.approx(8.5 / 20, abs=0.01)
    assert score.precision == pytest.approx(10.5 / 11.5, abs=0.02)
    assert score.area == pytest.approx(11.5 * 4, rel=0.02)
    whole = score_mesh(wide, scan, CELL, whole=True)
    assert [whole.beside, whole.area] == [0, pytest.approx(80)]
    assert whole.precision == pytest.approx(10.5 / 20, abs=0.01)


def test_a_phantom_above_or_below_the_scan_is_judged_however_far() -> None:
    for z in (-40.0, 40.0):
        score = score_mesh(together(sheet(10, 4), sheet(10, 4, z=z)), plane(10, 4), CELL)
        assert [score.beside, score.precision] == [0, pytest.approx(0.5)]


def test_the_flight_says_what_could_be_found() -> None:
    scan = plane(20, 4)
    flight = plane(10, 4)[::7]
    seen = seen_by(flight, scan, CELL)
    score = score_mesh(sheet(10, 4), scan, CELL, seen=seen)
    assert score.unseen == pytest.approx(8.5 / 20, abs=0.01)
    assert score.points == np.count_nonzero(seen)
    # Three distances beyond the flight's end, of which the map finds one.
    assert score.recall == pytest.approx(10.5 / 11.5, abs=0.01)
    # The flight was there: a map that has lost a half cannot say that it was not.
    assert score_mesh(sheet(5, 4), scan, CELL, seen=seen).recall == pytest.approx(
        5.5 / 11.5, abs=0.01
    )
    # What the mesh is right about needs no flight.
    assert score_mesh(sheet(20, 4), scan, CELL, seen=seen).precision == 1


def test_dense_parts_of_the_scan_count_no_more_than_others() -> None:
    scan = plane(20, 4)
    lost = scan[scan[:, 0] > 10.5]
    close_by = np.repeat(scan[scan[:, 0] < 10], 50, axis=0)
    once, often = (
        score_mesh(sheet(10, 4), points, CELL)
        for points in (scan, np.concatenate((close_by, scan)))
    )
    assert rates(often) == pytest.approx(rates(once))
    assert once.points_found == pytest.approx(once.recall)
    assert often.points_found == 1 - len(lost) / often.points > 0.97


def finer(mesh: Mesh) -> Mesh:
    """Return the mesh with each triangle cut into three, around its middle."""
    corners = mesh.vertices[mesh.triangles]
    middle = len(mesh.vertices) + np.arange(len(corners))
    a, b, c = mesh.triangles.T
    triangles = np.concatenate(
        [np.column_stack((p, q, middle)) for p, q in ((a, b), (b, c), (c, a))]
    )
    return mesh_of(np.concatenate((mesh.vertices, corners.mean(axis=1))), triangles)


def test_small_triangles_count_no_more_than_large_ones() -> None:
    wrong = sheet(10, 4, z=3.0)
    many = finer(finer(finer(wrong)))
    assert len(many.triangles) == 54
    for mesh in (wrong, many, together(many, mesh_of(np.zeros((3, 3)), [(0, 1, 2), (0, 0, 0)]))):
        score = score_mesh(together(sheet(10, 4), mesh), plane(10, 4), CELL)
        assert score.precision == pytest.approx(0.5)


def random_scene(seed: int) -> tuple[Mesh, Float64]:
    rng = np.random.default_rng(seed)
    vertices = rng.uniform(-1, 1, (12, 3)) * (1, 1, 0.5) + rng.integers(-5, 5, 3)
    triangles = np.array([rng.permutation(12)[:3] for _ in range(6)])
    mesh = mesh_of(vertices, triangles, rng.integers(0, 3, 12).astype(np.uint8))
    weights = rng.dirichlet((1, 1, 1), 60)
    scan = np.einsum("ij,ijk->ik", weights, vertices[triangles[rng.integers(0, 4, 60)]])
    return mesh, scan + rng.normal(0, 0.2, scan.shape)


def test_the_slow_reference_finds_the_same() -> None:
    within = 0.3
    for seed in range(5):
        mesh, scan = random_scene(seed)
        score = score_mesh(mesh, scan, within, whole=True)
        corners, group = mesh.vertices[mesh.triangles], mesh.group(mesh.triangles)
        areas = np.array([slow.areas(each, scan, within, 0.1) for each in corners])
        near = np.array([[slow.to_triangle(p, *each) <= within for each in corners] for p in scan])

        def slowly(chosen: Any) -> tuple[float, float]:
            right, total = areas[chosen].sum(axis=0)  # noqa: B023
            found: Any = near[:, chosen].any(axis=1)  # noqa: B023
            return right / total if total else 0.0, slow.recall(scan, found.tolist(), within)  # noqa: B023

        precision, recall = slowly(group >= 0)
        assert score.recall == pytest.approx(recall, abs=1e-12)
        assert score.precision == pytest.approx(precision, abs=0.015)
        assert 0.3 < precision < 0.99 > recall > 0.5
        for number, part in enumerate(score.by_origin.values()):
            higher, lower = slowly(group != number)
            assert part.recall_won == pytest.approx(recall - lower, abs=1e-12)
            assert part.precision_lost == pytest.approx(higher - precision, abs=0.02)
            own = areas[group == number]
            assert part.share == pytest.approx(own[:, 1].sum() / areas[:, 1].sum())


def test_no_order_changes_a_bit() -> None:
    mesh, scan = random_scene(1)
    rng = np.random.default_rng(1)
    shuffled = mesh_of(mesh.vertices, rng.permutation(mesh.triangles), mesh.origin)
    expected = score_mesh(mesh, scan, 0.3).to_dict()
    assert score_mesh(shuffled, rng.permutation(scan), 0.3).to_dict() == expected
    # Many threads, none of which may change a count.
    many = mesh_of(mesh.vertices, np.tile(mesh.triangles, (1500, 1)), mesh.origin)
    assert score_mesh(many, scan, 0.3).recall == expected["recall"]


def test_a_score_is_ready_for_json() -> None:
    told = score_mesh(*random_scene(1), 0.3).to_dict()
    assert json.loads(json.dumps(told)) == told


# --- what cannot be scored ---


def test_an_empty_mesh_has_found_nothing() -> None:
    score = score_mesh(mesh_of(np.empty((0, 3)), np.empty((0, 3))), plane(2, 2), CELL)
    assert rates(score) == [0, 0, 0]
    assert score.area == score.beside == 0


@pytest.mark.parametrize(
    ("within", "seen", "complaint"),
    [
        (1e-5, None, "`within` 1e-05: too small for this mesh, which would be cut into 7.2e"),
        (CELL, np.ones(3, dtype=np.bool_), r"`seen`: has shape \(3,\) and dtype bool; expected a "),
        (CELL, np.arange(400), r"`seen`: has shape \(400,\) and dtype int64; expected a mask"),
        (CELL, np.zeros(400, dtype=np.bool_), "no point of the scan counts"),
        (0.0, None, "`within` 0.0: expected a number above 0"),
    ],
)
def test_what_cannot_be_scored_is_refused_before_the_work(
    within: float, seen: Any, complaint: str
) -> None:
    with pytest.raises((UsageError, InputError), match=f"^{complaint}"):
        score_mesh(sheet(4, 4), plane(2, 2), within, seen=seen)
