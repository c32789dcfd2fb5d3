"""OctoMap's files, voxel by voxel, by a slow reader of our own and by OctoMap's.

How one could cheat: to swap two axes or the order of children, so maps have no symmetry and lie on
both sides of the origin; to forget free space, or call it all that is not occupied; to count nodes
in a way that OctoMap does not; never to join eight alike, or to join what is not alike.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mlscli.errors import OutputError, UsageError
from mlscli.io.writing.octomap import write_octomap
from mlscli.maps import space
from mlscli.maps.space import FREE, NEVER_SEEN, OCCUPIED, UNKNOWN, space_at
from mlscli.maps.surface_map import SurfaceMap
from mlscli.runtime.arrays import Float64
from tests.helpers.maps import Patch, map_of, random_map
from tests.helpers.meshes import house
from tests.helpers.octrees import cubes, read_octree
from tests.rasters.test_flying import with_random_free


def octomap_reader() -> Any:
    """Return OctoMap's own library, or skip where there is none."""
    return pytest.importorskip("pyoctomap", reason="OctoMap's reader: pip install pyoctomap")


def a_map(seed: int = 1) -> SurfaceMap:
    return with_random_free(house(), np.random.default_rng(seed))


def around(surface: SurfaceMap) -> Float64:
    """Return the middles of all smallest cubes in and around a map, float64 (N, 3)."""
    assert surface.free is not None
    half = surface.cell_size / 2
    ends = [
        (2 * min(int(own.min()), int(free.min())) - 3, 2 * max(int(own.max()), int(free.max())) + 5)
        for own, free in ((surface.ix, surface.free.ix), (surface.iy, surface.free.iy))
    ]
    heights = np.concatenate((surface.low_end, surface.height)) / half
    low, high = min(heights.min(), surface.free.iz.min()), max(heights.max(), surface.free.iz.max())
    ends.append((int(low) - 3, int(high) + 3))
    axes = [np.arange(*each) + 0.5 for each in ends]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3) * half


def test_every_voxel_is_what_the_map_says(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    for number in range(12):
        surface = with_random_free(random_map(rng) if number else house(), rng)
        if not surface.size:
            continue
        path = tmp_path / f"{number}.bt"
        written = write_octomap(path, surface)
        tree = read_octree(path)
        assert (tree.side, tree.nodes) == (surface.cell_size / 2, written.nodes)
        places = around(surface)
        states = space_at(surface, places)
        expected = {
            tuple(np.floor(place / tree.side).astype(int).tolist()): int(state)
            for place, state in zip(places, states, strict=True)
            if state in (FREE, OCCUPIED)
        }
        assert cubes(tree) == expected
        found = [sum(state == each for state in expected.values()) for each in (OCCUPIED, FREE)]
        assert found == [4 * written.occupied, 4 * written.free]
        assert min(found) > 0


def test_octomap_s_own_reader_finds_every_voxel_as_the_map_has_it(tmp_path: Path) -> None:
    octomap = octomap_reader()
    surface = a_map()
    written = write_octomap(tmp_path / "a.bt", surface)
    tree = octomap.OcTree(1.0)
    assert tree.readBinary(str(tmp_path / "a.bt"))
    assert (tree.getResolution(), tree.size()) == (surface.cell_size / 2, written.nodes)
    places = around(surface)
    states = space_at(surface, places)
    # OctoMap does not tell what was seen once from what never was.
    states[states == NEVER_SEEN] = UNKNOWN
    assert set(states.tolist()) == {UNKNOWN, FREE, OCCUPIED}
    for place, state in zip(places, states.tolist(), strict=True):
        node = tree.search(place)
        found = UNKNOWN if node is None else OCCUPIED if tree.isNodeOccupied(node) else FREE
        assert found == state


def test_octomap_writes_the_same_bytes(tmp_path: Path) -> None:
    octomap = octomap_reader()
    write_octomap(tmp_path / "mine.bt", a_map())
    tree = octomap.OcTree(1.0)
    assert tree.readBinary(str(tmp_path / "mine.bt"))
    tree.writeBinary(str(tmp_path / "its.bt"))
    mine, its = ((tmp_path / name).read_bytes() for name in ("mine.bt", "its.bt"))
    # Its prune finds nothing that is left to join.
    assert mine.partition(b"\ndata\n")[2] == its.partition(b"\ndata\n")[2]


def test_eight_alike_are_one_leaf_however_large(tmp_path: Path) -> None:
    wall = [Patch(x, y, 3.99, 3.99 - 0.01, 0, 2) for x in range(8) for y in range(8)]
    write_octomap(tmp_path / "a.bt", map_of(wall))
    tree = read_octree(tmp_path / "a.bt")
    assert tree.leaves == [(0, 0, 0, 16, OCCUPIED)]
    # Each node from the root to the leaf.
    assert tree.nodes == 1 + 12


def test_a_map_without_free_space_has_none(tmp_path: Path) -> None:
    assert write_octomap(tmp_path / "a.bt", house()).free == 0
    assert {leaf.state for leaf in read_octree(tmp_path / "a.bt").leaves} == {OCCUPIED}


def test_artificial_patches_and_single_lines_count_as_told(tmp_path: Path) -> None:
    surface = a_map()
    certain = surface.take(surface.origin != 2)
    assert certain.size < surface.size
    write_octomap(tmp_path / "a.bt", surface, artificial=False, least=1)
    known = cubes(read_octree(tmp_path / "a.bt"))
    half = surface.cell_size / 2
    places = around(surface)
    states = space_at(certain, places, least=1)
    states[states == NEVER_SEEN] = UNKNOWN
    for place, state in zip(places, states.tolist(), strict=True):
        assert known.get(tuple(np.floor(place / half).astype(int).tolist()), UNKNOWN) == state


def test_maps_of_nothing_and_such_as_keys_do_not_reach_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cell = 0.5
    for patch in (
        Patch(2**14, 0, 0.0, 0.0, 0, 1),
        Patch(0, -(2**14) - 1, 0.0, 0.0, 0, 1),
        Patch(0, 0, 2.0**15 * cell / 2, 0.0, 0, 1),
        Patch(0, 0, 0.0, 2.0**15 * cell, 0, 1),
    ):
        with pytest.raises(UsageError, match=r"farther than 8192 from its origin.*`crop`"):
            write_octomap(tmp_path / "a.bt", map_of([patch], cell_size=cell))
    edges = [Patch(2**14 - 1, -(2**14), 2.0**15 * cell / 2 - 0.01, 0.0, 0, 1)]
    write_octomap(tmp_path / "edge.bt", map_of(edges, cell_size=cell))
    assert set(cubes(read_octree(tmp_path / "edge.bt"))) == {
        (x, y, 2**15 - 1) for x in (2**15 - 2, 2**15 - 1) for y in (-(2**15), 1 - 2**15)
    }
    with pytest.raises(UsageError, match="empty"):
        write_octomap(tmp_path / "a.bt", map_of([]))
    monkeypatch.setattr(space, "MOST_VOXELS", 100)
    with pytest.raises(UsageError, match="at most 100"):
        write_octomap(tmp_path / "a.bt", house())
    with pytest.raises(OutputError, match="exists already"):
        write_octomap(tmp_path / "edge.bt", house())
    assert [file.name for file in tmp_path.iterdir()] == ["edge.bt"]
