"""The clearance along a polyline, held against loops over all patches and voxels.

How one could cheat: to sample the way and step over a pole between two samples, so poles stand
anywhere beside long legs; to take the middle of a cell for the whole, which lets a craft graze a
wall, so crafts of all sizes pass at all distances; to call unseen space free where a line passes
near it, or to call all of it unseen, so maps are drawn from nothing seen to everything; to round
heights by their error in the craft's favour; to forgive a wall through which lines pass; to be
right only along x; to leave a piece out where the way bends or climbs.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from typing import Any

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings

import mlscli
from mlscli.errors import UsageError
from mlscli.maps.surface_map import SurfaceMap
from mlscli.queries.clearance import BLOCKED, DOUBTFUL, FITS, NEVER_SEEN, Clearance, clearance
from mlscli.queries.pieces import pieces_of
from mlscli.runtime import threads
from mlscli.runtime.arrays import Float64
from tests.helpers.clearances import piece_against_map
from tests.helpers.lines import free_space_of
from tests.helpers.maps import CELL, Patch, map_of, random_map

HALF = CELL / 2


def seen_map(rng: np.random.Generator, surface: SurfaceMap) -> SurfaceMap:
    """Return a map with sight lines through a share of the voxels around its patches."""
    share = rng.choice([0.3, 0.9, 0.98, 1.0])
    around = [(int(i) + dx, int(j) + dy) for i, j in zip(surface.ix, surface.iy, strict=True)
              for dx in (-1, 0, 1) for dy in (-1, 0, 1)]  # fmt: skip
    lines = {
        (*cell, iz): int(rng.choice([1, 3, 4, 5]))
        for cell in set(around)
        for iz in range(-8, 24)
        if rng.random() < share
    }
    return replace(surface, free=free_space_of(lines))


def way(rng: np.random.Generator, surface: SurfaceMap) -> Float64:
    """Return a polyline about a map: level, upright and sloping legs."""
    middle = np.array([surface.ix.mean() + 0.5, surface.iy.mean() + 0.5, 3.0]) * CELL
    corners = middle + rng.normal(0, 1.2, (rng.integers(1, 5), 3))
    if len(corners) > 1 and rng.random() < 0.5:
        corners[1, :2] = corners[0, :2]
    if rng.random() < 0.5:
        corners[:, 2] = corners[0, 2]
    return corners


@settings(max_examples=10)
@given(st.integers(0, 2**32))
def test_every_piece_is_as_loops_over_all_patches_and_voxels_find_it(seed: int) -> None:
    rng = np.random.default_rng(seed)
    surface = seen_map(rng, random_map(rng))
    if not surface.size:
        return
    width, height = (rng.uniform(0.1, 2.5, 2) * rng.choice([0.3, 1.0])).tolist()
    least = int(rng.integers(1, 4))
    found = clearance(surface, way(rng, surface), width, height, least)
    place = [tuple(each) for each in found.pieces.place.tolist()]
    for n, (a, b) in enumerate(pairwise(place)):
        right = piece_against_map(surface, a, b, width, height, least)
        assert found.verdict[n] == right.verdict
        distance = right.distance if right.distance <= found.reach else math.inf
        assert found.distance[n] == pytest.approx(distance, abs=1e-7)
        assert found.seen[n] == pytest.approx(right.seen)
        assert (found.nearest[n] == -1) == math.isinf(distance)


# --- a gate in a wall, seen from everywhere ---


def everywhere(low: int, high: int, lines: int = 9) -> Any:
    """Return free space with lines through every voxel of a square of cells."""
    cells = ((ix, iy, iz) for ix in range(-9, 9) for iy in range(-9, 9) for iz in range(low, high))
    return free_space_of(dict.fromkeys(cells, lines))


def gate(*, origin: int = 0, seen: bool = True) -> SurfaceMap:
    """Return a floor, and a wall along y = 0 with a gap 2 cells wide."""
    count = 0 if origin else 1024
    patches = [Patch(ix, iy, 0.0, 0.0, 0, 5) for ix in range(-9, 9) for iy in range(-9, 9)]
    patches += [Patch(ix, 0, 3.0, 2.2, origin, count) for ix in range(-9, 9) if ix not in (-1, 0)]
    surface = map_of(patches)
    still = np.where(surface.origin == 0, 0.0, np.nan).astype(np.float32)
    surface = replace(surface, noise=still, variance=np.where(surface.origin == 0, 0.0, np.nan))
    lines = {
        (ix, iy, iz): 9
        for ix in range(-9, 9)
        for iy in range(-9, 9)
        for iz in range(1, 20)
        if iy != 0 or ix in (-1, 0) or iz < 3
    }
    return replace(surface, free=free_space_of(lines if seen else {}))


def through(surface: SurfaceMap, width: float, x: float = 0.0, height: float = 0.5) -> Clearance:
    return clearance(surface, np.array([[x, -2.0, 1.5], [x, 2.0, 1.5]]), width, height)


def test_a_craft_fits_through_a_gate_that_is_as_wide_as_it() -> None:
    assert through(gate(), 2 * CELL).overall == FITS
    assert through(gate(), 2 * CELL).distance.min() == pytest.approx(0.0)
    assert through(gate(), 2 * CELL, x=1e-3).overall == DOUBTFUL
    assert through(gate(), 2 * CELL + 1e-3).overall == DOUBTFUL


def test_it_does_not_fit_where_it_reaches_the_middle_of_a_cell_with_a_wall() -> None:
    assert through(gate(), 3 * CELL - 1e-3).overall == DOUBTFUL
    found = through(gate(), 3 * CELL + 1e-3)
    assert [stretch.verdict for stretch in found.stretches] == [
        *(FITS, DOUBTFUL, BLOCKED, DOUBTFUL, FITS)
    ]
    # The wall's cells are those from y = 0 to 0.5.
    assert found.stretches[2].begin <= 2.25 <= found.stretches[2].end


@pytest.mark.parametrize("width", [0.02, 0.2, CELL])
def test_however_thin_a_craft_it_does_not_fly_through_a_wall(width: float) -> None:
    for x in np.linspace(1.0, 2.0, 23).tolist():
        assert through(gate(), width, x).overall == BLOCKED


def test_a_pole_is_not_stepped_over() -> None:
    pole = map_of([Patch(0, 0, 3.0, 3.0, 0, 5)])
    for angle in np.linspace(0, np.pi, 37).tolist():
        along = 40 * np.array([math.cos(angle), math.sin(angle), 0])
        line = np.array([CELL / 2, CELL / 2, 1.5]) + np.outer((-0.77, 1.0), along)
        found = clearance(pole, line, 0.01, 0.01)
        assert found.overall == BLOCKED
        assert np.isinf(found.distance[[0, -1]]).all()


def test_what_hangs_or_stands_is_as_far_as_its_height_may_be_off() -> None:
    # The height's error has the variance 0.01 and more: see `height_variance`.
    deck = map_of([Patch(ix, iy, 2.0, 0.0, 0, 1) for ix in range(-4, 4) for iy in range(-4, 4)])
    noise: Any = np.full(deck.size, 0.01, dtype=np.float32)
    deck = replace(deck, noise=noise, free=everywhere(-9, 9))
    off = 2 * math.sqrt(deck.height_variance[0])
    assert off > 0.2
    line = np.array([[-1.0, 0, 1.0], [1.0, 0, 1.0]])
    found = clearance(deck, line, 0.5, 1.0)
    assert found.distance == pytest.approx(0.5 - off)
    for height, verdict in (
        (2 * (1.0 - off) - 1e-3, FITS),
        (2 * (1.0 - off) + 1e-3, DOUBTFUL),
        (2 * (1.0 + off) - 1e-3, DOUBTFUL),
    ):
        assert clearance(deck, line, 0.5, height).overall == verdict
    unseen = replace(deck, free=everywhere(-9, 3))
    assert clearance(unseen, line, 0.5, 2 * (1.0 + off) + 1e-3).overall == BLOCKED


# --- what was seen ---


def test_without_free_space_whatever_is_not_blocked_was_never_seen() -> None:
    blind = replace(gate(), free=None)
    assert through(blind, CELL).overall == NEVER_SEEN
    assert np.isnan(through(blind, CELL).seen).all()
    assert through(blind, 4 * CELL).overall == BLOCKED
    assert through(gate(seen=False), CELL).overall == NEVER_SEEN


@pytest.mark.parametrize("origin", [1, 2])
def test_a_closed_gap_blocks_only_if_it_is_plastered(origin: int) -> None:
    verdict = {1: BLOCKED, 2: NEVER_SEEN}[origin]
    assert through(gate(origin=origin), 4 * CELL).overall == verdict
    seen = replace(gate(origin=origin), free=everywhere(1, 20))
    # Lines refute a guess; what is closed for certain they make doubtful.
    assert through(seen, 4 * CELL).overall == {1: DOUBTFUL, 2: FITS}[origin]


def test_a_wall_through_which_lines_passed_is_doubtful() -> None:
    assert through(replace(gate(), free=everywhere(1, 20)), 4 * CELL).overall == DOUBTFUL


def test_a_doubtful_wall_hides_no_kerb_beside_it() -> None:
    # The craft reaches deeper into the wall, through which lines passed, than into the kerb.
    both = map_of([Patch(0, 0, 3.0, 3.0, 0, 1024), Patch(1, 0, 0.7, 0.7, 0, 1024)])
    still: Any = np.zeros(2, dtype=np.float32)
    both = replace(both, noise=still, free=free_space_of({(0, 0, iz): 9 for iz in range(20)}))
    place = np.array([[CELL / 2, CELL / 2, 1.0]])
    assert clearance(both, place, 1.2, 0.5).overall == DOUBTFUL
    assert clearance(both, place, 1.2, 1.0).overall == BLOCKED


@pytest.mark.parametrize("missing", range(1, 9))
def test_holes_between_lines_are_seen_and_larger_ones_are_not(missing: int) -> None:
    # A hole one cell wide in the middle of a craft's way, some voxels high.
    lines = {
        (ix, iy, iz): 2
        for ix in range(-9, 9)
        for iy in range(-9, 9)
        for iz in range(40)
        if not (ix == iy == 0 and 10 <= iz < 10 + missing)
    }
    open_air = replace(map_of([Patch(50, 50, 0.0, 0.0, 0, 1)]), free=free_space_of(lines))
    z = (10 + missing / 2) * HALF
    line = np.array([[-1.0, 0.2, z], [1.0, 0.2, z]])
    verdict = clearance(open_air, line, 2 * CELL, 6 * CELL).overall
    assert verdict == (NEVER_SEEN if missing >= 6 else FITS)
    assert clearance(open_air, line, 2 * CELL, 6 * CELL, least=3).overall == NEVER_SEEN


def test_a_level_hole_of_three_by_three_cells_is_not_between_lines() -> None:
    for wide, verdict in ((2, FITS), (3, NEVER_SEEN)):
        lines = {
            (ix, iy, iz): 2
            for ix in range(-9, 9)
            for iy in range(-9, 9)
            for iz in range(40)
            if not (0 <= ix < wide and 0 <= iy < wide and iz in (20, 21))
        }
        open_air = replace(map_of([Patch(50, 50, 0.0, 0.0, 0, 1)]), free=free_space_of(lines))
        line = np.array([[0.2, 0.2, 12 * HALF], [0.2, 0.2, 30 * HALF]])
        assert clearance(open_air, line, CELL, 6 * CELL).overall == verdict


@pytest.mark.parametrize("cells", [1, 2, 3, 5])
def test_a_closed_box_is_never_free_inside(cells: int) -> None:
    inside = range(cells)
    walls = [
        Patch(ix, iy, (cells + 2) * CELL, (cells + 2) * CELL, 0, 1024)
        for ix in range(-1, cells + 1)
        for iy in range(-1, cells + 1)
        if ix not in inside or iy not in inside
    ]
    ends = [Patch(ix, iy, z * CELL, 0.0, 0, 9) for ix in inside for iy in inside
            for z in (0, cells + 2)]  # fmt: skip
    box = map_of([*walls, *ends])
    lines = {
        (ix, iy, iz): 9
        for ix in range(-5, cells + 5)
        for iy in range(-5, cells + 5)
        for iz in range(40)
        if ix not in range(-1, cells + 1) or iy not in range(-1, cells + 1)
    }
    box = replace(box, free=free_space_of(lines))
    middle = np.array([[cells * CELL / 2, cells * CELL / 2, (cells + 2) * CELL / 2]])
    for width in (0.01, CELL / 2, cells * CELL):
        assert clearance(box, middle, width, CELL).overall != FITS
        assert clearance(box, middle, width, CELL).seen.max() == 0


# --- the way ---


def test_pieces_are_at_most_a_cell_long_and_cover_the_way() -> None:
    corners = np.array([[0.0, 0, 0], [3.3, 0, 0], [3.3, 0, 0], [3.3, 0.1, 4.0]])
    place, along = pieces_of(corners, CELL)
    step = np.linalg.norm(np.diff(place, axis=0), axis=1)
    assert step.max() <= CELL + 1e-12
    assert np.diff(along) == pytest.approx(step)
    assert along[-1] == pytest.approx(3.3 + math.hypot(0.1, 4.0))
    for corner in corners:
        assert (np.abs(place - corner).sum(axis=1) == 0).any()


def test_a_single_place_is_where_a_craft_hovers() -> None:
    found = clearance(gate(), np.array([[0.0, -2.0, 1.5]]), CELL, CELL)
    assert found.verdict.tolist() == [FITS]
    assert found.stretches[0].end == 0.0


def test_a_way_does_not_depend_on_its_direction_or_on_the_grids_symmetries() -> None:
    rng = np.random.default_rng(3)
    surface = seen_map(rng, random_map(rng, fill=0.9))
    line = way(rng, surface)
    one, back = clearance(surface, line, 1.1, 0.7), clearance(surface, line[::-1], 1.1, 0.7)
    assert one.verdict.tolist() == back.verdict[::-1].tolist()
    assert one.distance == pytest.approx(back.distance[::-1])


def test_any_number_of_threads_finds_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(5)
    surface = seen_map(rng, random_map(rng, fill=0.9))
    line = np.vstack([way(rng, surface) for _ in range(40)])
    found = []
    for worthwhile in (1, 10**9):
        monkeypatch.setattr(threads, "WORTHWHILE", worthwhile)
        found.append(clearance(surface, line, 1.1, 0.7))
    for name in ("verdict", "distance", "nearest", "seen"):
        one, other = (getattr(each, name) for each in found)
        assert one.tobytes() == other.tobytes()
    assert len(set(found[0].verdict.tolist())) > 1


def test_an_empty_map_knows_of_nothing() -> None:
    found = clearance(map_of([]), np.array([[0.0, 0, 0], [1, 1, 1]]), 0.5, 0.5)
    assert found.overall == NEVER_SEEN
    assert np.isinf(found.distance).all()


@pytest.mark.parametrize(
    ("line", "fault"),
    [
        (np.zeros((0, 3)), "is an array (0, 3) of float64, expected numbers (K, 3)"),
        (np.zeros((2, 2)), "is an array (2, 2) of float64, expected numbers (K, 3)"),
        (np.array([[0.0, 0, 0], [0, np.nan, 0]]), "corner 1 is 0,nan,0, beyond all cells"),
        (np.array([[0.0, 0, 1e300]]), "corner 0 is 0,0,1e+300, beyond all cells"),
        (np.array([[0.0, 0, 0], [1e8, 0, 0]]), "is 1e+08 long, 2e+08 cells; expected at most "),
    ],
)
def test_other_ways_are_refused(line: Float64, fault: str) -> None:
    with pytest.raises(UsageError) as refused:
        clearance(map_of([]), line, 0.5, 0.5)
    assert str(refused.value).startswith(f"polyline: {fault}")


@pytest.mark.parametrize("size", [0.0, -1.0, math.nan, math.inf, 1000.1 * CELL])
def test_other_crafts_are_refused(size: float) -> None:
    with pytest.raises(UsageError, match=r"^width: is .*, expected a length above 0, at most 1,0"):
        mlscli.clearance(map_of([]), np.zeros((1, 3)), size, 0.5)
    with pytest.raises(UsageError, match=r"^height: is .*, expected a length above 0, at most 1,0"):
        mlscli.clearance(map_of([]), np.zeros((1, 3)), 0.5, size)
