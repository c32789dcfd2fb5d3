"""Maps as OctoMap's binary files, ``.bt``: occupied, free and unknown space.

The format is that of A. Hornung et al., *OctoMap: An Efficient Probabilistic 3D Mapping Framework
Based on Octrees*, Autonomous Robots 2013 (doi:10.1007/s10514-012-9321-0), as its library reads it:
a header of text, then for each inner node, depth first, two bits for each of its eight children: 0
unknown, 1 a free leaf, 2 an occupied one, 3 an inner node. The tree has 16 levels. Its cubes have
half the side of a cell, which is the height of the map's voxels (`mlscli.maps.free_space`), so that
four of them side by side are one of these.
"""

from __future__ import annotations

import os
from numbers import Integral
from typing import NamedTuple

import numpy as np

from mlscli.errors import UsageError, expect, expect_path
from mlscli.io.writing.atomic import atomic_write, refuse_existing
from mlscli.maps.space import FREE, OCCUPIED, known_voxels
from mlscli.maps.surface_map import ARTIFICIAL, SurfaceMap
from mlscli.runtime.arrays import Array, Int64, UInt8, UInt64

DEPTH = 16
"""Levels of OctoMap's trees below the root: keys are 16 bits."""

HEAD = """# Octomap OcTree binary file
# (feel free to add / change comments, but leave the first line as it is!)
#
id OcTree
size {nodes}
res {side!r}
data
"""

# What two bits say of a child; FREE and OCCUPIED have the numbers that they have here.
_INNER = 3
# Eight children alike: one leaf stands for them.
_ALIKE = {0x5555: FREE, 0xAAAA: OCCUPIED}


class Octree(NamedTuple):
    """What a file holds.

    Attributes
    ----------
    side : float
        Side of its smallest cubes, in the unit of the map.
    nodes : int
        How many nodes there are, leaves and the root among them.
    occupied, free : int
        How many voxels of the map, a cell wide and half a cell high, are so.
    """

    side: float
    nodes: int
    occupied: int
    free: int


def write_octomap(
    path: str | os.PathLike[str],
    surface: SurfaceMap,
    *,
    artificial: bool = True,
    least: int = 2,
    overwrite: bool = False,
) -> Octree:
    """Write what is known of space for OctoMap, as a binary file.

    Occupied is what a patch reaches into, free where enough sight lines passed through, as
    `mlscli.maps.space.space_at` has it; all else is unknown. Of a map without free space, all that
    is not occupied is.

    Parameters
    ----------
    path
        Usually ends in ``.bt``.
    surface : SurfaceMap
    artificial : bool
        Whether artificial patches are occupied space; else they are no patches.
    least : int
        How many sight lines make space free.
    overwrite : bool

    Returns
    -------
    Octree

    Raises
    ------
    UsageError
        Where the map holds nothing, or reaches farther than keys of 16 bits.
    OutputError
        Where the file exists and `overwrite` is False, or cannot be written.
    """
    expect_path(path, "path", "the file to write")
    expect(surface, SurfaceMap, "surface", "a map (SurfaceMap)")
    expect(least, Integral, "least", "a whole number")
    refuse_existing(path, overwrite=overwrite)
    if not artificial:
        surface = surface.take(surface.origin != ARTIFICIAL)
    _require_keys(surface)
    voxels, space = _each_once(*known_voxels(surface, least))
    if not len(voxels):
        raise UsageError("the map is empty; there is nothing to make an octree of")
    bits, nodes = _tree(voxels, space)
    side = surface.cell_size / 2
    with atomic_write(path, overwrite=overwrite) as stream:
        stream.write(HEAD.format(nodes=nodes, side=side).encode("ascii"))
        stream.write(bits.astype("<u2").tobytes())
    counts = np.bincount(space, minlength=OCCUPIED + 1)
    return Octree(side, nodes, int(counts[OCCUPIED]), int(counts[FREE]))


def _require_keys(surface: SurfaceMap) -> None:
    """Refuse a map whose voxels have no key."""
    half, most = surface.cell_size / 2, 2 ** (DEPTH - 1)
    ends: list[Array] = [np.floor(surface.low_end / half), np.floor(surface.height / half)]
    across: list[Array] = [surface.ix, surface.iy]
    if surface.free is not None:
        ends.append(surface.free.iz)
        across += [surface.free.ix, surface.free.iy]
    for indices, limit in ((across, most // 2), (ends, most)):
        for index in indices:
            if len(index) and not (-limit <= index.min() and index.max() < limit):
                raise UsageError(
                    f"the map reaches farther than {most * half:g} from its origin, which is what "
                    f"OctoMap has keys for with cubes of {half:g}; build it with larger cells, or "
                    "without what lies far away: `crop`"
                )


def _each_once(voxels: Int64, space: UInt8) -> tuple[UInt64, UInt8]:
    """Return voxels in Morton order, each once, as its key; occupied where it is both.

    The key of a voxel is that of the cube which it shares with the one above or below, and last
    which of the two it is.
    """
    ix, iy, iz = voxels.T
    z = iz + 2 ** (DEPTH - 1)
    keys = _spread(ix + 2 ** (DEPTH - 2)) | _spread(iy + 2 ** (DEPTH - 2)) << np.uint64(1)
    keys = (keys | _spread(z >> 1) << np.uint64(2)) << np.uint64(1) | (z & 1).astype(np.uint64)
    sorted_ = np.sort(keys << np.uint64(1) | (space == FREE))
    keys = sorted_ >> np.uint64(1)
    first = np.ones(len(keys), dtype=np.bool_)
    first[1:] = keys[1:] != keys[:-1]
    is_free = (sorted_[first] & np.uint64(1)).astype(np.bool_)
    return keys[first], np.where(is_free, FREE, OCCUPIED).astype(np.uint8)


def _spread(numbers: Int64) -> UInt64:
    """Return numbers of 16 bits with two zeros before each of them, uint64 (N,)."""
    spread: UInt64 = numbers.astype(np.uint64)
    for shift, mask in (
        (32, 0x1F00000000FFFF),
        (16, 0x1F0000FF0000FF),
        (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3),
        (2, 0x1249249249249249),
    ):
        spread = (spread | spread << np.uint64(shift)) & np.uint64(mask)
    return spread


def _tree(keys: UInt64, space: UInt8) -> tuple[Array, int]:
    """Return what is written of the inner nodes, uint16 (M,), depth first, and the count of all.

    Parameters
    ----------
    keys : uint64 (V,)
        Of voxels, ascending, each once; see `_each_once`.
    space : uint8 (V,)
        `FREE` or `OCCUPIED`.
    """
    # Cubes of two voxels first: of their eight children, four are one voxel, four the other.
    codes, children = _gathered(keys >> np.uint64(1), space.astype(np.uint16) * 0x55
                                << 8 * (keys & np.uint64(1)).astype(np.uint16))  # fmt: skip
    places, written = [], []
    nodes = 1
    for depth in range(DEPTH - 1, -1, -1):
        kinds = np.full(len(codes), _INNER, dtype=np.uint16)
        if depth:
            for alike, state in _ALIKE.items():
                kinds[children == alike] = state
        inner = kinds == _INNER
        # Depth first: by the first cube in each, and of those with the same one, the largest first.
        first = codes[inner] << np.uint64(3 * (DEPTH - 1 - depth))
        places.append(first << np.uint64(4) | np.uint64(depth))
        written.append(children[inner])
        nodes += int(_CHILDREN[children[inner]].sum())
        if depth:
            which = (codes & np.uint64(7)).astype(np.uint16)
            codes, children = _gathered(codes >> np.uint64(3), kinds << 2 * which)
    order = np.argsort(np.concatenate(places))
    return np.concatenate(written)[order], nodes


def _gathered(codes: UInt64, bits: Array) -> tuple[UInt64, Array]:
    """Return ascending codes each once, and the bits of all that have it put together."""
    start = np.flatnonzero(np.concatenate(([True], codes[1:] != codes[:-1])))
    return codes[start], np.bitwise_or.reduceat(bits, start)


def _children() -> UInt8:
    """Return how many children nodes have, by what is written of them, uint8 (65536,)."""
    bits = np.arange(2**16, dtype=np.uint32)
    pairs = bits[:, None] >> np.arange(0, 16, 2, dtype=np.uint32) & 3
    counts: UInt8 = np.count_nonzero(pairs, axis=1).astype(np.uint8)
    return counts


_CHILDREN = _children()
