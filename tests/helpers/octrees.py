"""A reader of OctoMap's binary files, as its format is described: slow, and of our own."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from mlscli.maps.space import FREE, OCCUPIED

DEPTH = 16


class Leaf(NamedTuple):
    """A leaf: its least corner, in smallest cubes from the origin, how many wide, and its state."""

    x: int
    y: int
    z: int
    wide: int
    state: int


class Tree(NamedTuple):
    side: float
    nodes: int
    leaves: list[Leaf]


def read_octree(path: Path) -> Tree:
    """Return the leaves of a file; it must hold so many nodes as it says, and no more bytes."""
    head, _, data = path.read_bytes().partition(b"\ndata\n")
    lines = head.decode("ascii").splitlines()
    assert lines[0] == "# Octomap OcTree binary file"
    told = dict(line.split() for line in lines if not line.startswith("#"))
    assert told["id"] == "OcTree"
    leaves: list[Leaf] = []
    place, nodes = 0, 1

    def walk(corner: tuple[int, int, int], wide: int) -> None:
        nonlocal place, nodes
        bits = int.from_bytes(data[place : place + 2], "little")
        place += 2
        inner = []
        for child in range(8):
            half = wide // 2
            x, y, z = (corner[axis] + half * (child >> axis & 1) for axis in range(3))
            kind = bits >> 2 * child & 3
            nodes += kind > 0
            if kind == 3:
                assert half > 1
                inner.append((x, y, z))
            elif kind:
                leaves.append(Leaf(x, y, z, half, {1: FREE, 2: OCCUPIED}[kind]))
        for each in inner:
            walk(each, wide // 2)

    least = -(2 ** (DEPTH - 1))
    walk((least, least, least), 2**DEPTH)
    assert place == len(data)
    assert nodes == int(told["size"])
    return Tree(float(told["res"]), nodes, leaves)


def cubes(tree: Tree) -> dict[tuple[int, int, int], int]:
    """Return the state of each smallest cube that is known."""
    known = {}
    for leaf in tree.leaves:
        for step in np.ndindex(leaf.wide, leaf.wide, leaf.wide):
            cube = leaf.x + step[0], leaf.y + step[1], leaf.z + step[2]
            assert cube not in known
            known[cube] = leaf.state
    return known
