"""Sight lines: a wide gap through which points were seen stays open, and no other.

How one could cheat: to count lines that end at the patch, or run past its cell; to open what a
single line crosses, or only the patch that is crossed; to open gaps that a craft cannot pass; to
take a position that is not known for one far away. Hence each limit from both sides, and a
reference of plain loops.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np
import pytest

from mlscli.keyframes.batches import Points
from mlscli.maps.cells import CellSet
from mlscli.maps.surface_map import SurfaceMap
from mlscli.parameters.lengths import Cells
from mlscli.pipeline.stages import sights
from mlscli.pipeline.stages.plaster import Plaster
from mlscli.pipeline.stages.sights import Sights
from mlscli.runtime.arrays import Float64, Int64
from tests.helpers import references
from tests.helpers.maps import (
    CELL,
    GAP,
    Patch,
    map_of,
    patches_of,
    random_map,
    symmetries,
    turned_map,
)
from tests.helpers.references import Place

NAN = float("nan")
UNKNOWN = (NAN, NAN, NAN)
Line = tuple[Place, Place]

# A gap of three cells, x from 0 to 1.5, between two cells of a roof at height 2.
ROOF = map_of([Patch(x, 0, 2.0, 0.0, 0, 5) for x in (-1, 3)])
CLOSES = Plaster(height_clearance=0.1, max_gap=CELL, max_gap_enhanced=3 * CELL, sight=Cells(4))


def sights_of(lines: list[Line], cells: CellSet | None = None) -> Sights:
    """Return sight lines, each of a keyframe of its own."""
    xyz = np.array([point for _, point in lines], dtype=np.float64).reshape(-1, 3)
    craft = np.array([place for place, _ in lines], dtype=np.float64).reshape(-1, 3)
    route = np.column_stack((np.zeros(len(lines)), craft))
    points = Points.of(xyz, np.arange(len(lines), dtype=np.int32))
    sights = Sights(route, lambda _: points)
    sights.cells = cells
    return sights


def is_closed(*lines: Line, stage: Plaster = CLOSES, surface: SurfaceMap = ROOF) -> bool:
    """Tell whether all of the gap is closed; if not, all of it must be open."""
    inserted = int((stage.apply(surface, sights_of(list(lines))).origin > 0).sum())
    assert inserted in (0, 3)
    return inserted == 3


def down(x: float = 0.75, y: float = 0.25, *, craft: float = 9.0, point: float = 0.0) -> Line:
    return (x, y, craft), (x, y, point)


def test_a_gap_stays_open_as_a_whole_where_two_points_were_seen_through_it() -> None:
    assert is_closed()
    for x in (0.25, 0.75, 1.25):
        assert is_closed(down(x))
        assert not is_closed(down(x), down(x))
    # Two lines through two patches are one through each.
    assert is_closed(down(0.25), down(1.25))
    # From below it is the same.
    up = down(craft=0.0, point=5.0)
    assert not is_closed(up, up)


def test_lines_beside_the_gap_or_along_the_edges_of_its_cells_do_not_count() -> None:
    for x, y in ((-0.25, 0.25), (1.75, 0.25), (0.75, 0.75), (0.75, -0.25)):
        assert is_closed(*[down(x, y)] * 3)
    for x, y in ((0.5, 0.25), (1.0, 0.25), (0.75, 0.0), (0.75, 0.5)):
        assert is_closed(*[down(x, y)] * 3)


def test_a_line_ends_a_cell_before_its_point_and_half_a_cell_beyond_the_patch() -> None:
    # Steep lines: the cell decides. Flat ones cross the height near their point: half a cell does.
    for low, closed in ((1.6, True), (1.51, True), (1.49, False), (1.0, False)):
        assert is_closed(*[down(point=low)] * 2) is closed
    for drop, closed in ((0.2, True), (0.24, True), (0.26, False)):
        # The line falls by 1 in 4, from above the gap to a point beyond it.
        x = 0.75 + 4 * drop
        line = (0.75 - 4.0, 0.25, 3.0), (x, 0.25, 2.0 - drop)
        assert is_closed(line, line) is closed


def test_a_line_that_does_not_reach_the_height_does_not_count() -> None:
    assert is_closed(*[down(craft=1.9)] * 2)
    assert is_closed(*[down(craft=9.0, point=2.6)] * 2)


def test_points_count_as_far_beside_the_gap_as_asked() -> None:
    # The points lie in cell 9, the line crosses cell 1: eight cells beside.
    line = (-7.25, 0.25, 4.0), (4.75, 0.25, 1.0)
    for sight, closed in ((Cells(8), False), (Cells(7), True), (4.0, False), (1e300, False)):
        assert is_closed(line, line, stage=replace(CLOSES, sight=sight)) is closed


def test_without_positions_nothing_was_seen() -> None:
    _, point = down()
    assert is_closed(*[(UNKNOWN, point)] * 3)
    assert is_closed(*[((0.75, NAN, 9.0), point)] * 3)
    assert not is_closed((UNKNOWN, point), down(), down())


def test_a_gap_that_the_craft_cannot_pass_is_closed_all_the_same() -> None:
    for enhanced in (0, 4 * CELL):
        narrow = replace(CLOSES, max_gap=3 * CELL, max_gap_enhanced=enhanced)
        assert is_closed(*[down()] * 3, stage=narrow)


def test_without_a_cell_of_sight_nothing_is_asked() -> None:
    for sight in (0.0, 0.4):
        sights = sights_of([down()] * 2)
        assert replace(CLOSES, sight=sight).apply(ROOF, sights) == CLOSES.apply(ROOF)
        assert sights.asked == []


def test_of_gaps_elsewhere_nothing_is_asked() -> None:
    elsewhere = sights_of([down()] * 2, CellSet.of(np.array([9]), np.array([0])))
    assert CLOSES.apply(ROOF, elsewhere) == CLOSES.apply(ROOF)
    assert elsewhere.asked == []
    # One cell of the closing is enough.
    here = sights_of([down()] * 2, CellSet.of(np.array([2]), np.array([0])))
    assert CLOSES.apply(ROOF, here) == ROOF
    (asked,) = here.asked
    assert CellSet(asked).contains(np.arange(-1, 4), np.zeros(5, dtype=np.int64)).tolist() == [
        *(False, True, True, True, False)
    ]


def lines_over(surface: SurfaceMap, rng: np.random.Generator) -> list[Line]:
    """Return sight lines to places above and below the patches of a map; half on a lattice."""
    middle = np.array([*(CELL * np.mean([*at, 0]) for at in (surface.ix, surface.iy)), 0.0])
    craft = middle + rng.uniform((-5, -5, -1), (5, 5, 6), (40, 3))
    point = middle + rng.uniform((-3, -3, -4), (3, 3, 3), (40, 3))
    if rng.random() < 0.5:
        craft, point = np.round(craft * 4) / 4, np.round(point * 4) / 4
        point[:, :2] += 0.03
    craft[rng.random(40) < 0.2] = np.nan
    rows: list[tuple[list[float], list[float]]] = [
        (craft[i].tolist(), point[i].tolist()) for i in rng.integers(0, 40, 60)
    ]
    return [((a, b, c), (x, y, z)) for (a, b, c), (x, y, z) in rows]


def drawn(rng: np.random.Generator) -> Plaster:
    return Plaster(
        height_thresh=float(rng.choice([0.5, 1.0])),
        height_clearance=0.25,
        max_gap=float(rng.choice([0, CELL])),
        max_gap_enhanced=float(rng.choice([3 * CELL, 5 * CELL])),
        support=int(rng.choice([0, 0, 1])),
        sight=float(rng.choice([1.0, 2.0, 99.0])),
    )


def test_gaps_are_closed_as_the_rule_reads_and_turned_as_the_map_is() -> None:
    rng = np.random.default_rng(1)
    opened = 0
    for _ in range(200):
        surface, stage = random_map(rng, fill=0.4), drawn(rng)
        lines = lines_over(surface, rng)
        after = stage.apply(surface, sights_of(lines))
        seen = partial(
            references.seen_through, lines=lines, cell_size=CELL, farthest=stage.sight_reach(CELL)
        )
        widths = length(stage.max_gap), length(stage.max_gap_enhanced)
        given = CELL, GAP, stage.height_thresh, 0.25, *widths, 0.0, stage.support, True
        assert patches_of(after) == references.plaster(patches_of(surface), *given, seen)
        opened += after != stage.apply(surface)
        for symmetry in list(symmetries())[:: int(rng.integers(1, 8))]:
            turned = sights_of(turned_lines(lines, symmetry))
            assert stage.apply(turned_map(surface, symmetry), turned) == turned_map(after, symmetry)
    assert opened > 20


def length(value: object) -> float:
    assert isinstance(value, float | int)
    return float(value)


def turned_lines(lines: list[Line], symmetry: tuple[bool, bool, bool]) -> list[Line]:
    swap, negate_x, negate_y = symmetry

    def turned(place: Place) -> Place:
        x, y = -place[0] if negate_x else place[0], -place[1] if negate_y else place[1]
        return (y, x, place[2]) if swap else (x, y, place[2])

    return [(turned(craft), turned(point)) for craft, point in lines]


def test_neither_the_order_of_the_points_nor_threads_change_what_was_seen(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rng = np.random.default_rng(4)
    cases = []
    for _ in range(30):
        surface, stage = random_map(rng, fill=0.5), drawn(rng)
        lines = lines_over(surface, rng)
        cases.append((surface, stage, lines, stage.apply(surface, sights_of(lines))))
    monkeypatch.setattr("mlscli.runtime.threads.WORTHWHILE", 1e-9)
    for surface, stage, lines, expected in cases:
        shuffled = [lines[i] for i in rng.permutation(len(lines))]
        assert stage.apply(surface, sights_of(shuffled)) == expected


def every(xyz: Float64, *_: object) -> Int64:
    """Return the numbers of all points: none is left out."""
    return np.arange(len(xyz))


def test_a_few_lines_are_looked_along_as_many_are(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(6)
    seen = 0
    able = sights._able
    for case in range(160):
        surface, stage = random_map(rng, fill=0.5), drawn(rng)
        lines = lines_over(surface, rng)
        if case % 4 == 0:
            # From so far that a place on the line is rounded by more than the map is wide.
            lines = [((a * 1e20, b * 1e20, c * 1e20), point) for (a, b, c), point in lines]
        maps = []
        for few, choose in ((0, able), (10**9, able), (0, every), (10**9, every)):
            monkeypatch.setattr(sights, "_FEW", few)
            monkeypatch.setattr(sights, "_able", choose)
            maps.append(stage.apply(surface, sights_of(lines)))
        assert maps[1:] == maps[:1] * 3
        seen += maps[0] != stage.apply(surface)
    assert seen > 5


def test_points_far_apart_are_found() -> None:
    far: list[Line] = [
        down(x * 1e8 + 0.3, y * 1e8 + 0.3) for x, y in product((-1.0, 1.0), repeat=2)
    ]
    assert is_closed(*far)
    assert not is_closed(*far, down(), down())
