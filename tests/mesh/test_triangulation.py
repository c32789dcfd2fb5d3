"""Links and surface triangles against the rule as plain loops over blocks.

Ways to pass without being right: maps without a second level or without equal heights, so the
random maps have both; comparing counts alone, so the corners are compared, in their turn.
"""

from __future__ import annotations

from functools import reduce
from itertools import product
from operator import add

import numpy as np
import pytest

from mlscli.maps.surface_map import SurfaceMap
from mlscli.mesh.triangulation import links, nodes_of, surface_triangles
from tests.helpers.maps import random_map
from tests.helpers.meshes import a_map, plane

# A node: the cell, then what orders the nodes of a cell.
Node = tuple[int, int, float, bool, int]
Cell = tuple[int, int]
CORNERS = ((0, 0), (1, 0), (1, 1), (0, 1))


def nodes_by_cell(surface: SurfaceMap, reach: float) -> dict[Cell, list[Node]]:
    cells: dict[Cell, list[Node]] = {}
    for patch in range(surface.size):
        x, y = int(surface.ix[patch]), int(surface.iy[patch])
        top, depth = float(surface.height[patch]), float(surface.depth[patch])
        cells.setdefault((x, y), []).append((x, y, top, False, patch))
        if depth > 0:
            cells[x, y].append((x, y, top - depth, True, patch))
            cells[x, y] += [(x, y, z, True, patch) for z in met_between(surface, patch, reach)]
    return {cell: sorted(nodes) for cell, nodes in cells.items()}


def met_between(surface: SurfaceMap, patch: int, reach: float) -> list[float]:
    """Return the heights at which floors around meet a vertical patch, far from its ends."""
    low, high = surface.low_end[patch], surface.height[patch]
    met: list[list[float]] = []
    for z, other in sorted(zip(surface.height.tolist(), range(surface.size), strict=True)):
        beside = (
            abs(surface.ix[other] - surface.ix[patch]),
            abs(surface.iy[other] - surface.iy[patch]),
        )
        if max(beside) != 1 or surface.depth[other] > 0 or not (z - low > reach < high - z):
            continue
        if met and z - met[-1][-1] <= reach:
            met[-1].append(z)
        else:
            met.append([z])
    # Not sum(): newer Pythons compensate its rounding.
    return [reduce(add, group) / len(group) for group in met]


def linked(node: Node, cell: Cell, cells: dict[Cell, list[Node]], reach: float) -> Node | None:
    """Return the node of a neighbouring cell that a node is linked with."""

    def nearest(one: Node, others: list[Node]) -> Node:
        return min(reversed(others), key=lambda other: abs(other[2] - one[2]))

    if cell not in cells:
        return None
    other = nearest(node, cells[cell])
    mutual = nearest(other, cells[node[:2]]) == node
    return other if mutual and abs(other[2] - node[2]) <= reach else None


def reference(surface: SurfaceMap, reach: float) -> set[tuple[Node, ...]]:
    """Return the triangles of every block, each beginning with its least corner."""
    cells = nodes_by_cell(surface, reach)
    found: set[tuple[Node, ...]] = set()
    for x, y in {(x - dx, y - dy) for (x, y), (dx, dy) in product(cells, CORNERS)}:
        block = [(x + dx, y + dy) for dx, dy in CORNERS]
        onward: dict[Node, Node] = {}
        for corner, cell in enumerate(block):
            for node in cells.get(cell, []):
                other = linked(node, block[(corner + 1) % 4], cells, reach)
                if other is not None:
                    onward[node] = other
        starts = set(onward) - set(onward.values())
        for start in starts:
            chain = [start]
            while chain[-1] in onward:
                chain.append(onward[chain[-1]])
            found |= {smallest_first(triangle) for triangle in cut_chain(chain)}
        for a in cells.get(block[0], []):
            ring = [a]
            while ring[-1] in onward and len(ring) < 5:
                ring.append(onward[ring[-1]])
            if len(ring) == 5 and ring[4] == a:
                found |= {smallest_first(triangle) for triangle in cut_ring(ring[:4])}
    return found


def cut_ring(ring: list[Node]) -> list[tuple[Node, ...]]:
    a, b, c, d = ring
    if all(node[3] for node in ring):
        return []
    if abs(a[2] - c[2]) <= abs(b[2] - d[2]):
        return [(a, b, c), (a, c, d)]
    return [(b, c, d), (b, d, a)]


def cut_chain(chain: list[Node]) -> list[tuple[Node, ...]]:
    if len(chain) < 3 or all(node[3] for node in chain):
        return []
    if len(chain) % 2 == 0:
        head, tail = abs(chain[0][2] - chain[2][2]), abs(chain[-1][2] - chain[-3][2])
        last_stays = (tail, -chain[-1][2]) < (head, -chain[0][2])
        chain = chain[1:] if last_stays else chain[:-1]
    return [tuple(chain[i : i + 3]) for i in range(0, len(chain) - 2, 2)]


def smallest_first(triangle: tuple[Node, ...]) -> tuple[Node, ...]:
    first = triangle.index(min(triangle))
    return triangle[first:] + triangle[:first]


def triangles_of(surface: SurfaceMap, reach: float) -> list[tuple[Node, ...]]:
    nodes = nodes_of(surface, reach)
    link = links(surface, nodes, reach)
    names = [
        (int(surface.ix[p]), int(surface.iy[p]), float(z), bool(foot), int(p))
        for p, z, foot in zip(nodes.patch, nodes.height, nodes.is_joint, strict=True)
    ]
    found = surface_triangles(link, nodes.height, nodes.is_joint)
    return [smallest_first(tuple(names[n] for n in triangle)) for triangle in found.tolist()]


@pytest.mark.parametrize("seed", range(300))
def test_surface_triangles_are_those_of_the_rule(seed: int) -> None:
    rng = np.random.default_rng(seed)
    surface, reach = random_map(rng), float(rng.choice([0.0, 0.25, 0.6, 3.0]))
    triangles = triangles_of(surface, reach)
    assert len(set(triangles)) == len(triangles)
    assert set(triangles) == reference(surface, reach)


def test_the_random_maps_join_floors_tops_and_feet_in_rings_and_chains() -> None:
    feet, blocks = set(), set()
    for seed in range(300):
        triangles = reference(random_map(np.random.default_rng(seed)), 0.6)
        feet |= {sum(node[3] for node in triangle) for triangle in triangles}
        blocks |= {len(triangles)}
    assert feet == {0, 1, 2, 3}
    assert {0, 1, 2} < blocks


def test_links_of_two_cells_are_mutual_and_never_cross() -> None:
    for seed in range(100):
        surface = random_map(np.random.default_rng(seed))
        nodes = nodes_of(surface, 3.0)
        link = links(surface, nodes, 3.0)
        for side in range(4):
            here = np.flatnonzero(link[:, side] >= 0)
            there = link[here, side]
            assert (link[there, (side + 2) % 4] == here).all()
            for start, end in zip(nodes.start[:-1], nodes.start[1:], strict=True):
                assert (np.diff(there[(here >= start) & (here < end)]) > 0).all()


@pytest.mark.parametrize(("width", "length"), [(1, 1), (1, 9), (2, 2), (2, 7), (30, 20)])
def test_a_plane_has_two_triangles_for_each_block(width: int, length: int) -> None:
    triangles = triangles_of(a_map(*plane(width, length)), 1.0)
    assert len(triangles) == 2 * (width - 1) * (length - 1)


def test_a_bridge_and_its_ground_are_two_sheets() -> None:
    surface = a_map(*plane(6, 4), *plane(6, 4, height=3.0))
    triangles = triangles_of(surface, 1.0)
    assert len(triangles) == 2 * 2 * 5 * 3
    assert all(len({node[2] for node in triangle}) == 1 for triangle in triangles)


@pytest.mark.parametrize("missing", range(4))
def test_three_cells_of_a_block_make_one_triangle(missing: int) -> None:
    columns = [(*corner, 0.0, 0.0) for i, corner in enumerate(CORNERS) if i != missing]
    assert len(triangles_of(a_map(*columns), 1.0)) == 1


def test_a_turn_of_a_spiral_ramp_makes_two_triangles_that_share_a_corner() -> None:
    surface = a_map((0, 0, 0, 0), (1, 0, 1, 0), (1, 1, 2, 0), (0, 1, 3, 0), (0, 0, 4, 0))
    one, other = triangles_of(surface, 1.0)
    assert len(set(one) & set(other)) == 1


def test_steps_up_to_the_reach_are_joined_and_higher_ones_are_not() -> None:
    at_reach = a_map((0, 0, 0, 0), (1, 0, 0.5, 0), (0, 1, 0, 0), (1, 1, 0.5, 0))
    assert len(triangles_of(at_reach, 0.5)) == 2
    assert triangles_of(at_reach, np.nextafter(0.5, 0)) == []


def test_a_ring_is_cut_along_its_less_steep_diagonal() -> None:
    for low in range(4):
        columns = [(*corner, 0.0 if i == low else 1.0, 0.0) for i, corner in enumerate(CORNERS)]
        corner = CORNERS[low]
        holding = [t for t in triangles_of(a_map(*columns), 1.0) if corner in {n[:2] for n in t}]
        assert len(holding) == 1


def test_the_inside_of_a_wall_has_a_crown_and_no_floor() -> None:
    columns = [(x, y, 3.0, 3.0) for x, y in CORNERS]
    triangles = triangles_of(a_map(*columns), 1.0)
    assert len(triangles) == 2
    assert not any(node[3] for triangle in triangles for node in triangle)


def test_a_floor_reaches_the_foot_of_a_wall_and_a_roof_its_top() -> None:
    wall = [(0, y, 3.0, 3.0) for y in range(3)]
    floor = [(1, y, 0.1, 0.0) for y in range(3)]
    roof = [(-1, y, 2.9, 0.0) for y in range(3)]
    triangles = triangles_of(a_map(*wall, *floor, *roof), 1.0)
    feet = [t for t in triangles if any(node[3] for node in t)]
    assert (len(triangles), len(feet)) == (8, 4)


def test_cells_at_the_ends_of_the_grid_have_no_neighbours_across() -> None:
    least, greatest = -(2**31), 2**31 - 1
    cells = [(x, y, 0.0, 0.0) for x, y in product((least, greatest), repeat=2)]
    assert triangles_of(a_map(*cells), 1.0) == []
