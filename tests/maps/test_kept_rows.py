"""What is kept by cell is what would be kept in one piece.

How one could cheat: areas within one strip; rooms that are never left, or never too small; a table
without collisions; sets without a reach; rows that are replaced by themselves.
"""

from __future__ import annotations

import resource
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import psutil
from hypothesis import given, settings
from hypothesis import strategies as st

from mlscli.maps.cells import LEAST_INDEX, CellSet, unpack
from mlscli.maps.kept_map import KeptMap
from mlscli.maps.kept_rows import KeptRows
from mlscli.maps.records import records_of, rows_in
from mlscli.maps.rows import part, with_part
from mlscli.maps.strips import STRIP_CELLS
from mlscli.maps.surface_map import SurfaceMap
from mlscli.runtime.arrays import UInt64
from tests.helpers.maps import random_map

# So many cells lie in two strips, one above the other.
SIDE = 2 * STRIP_CELLS
seeds = st.integers(0, 2**32 - 1)


def scattered(rng: np.random.Generator) -> SurfaceMap:
    """Return a map whose cells lie apart, in several strips."""
    surface = random_map(rng)
    step = int(rng.choice([1, 5, SIDE]))
    return replace(surface, ix=surface.ix * step, iy=surface.iy * step).sorted()


@settings(max_examples=35, deadline=None)
@given(seeds)
def test_areas_are_replaced_as_in_a_whole_map(seed: int) -> None:
    rng = np.random.default_rng(seed)
    surface = scattered(rng)
    kept = KeptMap(surface.grid)
    kept.replace(CellSet.of(surface.ix, surface.iy), surface)
    for _ in range(6):
        centres = rng.integers(-6, 7, (2, 2)) * SIDE // 2
        cells = CellSet.of(*centres).widened(int(rng.choice([0, 3, 40, 10**6])))
        assert kept.extract(cells) == surface.in_cells(cells)
        rows = rows_in(records_of(surface))
        assert part(rows, cells).tobytes() == records_of(surface.in_cells(cells)).tobytes()
        new = scattered(rng)
        if rng.random() < 0.3:
            new = new.take(np.arange(0))
        # What lies elsewhere is left out.
        change = kept.replace(cells, new)
        assert change.applied_to(surface) == surface.replace(cells, new)
        replaced = with_part(rows, cells, rows_in(records_of(new)))
        assert replaced.tobytes() == records_of(surface.replace(cells, new)).tobytes()
        surface = surface.replace(cells, new)
        assert kept.whole() == surface


WORDS = 3
Cell = tuple[int, int]


def random_rows(rng: np.random.Generator, cells: list[Cell]) -> dict[Cell, list[list[int]]]:
    """Return some rows for each cell, but for their cells; few that differ."""
    return {cell: rng.integers(0, 2, (rng.integers(0, 4), WORDS - 1)).tolist() for cell in cells}


def as_rows(by_cell: dict[Cell, list[list[int]]]) -> UInt64:
    rows = [
        ((x - LEAST_INDEX << 32) + y - LEAST_INDEX, *row)
        for x, y in sorted(by_cell)
        for row in by_cell[x, y]
    ]
    return np.array(rows, dtype=np.uint64).reshape(-1, WORDS)


@settings(max_examples=35, deadline=None)
@given(seeds)
def test_rows_are_kept_cell_by_cell_in_the_order_in_which_they_were_given(seed: int) -> None:
    rng = np.random.default_rng(seed)
    origin = rng.choice([0, -SIDE, LEAST_INDEX, LEAST_INDEX + SIDE // 2], 2)
    kept, model = KeptRows(WORDS), dict[Cell, list[list[int]]]()
    for _ in range(8):
        ix, iy = origin[:, None] + rng.integers(0, rng.choice([4, 2 * SIDE]), (2, 30))
        cells = CellSet.of(ix, iy)
        listed = [(int(x), int(y)) for x, y in zip(*unpack(cells.keys), strict=True)]
        new = random_rows(rng, listed)
        removed, added = kept.update(cells, as_rows(new))
        before = {cell: model.get(cell, []) for cell in listed}
        assert removed.tolist() == as_rows(without(before, new)).tolist()
        assert added.tolist() == as_rows(without(new, before)).tolist()
        model |= new
        assert kept.extract(cells).tolist() == as_rows(new).tolist()
        assert kept.whole().tolist() == as_rows(model).tolist()


def without(
    one: dict[Cell, list[list[int]]], other: dict[Cell, list[list[int]]]
) -> dict[Cell, list[list[int]]]:
    return {cell: [row for row in rows if row not in other[cell]] for cell, rows in one.items()}


def test_what_is_replaced_again_and_again_takes_no_more_room() -> None:
    kept, cells = KeptRows(WORDS), CellSet.of(np.arange(20), np.arange(20))
    sizes = []
    for turn in range(200):
        rows = np.repeat(np.c_[cells.keys, cells.keys, cells.keys], 1 + turn % 3, axis=0)
        rows[:, 1] = turn
        kept.update(cells, rows)
        sizes.append(sum(array.nbytes for array in kept._kept))
    assert max(sizes[100:]) == max(sizes[:100]) <= 10 * 60 * WORDS * 8 + 20 * 600


def test_what_lies_scattered_costs_each_what_is_its_own() -> None:
    few, many = 500, 40_000
    # Kernels are loaded.
    seconds_for_each(few)
    with at_most_more(4 * 2**30):
        assert seconds_for_each(many) < 4 * min(seconds_for_each(few) for _ in range(5))


def test_who_keeps_what_differed_keeps_no_more() -> None:
    kept = KeptRows(WORDS)
    cells = CellSet.of(*np.divmod(np.arange(SIDE * SIDE), SIDE))
    rows = np.repeat(cells.keys[:, None], WORDS, axis=1)
    kept.update(cells, rows)
    differing = []
    with at_most_more(32 * 2**20):
        for turn in range(400):
            rows[turn, 1] = turn
            differing.append(kept.update(cells, rows))
    assert [(len(removed), len(added)) for removed, added in differing] == 400 * [(1, 1)]


def test_the_surroundings_of_what_lies_scattered_are_not_listed() -> None:
    # Kernels are loaded.
    assert len(surroundings(100)) == 100
    # The squares have 6 million strips, of 16 bytes each.
    with at_most_more(64 * 2**20):
        assert len(surroundings(3000)) == 3000


def surroundings(size: int) -> UInt64:
    """Return what lies in wide squares around cells that lie far apart."""
    cells = CellSet.of(np.arange(size) * 1000, np.zeros(size, dtype=np.int64))
    kept = KeptRows(WORDS)
    kept.update(cells, np.repeat(cells.keys[:, None], WORDS, axis=1))
    return kept.extract(cells.widened(60))


def seconds_for_each(size: int) -> float:
    """Return what it takes, for each, to put away and read cells of which no two share a strip."""
    across = int(np.sqrt(size))
    ix, iy = np.arange(size) % across * 2 * SIDE, np.arange(size) // across * 2 * SIDE
    kept, cells = KeptRows(WORDS), CellSet.of(ix, iy)
    begin = time.process_time()
    kept.update(cells, np.repeat(cells.keys[:, None], WORDS, axis=1))
    assert len(kept.extract(cells)) == size
    return (time.process_time() - begin) / size


@contextmanager
def at_most_more(memory: int) -> Iterator[None]:
    """Let the process ask for no more than so many bytes more, used or not."""
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (psutil.Process().memory_info().vms + memory, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))
