"""Lines across a map: what they meet, where it is narrow, what was seen, what is ground.

Ways to pass without being right: lines along an axis only; a clearance in the middle of a stretch,
which is the least one where the ceiling is level; free space that fills all that is not occupied.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from mlscli.errors import UsageError
from mlscli.maps.free_space import FreeSpace
from mlscli.maps.space import FREE, space_at
from mlscli.maps.surface_map import SurfaceMap
from mlscli.plot.cut import between_levels, cut, earth, narrowest, seen_through, stretches
from tests.helpers.meshes import Column, a_map, plane

FLOOR = a_map(*plane(6, 4), cell_size=0.5)


def test_a_cut_along_an_axis_meets_each_cell_once() -> None:
    found = cut(FLOOR, (0.25, 0.75), (2.25, 0.75))
    cells = list(zip(FLOOR.ix[found.patch].tolist(), FLOOR.iy[found.patch].tolist(), strict=True))
    assert cells == [(0, 1), (1, 1), (2, 1), (3, 1), (4, 1)]
    assert found.begin == pytest.approx([0, 0.25, 0.75, 1.25, 1.75])
    assert found.end == pytest.approx([0.25, 0.75, 1.25, 1.75, 2.0])


def test_a_slanting_cut_meets_what_the_line_runs_through() -> None:
    start, end = (0.1, 0.2), (2.9, 1.7)
    found = cut(FLOOR, start, end)
    along = np.linspace(0, 1, 100_001)
    x, y = (start[i] + along * (end[i] - start[i]) for i in (0, 1))
    cells = set(zip((x // 0.5).astype(int).tolist(), (y // 0.5).astype(int).tolist(), strict=True))
    met = list(zip(FLOOR.ix[found.patch].tolist(), FLOOR.iy[found.patch].tolist(), strict=True))
    assert len(met) == len(cells)
    assert set(met) == cells
    assert found.begin[0] == 0
    assert found.end[-1] == pytest.approx(math.dist(start, end))
    assert found.begin[1:] == pytest.approx(found.end[:-1])


def test_all_levels_of_a_cell_are_met_from_below() -> None:
    surface = a_map((0, 0, 0, 0), (0, 0, 3, 0), (0, 0, 9, 2))
    found = cut(surface, (-1, 0.5), (2, 0.5))
    assert found.patch.tolist() == [0, 1, 2]
    assert found.begin.tolist() == [1, 1, 1]


@pytest.mark.parametrize(
    "ends", [((1, 1), (1, 1)), ((0, 0), (math.nan, 1)), ((0, 0), (1e300, 0)), ((0, 0), (1e9, 0))]
)
def test_a_line_that_is_none_is_refused(
    ends: tuple[tuple[float, float], tuple[float, float]],
) -> None:
    with pytest.raises(UsageError, match="`section`"):
        cut(FLOOR, *ends)


def clearances(surface: SurfaceMap, length: int) -> list[tuple[float, float]]:
    """Return along and clearance where each stretch along y = 0.5 is narrowest."""
    spaces = between_levels(surface, cut(surface, (0, 0.5), (length, 0.5)))
    found = [narrowest(spaces, run) for run in stretches(spaces)]
    return [(one.along, one.high - one.low) for one in found]


def test_a_stretch_is_narrowest_under_its_lowest_beam() -> None:
    beams = {4: 2.25, 6: 2.0, 7: 2.5}
    deck: list[Column] = [(x, 0, beams.get(x, 3.0), 0.0) for x in range(2, 10)]
    assert clearances(a_map(*plane(12, 1), *deck), 12) == [(6.5, 2.0)]


def test_where_it_is_level_the_middle_stands_for_all_of_it() -> None:
    deck: list[Column] = [(x, 0, 2.0, 0.0) for x in range(2, 9)]
    assert clearances(a_map(*plane(12, 1), *deck), 12) == [(5.5, 2.0)]


def test_from_one_space_to_the_next_the_step_between_them_is_narrow() -> None:
    # Both are 2 high, and where they meet there is 1 between the step and the beam.
    surface = a_map((0, 0, 0, 0), (0, 0, 2, 0), (1, 0, 1, 0), (1, 0, 3, 0))
    assert clearances(surface, 2) == [(1.0, 1.0)]


def test_two_rooms_beside_each_other_are_two_stretches() -> None:
    rooms: list[Column] = [(x, 0, 2.0 if x < 3 else 2.5, 0.0) for x in (0, 1, 2, 4, 5, 6)]
    assert clearances(a_map(*plane(7, 1), *rooms), 7) == [(1.5, 2.0), (5.5, 2.5)]


def test_what_was_seen_through_is_told_voxel_by_voxel() -> None:
    rng = np.random.default_rng(5)
    voxels = np.unique(rng.integers((0, 0, -2), (6, 3, 9), size=(90, 3)), axis=0)
    cells, start = np.unique(voxels[:, :2], axis=0, return_index=True)
    whole = voxels.astype(np.int32)
    free = FreeSpace(
        cells[:, 0].astype(np.int32),
        cells[:, 1].astype(np.int32),
        np.append(start, len(voxels)).astype(np.int64),
        whole[:, 2],
        rng.integers(1, 4, len(voxels)).astype(np.uint8),
    )
    surface = replace(a_map(*plane(6, 3), (2, 1, 2.2, 1.0), cell_size=1.0), free=free)
    met = cut(surface, (0.2, 0.1), (5.9, 2.8))
    found = seen_through(surface, met)
    assert found is not None
    for step, (ix, iy) in enumerate(zip(met.ix, met.iy, strict=True)):
        middle = (met.edge[step] + met.edge[step + 1]) / 2
        for iz in range(-4, 12):
            z = (iz + 0.5) / 2
            inside = (found.begin <= middle) & (middle <= found.end)
            inside &= (found.low <= z) & (z <= found.high)
            known = space_at(surface, np.array([[ix + 0.5, iy + 0.5, z]]))[0]
            assert inside.any() == (known == FREE), (step, iz)
    # What follows one another is one.
    assert not ((found.begin[1:] == found.begin[:-1]) & (found.low[1:] == found.high[:-1])).any()


def test_a_map_that_knows_no_free_space_tells_none() -> None:
    assert seen_through(FLOOR, cut(FLOOR, (0, 0.75), (3, 0.75))) is None


def ground_along(surface: SurfaceMap, length: int) -> list[int]:
    """Return the cells along y = 0.5 whose lowest patch lies on earth."""
    found = earth(surface, cut(surface, (0, 0.5), (length, 0.5)), -9.0)
    return [int(begin) for begin in found.begin]


def test_no_earth_is_under_a_lone_roof() -> None:
    floor: list[Column] = [(x, 0, 0.1 * x, 0.0) for x in (0, 1, 2, 6, 7, 8)]
    roof: list[Column] = [(x, 0, 4.0, 0.0) for x in (3, 4, 5)]
    assert ground_along(a_map(*floor, *roof), 9) == [0, 1, 2, 6, 7, 8]
    # With its walls the roof is not alone, and stands for itself all the same.
    walls: list[Column] = [(x, 0, 4.0, 3.8) for x in (3, 5)]
    assert ground_along(a_map(*floor, *walls, (4, 0, 4.0, 0.0)), 9) == [0, 1, 2, 3, 5, 6, 7, 8]


def test_a_terrace_and_a_hill_lie_on_earth() -> None:
    terrace: list[Column] = [(x, 0, 0.0 if x < 4 else 4.0, 0.0) for x in range(8)]
    assert ground_along(a_map(*terrace), 8) == list(range(8))
    hill: list[Column] = [(x, 0, 0.8 * min(x, 8 - x), 0.0) for x in range(9)]
    assert ground_along(a_map(*hill), 9) == list(range(9))


def test_no_earth_is_where_lines_passed_beneath() -> None:
    floor = a_map(*plane(3, 1, height=2.0))
    one = np.ones(1, dtype=np.int32)
    free = FreeSpace(one, 0 * one, np.array([0, 1]), 0 * one, np.full(1, 9, dtype=np.uint8))
    assert ground_along(replace(floor, free=free), 3) == [0, 2]
