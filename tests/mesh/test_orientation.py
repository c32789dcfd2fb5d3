"""Walls look outward, and alike.

Ways to pass without being right: to look at walls along one axis only, or all of whose triangles
happen to be numbered alike; a closed room, whose walls must look inward below and cannot tell
outside a floor on both sides.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

import mlscli
from mlscli.maps.surface_map import SurfaceMap
from mlscli.mesh import Mesh, build_mesh
from mlscli.runtime.arrays import Float64
from mlscli.scenes.flight import fly
from mlscli.scenes.presets import make
from mlscli.scenes.truth import truth
from tests.helpers.maps import symmetries, turned_map
from tests.helpers.meshes import Column, a_map, shared_edges, shared_edges_of

TRUE_SCENES = ("bridge-walls", "planes-walls", "house", "village-thesis", "house-storeys", "stair")


def box() -> SurfaceMap:
    """Return a plain with a block on it: roof, walls, and nothing seen inside."""
    columns: list[Column] = []
    for x, y in product(range(12), range(12)):
        inside, within = (3 <= x <= 8 and 3 <= y <= 8), (4 <= x <= 7 and 4 <= y <= 7)
        columns.append((x, y, 4.0, 0.0) if within else (x, y, 4.0 * inside, 4.0 * inside))
    return a_map(*columns)


def walls(mesh: Mesh) -> tuple[Float64, Float64]:
    """Return the centres and the normals of upright triangles."""
    corners = mesh.vertices[mesh.triangles]
    a, b, c = np.moveaxis(corners, 1, 0)
    normal = np.cross(b - a, c - a)
    upright = np.abs(normal[:, 2]) < 1e-9
    return corners[upright].mean(axis=1), normal[upright]


@pytest.mark.parametrize("turn", list(symmetries()))
def test_the_walls_of_a_block_look_away_from_it(turn: tuple[bool, bool, bool]) -> None:
    surface = turned_map(box(), turn)
    centre, normal = walls(build_mesh(surface))
    middle = np.array([surface.ix.mean() + 0.5, surface.iy.mean() + 0.5, 2.0])
    assert len(centre) > 0
    assert (((centre - middle) * normal).sum(axis=1) > 0).all()


@pytest.mark.parametrize("turn", list(symmetries()))
def test_the_walls_of_a_pit_look_into_it(turn: tuple[bool, bool, bool]) -> None:
    columns: list[Column] = []
    for x, y in product(range(12), range(12)):
        rim, within = (3 <= x <= 8 and 3 <= y <= 8), (4 <= x <= 7 and 4 <= y <= 7)
        columns.append((x, y, -4.0, 0.0) if within else (x, y, 0.0, 4.0 * rim))
    surface = turned_map(a_map(*columns), turn)
    centre, normal = walls(build_mesh(surface))
    middle = np.array([surface.ix.mean() + 0.5, surface.iy.mean() + 0.5, -2.0])
    assert (((centre - middle) * normal).sum(axis=1) < 0).all()


@pytest.mark.parametrize("kind", ["house-storeys", "planes-walls"])
def test_walls_that_contradict_themselves_do_so_at_single_edges(kind: str) -> None:
    points = [keyframe.points for keyframe in fly(make(kind)).keyframes]
    builder = mlscli.MapBuilder(mlscli.load_parameters("plain", ["map.cell_size=0.15"]))
    builder.process_cloud(np.concatenate(points))
    mesh = build_mesh(builder.finish())
    a, b, c = np.moveaxis(mesh.vertices[mesh.triangles], 1, 0)
    upright = np.abs(np.cross(b - a, c - a)[:, 2]) < 1e-12
    mesh = replace(mesh, triangles=mesh.triangles[upright])
    pairs = [directions for directions in shared_edges(mesh) if len(directions) == 2]
    assert len(pairs) > 500
    assert sum(abs(sum(directions)) == 2 for directions in pairs) < len(pairs) / 100


def test_a_wall_that_stands_free_looks_to_one_side() -> None:
    mesh = build_mesh(a_map(*[(x, 0, 3.0 + x % 2, 3.0 + x % 2) for x in range(9)]))
    _, normal = walls(mesh)
    assert len(set(np.sign(normal[:, 1]).tolist())) == 1


def test_a_block_on_a_plain_has_no_crack_and_no_edge_of_three() -> None:
    mesh = build_mesh(box())
    counts = [len(directions) for directions in shared_edges(mesh)]
    assert max(counts) == 2
    # The rim of the plain, 11 cells from centre to centre.
    assert counts.count(1) == 4 * 11


@pytest.mark.parametrize("name", ["planes-walls", "gym", "tunnel", "village"])
def test_where_no_wall_has_floor_on_both_sides_no_edge_has_three_triangles(name: str) -> None:
    mesh = build_mesh(truth(make(name), 0.15, 0.5, 0.15))
    assert max(len(directions) for directions in shared_edges(mesh)) == 2


@pytest.mark.parametrize("name", TRUE_SCENES)
def test_triangles_run_through_shared_edges_in_opposite_directions(name: str) -> None:
    mesh = build_mesh(truth(make(name), 0.15, 0.5, 0.15))
    for directions in shared_edges(mesh):
        assert len(directions) != 2 or sum(directions) == 0


@pytest.mark.parametrize(
    ("name", "branches"),
    [
        # A wall with floor on both sides has two floors at its foot.
        *((name, {"ffw"}) for name in ("bridge-walls", "village-thesis", "bridge-gap", "street")),
        # A storey meets a wall between its ends.
        ("house-storeys", {"ffw", "fww"}),
        # The front of each step meets the sides of the stair.
        ("stair", {"ffw", "www"}),
    ],
)
def test_edges_have_three_triangles_where_the_map_branches_and_none_has_more(
    name: str, branches: set[str]
) -> None:
    edges = kinds_at_edges(build_mesh(truth(make(name), 0.15, 0.5, 0.15)))
    assert {kinds for kinds in edges.values() if len(kinds) > 2} == branches


@pytest.mark.parametrize(
    ("name", "open_at"),
    [
        *((name, set()) for name in ("bridge-walls", "planes-walls", "bridge-gap", "tunnel")),
        # Sills and lintels of windows.
        ("house-storeys", {0.3, 0.9, 1.5, 2.1}),
        ("gym", {0.9, 1.5, 2.1}),
    ],
)
def test_walls_are_closed_at_foot_and_top_onto_what_they_meet(
    name: str, open_at: set[float]
) -> None:
    mesh = build_mesh(truth(make(name), 0.15, 0.5, 0.15))
    alone = np.array([edge for edge, kinds in kinds_at_edges(mesh).items() if kinds == "w"])
    begin, end = mesh.vertices[alone[:, 0]], mesh.vertices[alone[:, 1]]
    level = np.hypot(*(end - begin)[:, :2].T) > 1e-9
    assert {round(height, 6) for height in (begin + end)[level, 2] / 2} == open_at


def kinds_at_edges(mesh: Mesh) -> dict[tuple[int, int], str]:
    """Return what triangles each edge has, by its ends: f of a floor, w of a wall, in order."""
    a, b, c = np.moveaxis(mesh.vertices[mesh.triangles], 1, 0)
    kind = np.where(np.abs(np.cross(b - a, c - a)[:, 2]) < 1e-12, "w", "f").tolist()
    found = defaultdict[tuple[int, int], list[str]](list)
    for corners, which in zip(mesh.triangles.tolist(), kind, strict=True):
        for i in range(3):
            found[min(corners[i - 1], corners[i]), max(corners[i - 1], corners[i])].append(which)
    return {edge: "".join(sorted(kinds)) for edge, kinds in found.items()}


def test_a_tunnel_looks_into_itself_but_for_its_vault() -> None:
    mesh = build_mesh(truth(make("tunnel"), 0.15, 0.5, 0.15))
    centre, normal = walls(mesh)
    inside = np.abs(centre[:, 1]) < 6 * 0.15
    assert inside.sum() > 100
    along = inside & (np.abs(normal[:, 1]) > 0)
    assert (normal[along, 1] * centre[along, 1] < 0).all()
    # The vault, which looks up as all surfaces do, and what carries it run alike, and nothing else.
    edges = shared_edges_of(mesh)
    alike = [edge for edge, directions in edges.items() if abs(sum(directions)) == 2]
    assert alike
    assert {round(height, 9) for height in mesh.vertices[np.array(alike), 2].ravel()} == {1.2}
